"""Tables to polars data frames and back, exactly.

A row is a row, a column a column; codes stand as their names. What a frame has no place for (the
number of frames, their time, provenance, a trace's ego path) `from_polars` is told again, most
simply by the table that the frame came from.
"""

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
import polars as pl

from mdkf.sequence import Estimates
from mdkf.tables import EgoPath, Table, TableError, Trace, Tracks

EGO = "ego"
"""The kind of the rows in which a trace's ego path may stand: object -1, derivatives null."""

_EGO_COLUMNS = ("frame", "x", "y", "z", "yaw")

AnyTable = TypeVar("AnyTable", bound=Table)


def to_polars(table: Table | Estimates, *, ego: bool = False) -> pl.DataFrame:
    """The rows of a table, or of `mdkf.filter_sequence`'s estimates, in their order.

    Kinds and regimes are texts; a track table's diagnostics are columns like the others. The frame
    has the rows alone: keep the table for `from_polars(..., like=table)`. ego: a trace's sensor
    path as further rows of kind `ego`, as its Parquet file has them; without it see
    `to_polars(trace.ego)`. Estimates become a row for each frame and track: frame, track, x, y [m],
    vx, vy [m/s], cov_xx, cov_xy, cov_yy [m2].
    """
    if isinstance(table, Estimates):
        return _of_estimates(table)
    data = pl.DataFrame(
        {name: _named(table, name, array) for name, array in table.columns().items()}
    )
    if ego and isinstance(table, Trace):
        path = to_polars(table.ego).with_columns(
            pl.lit(EGO).alias("kind"), pl.lit(-1, dtype=pl.Int64).alias("object_id")
        )
        data = pl.concat([data, path], how="diagonal")
    return data


def from_polars(
    kind: type[AnyTable],
    data: pl.DataFrame,
    *,
    like: Table | None = None,
    n_frames: int | None = None,
    dt: float | None = None,
    provenance: Mapping[str, str] | None = None,
    ego: EgoPath | None = None,
    diagnostics: Sequence[str] | None = None,
) -> AnyTable:
    """A validated table of a frame's rows, in any order: `from_polars(Trace, data, like=trace)`.

    like: a table whose n_frames, dt, provenance and ego path are taken where they are not given;
    without it, n_frames and dt [s] must be. ego: a trace's sensor path, which may also stand in the
    frame, as rows of kind `ego`. diagnostics: a track table's further columns, all that are not its
    own if None. Null and NaN are no value.

    Raises `TableError`, naming column and row, for what the table cannot hold.
    """
    name = kind.__name__
    if not isinstance(data, pl.DataFrame):
        raise TableError(f"{name}: {type(data).__name__}, expected a polars DataFrame")
    given: dict[str, Any] = {"n_frames": n_frames, "dt": dt, "provenance": provenance}
    for key, value in given.items():
        if value is None:
            given[key] = {} if like is None and key == "provenance" else getattr(like, key, None)
        if given[key] is None:
            raise TableError(f"{name}: {key} is missing, expected it or a table in `like`")
    others: dict[str, Any] = {}
    if kind is Trace:
        data, others["ego"] = _ego(data, ego or getattr(like, "ego", None), given)
    if kind is Tracks:
        own = Tracks.column_types()
        names = [c for c in data.columns if c not in own] if diagnostics is None else diagnostics
        others["diagnostics"] = {c: _array(kind, data[c]) for c in names}
        data = data.drop(names)
    return kind.from_columns({c.name: _array(kind, c) for c in data}, **given, **others)


def _of_estimates(estimates: Estimates) -> pl.DataFrame:
    frames, tracks, _ = estimates.position.shape
    frame, track = np.divmod(np.arange(frames * tracks), max(tracks, 1))
    position, velocity = (a.reshape(-1, 2) for a in (estimates.position, estimates.velocity))
    covariance = estimates.covariance.reshape(-1, 4)
    columns = {"frame": frame, "track": track, "x": position[:, 0], "y": position[:, 1]}
    columns |= {"vx": velocity[:, 0], "vy": velocity[:, 1]}
    columns |= {"cov_xx": covariance[:, 0], "cov_xy": covariance[:, 1], "cov_yy": covariance[:, 3]}
    return pl.DataFrame(columns)


def _named(table: Table, column: str, array: Any) -> pl.Series:
    """A column of a table, codes as their names."""
    names = table.CODED.get(column)
    if names is None:
        return pl.Series(column, array)
    return pl.Series(column, np.array(names, dtype=np.str_)[array]).cast(pl.String)


def _ego(
    data: pl.DataFrame, ego: EgoPath | None, given: Mapping[str, Any]
) -> tuple[pl.DataFrame, EgoPath]:
    """The rows of objects, and the ego path: that of the frame's own rows, else the given one."""
    if data.schema.get("kind") == pl.String:
        own = data.filter(pl.col("kind") == EGO)
        if len(own) or (ego is None and given["n_frames"] == 0):
            data = data.filter(pl.col("kind").ne_missing(EGO))
            columns = {c: _array(EgoPath, own[c]) for c in _EGO_COLUMNS if c in own.columns}
            ego = EgoPath.from_columns(columns, **given)
    if ego is None:
        raise TableError(f"Trace: ego is missing, expected it, rows of kind {EGO!r}, or `like`")
    return data, ego


def _array(kind: type[Table], column: pl.Series) -> Any:
    """A column's values as the table's constructor takes them."""
    table, name = kind.__name__, column.name
    if names := kind.CODED.get(name):
        codes = {text: code for code, text in enumerate(names)}
        if column.dtype in (pl.Categorical, pl.Enum):
            column = column.cast(pl.String)
        if strange := sorted(set(column.unique()) - codes.keys(), key=str):
            row = column.to_list().index(strange[0])
            raise TableError(
                f"{table}: row {row}: column {name!r} holds {strange[0]!r}, expected one of {names}"
            )
        return column.replace_strict(codes, return_dtype=pl.UInt8).to_numpy()
    whole = kind.column_types().get(name, np.dtype(np.float64)).kind != "f"
    if whole and column.null_count():
        row = int(column.is_null().arg_max() or 0)
        raise TableError(f"{table}: row {row}: column {name!r} is null, expected a value")
    try:
        return column.to_numpy()
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException) as error:
        raise TableError(f"{table}: column {name!r} holds {column.dtype}: {error}") from None
