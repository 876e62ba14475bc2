"""Claim: whatever happens to a table's file, it is refused in one line or the table as it was."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import polars as pl
import pytest

from mdkf.tables import Detections, Table, TableError, Trace, Tracks
from sim_bridge.parquet import read_table, write_table
from tests.tables import random_detections, random_trace, random_tracks

MAKERS: dict[type[Table], Callable[..., Table]] = {
    Trace: random_trace,
    Detections: random_detections,
    Tracks: random_tracks,
}
every_table = pytest.mark.parametrize("kind", MAKERS)


def table_of(kind: type[Table]) -> Table:
    """A small table that says where it comes from."""
    table = MAKERS[kind](np.random.default_rng(4), 40)
    return dataclasses.replace(table, provenance={"scenario": "random", "seed": "4"})


def read(path: Path, kind: type[Table]) -> Table | None:
    """The table; None where it is refused by one line that begins with the file."""
    try:
        return read_table(path, kind)
    except TableError as error:
        message = str(error)
    assert message.startswith(f"{path}: ")
    assert message.isprintable()
    assert len(message) < len(str(path)) + 400
    return None


def assert_refused_or_the_same(path: Path, table: Table) -> bool:
    """Whether it is refused."""
    again = read(path, type(table))
    assert again is None or (again, again.provenance) == (table, table.provenance)
    return again is None


def damaged(rng: Random, whole: bytes) -> bytes:
    """The bytes of a file after something happened to them; half of the time to its last ones,
    where Parquet says what is where."""
    content = bytearray(whole)
    at = rng.randrange(len(content))
    if rng.random() < 0.5:
        at = rng.randrange(len(content) - 3000, len(content))
    some = slice(at, at + rng.choice((1, 2, 8, 100)))
    match rng.randrange(7):
        case 0:
            content[at] ^= 1 << rng.randrange(8)
        case 1:
            content[at] = rng.randrange(256)
        case 2:
            del content[some]
        case 3:
            content[at:at] = rng.randbytes(rng.choice((1, 4, 100)))
        case 4:
            content[some] = bytes(len(content[some]))
        case 5:
            content[at:at] = content[some]
        case _:
            del content[at:]
    return bytes(content)


@every_table
def test_damage_is_noticed(
    tmp_path: Path, kind: type[Table], capfd: pytest.CaptureFixture[str]
) -> None:
    """1500 times for each table, provenance included; and nothing is told but the error."""
    rng, path, table = Random(kind.__name__), tmp_path / "table.parquet", table_of(kind)
    write_table(table, path)
    whole, refused, same = path.read_bytes(), 0, 0
    for _ in range(1500):
        content = damaged(rng, whole)
        path.write_bytes(content)
        refused += assert_refused_or_the_same(path, table)
        same += content == whole
    assert refused > 1450 - same
    assert capfd.readouterr() == ("", "")


def rewritten(path: Path, header: dict[str, Any], data: pl.DataFrame) -> None:
    """What another program makes of a table: without the seal."""
    data.write_parquet(path, metadata={"mdkf": json.dumps(header)})


@every_table
def test_damage_to_what_others_have_written_changes_no_value(
    tmp_path: Path, kind: type[Table]
) -> None:
    """300 times for each table; the content hash tells what has no seal."""
    rng, path, table = Random(kind.__name__), tmp_path / "table.parquet", table_of(kind)
    write_table(table, path)
    header = json.loads(pl.read_parquet_metadata(path)["mdkf"])
    rewritten(path, header, pl.read_parquet(path))
    assert not assert_refused_or_the_same(path, table)
    whole, refused = path.read_bytes(), 0
    for _ in range(300):
        path.write_bytes(damaged(rng, whole))
        again = read(path, kind)
        assert again is None or again == table
        refused += again is None
    assert refused > 200


STRANGE = (
    *(None, True, -1, 0, 3.7, 1e300, 10**17, 10**19, 10**400, float("inf"), float("nan")),
    *("12", "Trace", "", "\n", "\x00", "x" * 1000, [], {}, [1], {"a": 1}, ["vx", "vx"]),
)


@every_table
@pytest.mark.parametrize("key", ["table", "schema", "n_frames", "dt", "content_hash"])
def test_strange_headers_are_refused(tmp_path: Path, kind: type[Table], key: str) -> None:
    """Whatever the header says of the table, it is what the table is, or refused."""
    path, table = tmp_path / "table.parquet", table_of(kind)
    write_table(table, path)
    header, data = json.loads(pl.read_parquet_metadata(path)["mdkf"]), pl.read_parquet(path)
    for value in STRANGE:
        rewritten(path, header | {key: value}, data)
        assert assert_refused_or_the_same(path, table) or value == header[key]
    rewritten(path, {name: value for name, value in header.items() if name != key}, data)
    with pytest.raises(TableError, match="header is incomplete"):
        read_table(path, kind)


def strange_columns(column: pl.Series) -> list[pl.Series]:
    """A column of other types, of other values, or of another name."""
    name, n = column.name, len(column)
    values: list[Any] = [None, [1], {"a": 1}, b"a", True, "x", "", 7, 0.5, 1e18, float("nan")]
    same: list[pl.Series] = [
        *(pl.Series(name, [value] * n) for value in values),
        pl.Series(name, [2**64 - 1] * n, dtype=pl.UInt64),
        pl.Series(name, np.zeros(n, dtype="datetime64[us]")),
        pl.Series(name, np.zeros((n, 2))),
        column.reverse(),
        column.cast(pl.String),
    ]
    return [*same, column.rename(f"{name}_")]


@every_table
def test_strange_columns_are_refused(tmp_path: Path, kind: type[Table]) -> None:
    """Every column in turn: missing, of another type, or with other values."""
    path, table = tmp_path / "table.parquet", table_of(kind)
    write_table(table, path)
    header, data = json.loads(pl.read_parquet_metadata(path)["mdkf"]), pl.read_parquet(path)
    for name in data.columns:
        for column in strange_columns(data[name]):
            rewritten(path, header, data.drop(name).with_columns(column))
            assert assert_refused_or_the_same(path, table) or data[name].equals(column)


@every_table
def test_a_whole_number_of_seconds_between_frames(tmp_path: Path, kind: type[Table]) -> None:
    """dt = 1 comes back as dt = 1.0 does."""
    path = tmp_path / "table.parquet"
    for dt in (1, 1.0):
        table = dataclasses.replace(table_of(kind), dt=dt)
        if isinstance(table, Trace):
            table = dataclasses.replace(table, ego=dataclasses.replace(table.ego, dt=dt))
        write_table(table, path)
        assert not assert_refused_or_the_same(path, table)
