"""Tables to Parquet files and back, atomically and checked.

One file holds one table. Codes are stored as their names, a trace's ego path as rows of kind
`ego` (object -1, derivatives null), so that any Parquet reader shows something sensible. Schema
version, content hash and provenance travel in the file's metadata; so does a seal, the hash of all
bytes of the file but its own, by which damage is told before Parquet readers stumble over it.
"""

import contextlib
import errno
import hashlib
import io
import json
import os
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import polars as pl

from mdkf.tables import Detections, EgoPath, Table, TableError, Trace, Tracks
from sim_bridge.data_frame import AnyTable, from_polars, to_polars

SCHEMA_VERSION = 1
_TABLES: dict[str, type[Table]] = {t.__name__: t for t in (Trace, EgoPath, Detections, Tracks)}
_KEY = "mdkf"
_HEADER: Mapping[str, tuple[type, ...]] = {
    "table": (str,),
    "schema": (int,),
    "n_frames": (int,),
    "dt": (int, float),  # as it was given: 1 and 1.0 have different content hashes
    "content_hash": (str,),
    "provenance": (dict,),
}
_SEAL = '"sha256" '  # what the seal begins with: in no JSON stands a space after a name
_NO_DIGEST = "0" * 64


def write_table(table: Table, path: str | Path) -> None:
    """Write a table; the file appears whole or not at all. `OSError` names what went wrong."""
    data = to_polars(table, ego=True)
    header = {
        "table": type(table).__name__,
        "schema": SCHEMA_VERSION,
        "n_frames": table.n_frames,
        "dt": table.dt,
        "content_hash": table.content_hash(),
        "provenance": dict(table.provenance),
        "diagnostics": list(getattr(table, "diagnostics", ())),
    }
    _write_sealed(data, Path(path), {_KEY: json.dumps(header, sort_keys=True)})


def read_table(path: str | Path, expected: type[AnyTable]) -> AnyTable:
    """Read a table of the expected type.

    Raises `TableError`, naming the file, where it is missing, truncated, corrupted, written by
    something else, of another table or schema version, or does not match its content hash.
    """
    path = Path(path)
    header, data = _read(path)
    if header["schema"] != SCHEMA_VERSION:
        raise TableError(
            f"{path}: schema version {_short(header['schema'])}, this mdkf reads version"
            f" {SCHEMA_VERSION}"
        )
    if header["table"] != expected.__name__:
        held = header["table"] if header["table"] in _TABLES else "no table of mdkf's"
        raise TableError(f"{path}: holds {held}, expected {expected.__name__}")
    try:
        table = _table_of(expected, header, data)
    except (
        *(KeyError, TypeError, ValueError, OverflowError, MemoryError),
        pl.exceptions.PolarsError,
    ) as error:
        raise TableError(f"{path}: {_one_line(error)}") from error
    if table.content_hash() != header["content_hash"]:
        raise TableError(f"{path}: content does not match its hash; the file was altered")
    return table


def read_any_table(path: str | Path) -> Table:
    """Read a table of whatever type its file says; `TableError` as `read_table`."""
    kind = _TABLES.get(str(_read(Path(path))[0]["table"]))
    if kind is None:
        raise TableError(f"{path}: expected one of the tables {', '.join(_TABLES)}")
    return read_table(path, kind)


def write_frame(data: pl.DataFrame, path: Path) -> None:
    """Write a polars frame as Parquet, whole or not at all; `OSError` names the file."""
    _write_sealed(data, path, {})


def read_frame(
    path: Path, schema: Mapping[str, pl.DataType | type[pl.DataType]]
) -> pl.DataFrame | None:
    """What `write_frame` wrote; None where there is no file, a damaged one, or something else."""
    try:
        content = path.read_bytes()
        if content != _sealed(content):
            return None
        data = pl.read_parquet(content, use_statistics=False)
    except (OSError, pl.exceptions.PolarsError, pl.exceptions.PanicException):
        return None
    return data if dict(data.schema) == dict(schema) else None


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary name beside `path` that takes its place when the block ends well.

    Whatever interrupts the block, `path` is either as it was or complete. `OSError` where the
    folder is missing or cannot be written to, or where `path` is no regular file.
    """
    if path.exists() and not path.is_file():
        raise OSError(errno.EEXIST, "is not a regular file", str(path))
    try:
        descriptor, name = tempfile.mkstemp(
            dir=path.parent, prefix=f".{path.name}.", suffix=".part"
        )
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None
    os.close(descriptor)
    temporary = Path(name)
    try:
        yield temporary
        # mkstemp makes files that only their owner reads; results are for sharing.
        temporary.chmod(0o666 & ~_umask())
        # Without these, a loss of power may leave the name with nothing, or half, behind it.
        _to_disk(temporary)
        temporary.replace(path)
        _to_disk(path.parent)
    except OSError as error:
        # Nobody knows the temporary name, and a full disk is told without any.
        if error.filename in (None, str(temporary)):
            told = f"cannot be written: {error.strerror}"
            raise OSError(error.errno, told, str(path)) from error
        raise
    finally:
        temporary.unlink(missing_ok=True)


def _write_sealed(data: pl.DataFrame, path: Path, metadata: dict[str, str]) -> None:
    """Write a frame with a seal, whole or not at all."""
    buffer = io.BytesIO()
    try:
        data.write_parquet(buffer, metadata={**metadata, f"{_KEY}.seal": _SEAL + _NO_DIGEST})
    except pl.exceptions.PolarsError as error:
        told = f"cannot be written: {_one_line(error)}"
        raise OSError(errno.EIO, told, str(path)) from error
    with replacing(path) as temporary:
        temporary.write_bytes(_sealed(buffer.getvalue()))


def _sealed(content: bytes) -> bytes:
    """The bytes of a file, its seal filled in; as they are if there is no seal in them."""
    before, seal, rest = content.rpartition(_SEAL.encode())
    if not seal:
        return content
    after = rest[len(_NO_DIGEST) :]
    digest = hashlib.sha256(before)
    digest.update(after)
    return b"".join([before, seal, digest.hexdigest().encode(), after])


def _to_disk(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _read(path: Path) -> tuple[Mapping[str, Any], pl.DataFrame]:
    if not path.is_file():
        told = "is a folder, expected a file" if path.is_dir() else "no such file"
        raise TableError(f"{path}: {told}")
    try:
        content = path.read_bytes()
    except OSError as error:
        raise TableError(f"{path}: cannot be read: {error.strerror}") from None
    if content != _sealed(content):
        raise TableError(f"{path}: content does not match its hash; the file was altered")
    try:
        header = json.loads(pl.read_parquet_metadata(path)[_KEY])
        data = pl.read_parquet(path)
    except KeyError:
        raise TableError(f"{path}: a Parquet file, but not one of mdkf's tables") from None
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError, ValueError) as error:
        raise TableError(f"{path}: not a readable Parquet file ({_one_line(error)})") from error
    if not isinstance(header, dict) or not _HEADER.keys() <= header.keys():
        raise TableError(f"{path}: mdkf's header is incomplete, expected {sorted(_HEADER)}")
    for key, types in _HEADER.items():
        if type(header[key]) not in types:
            expected = " or ".join(kind.__name__ for kind in types)
            raise TableError(
                f"{path}: {key} in mdkf's header is {_short(header[key])}, expected {expected}"
            )
    return header, data


def _table_of(kind: type[AnyTable], header: Mapping[str, Any], data: pl.DataFrame) -> AnyTable:
    return from_polars(
        kind,
        data,
        n_frames=header["n_frames"],
        dt=header["dt"],
        provenance={str(k): str(v) for k, v in header["provenance"].items()},
        diagnostics=header["diagnostics"] if kind is Tracks else None,
    )


def _short(value: object) -> str:
    return repr(value)[:40]


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())[:300] or type(error).__name__
