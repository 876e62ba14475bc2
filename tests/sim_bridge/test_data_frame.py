"""Claim: a table survives polars unchanged, and a frame that is no table gives one clear error."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mdkf
from mdkf.tables import KINDS, Detections, EgoPath, Table, TableError, Trace, Tracks
from sim_bridge import from_polars, to_polars, write_table
from tests.tables import random_detections, random_trace, random_tracks

MAKERS: dict[type[Table], Callable[..., Table]] = {
    Trace: random_trace,
    EgoPath: lambda rng, rows: random_trace(rng, rows).ego,
    Detections: random_detections,
    Tracks: random_tracks,
}


@pytest.mark.parametrize("kind", MAKERS)
@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10**6), rows=st.integers(0, 60))
def test_there_and_back_is_identity(kind: type[Table], seed: int, rows: int) -> None:
    """Content hash and provenance come back, whatever the order of the rows; so do empty tables."""
    table = MAKERS[kind](np.random.default_rng(seed), rows)
    data = to_polars(table)
    assert len(data) == len(table)
    again = from_polars(kind, data.sample(fraction=1.0, shuffle=True, seed=seed), like=table)
    assert again.content_hash() == table.content_hash()
    assert again.provenance == table.provenance


def test_a_frame_shows_names_and_the_numbers_of_the_columns() -> None:
    """Kinds are texts by the trace's own codes; numbers are the columns', to the bit."""
    trace = random_trace(np.random.default_rng(1), 40)
    data = to_polars(trace)
    assert data["kind"].to_list() == [KINDS[code] for code in trace.kind]
    assert data.schema["turning"] == pl.Boolean
    assert data["jx"].to_numpy().tobytes() == trace.jx.tobytes()


def test_the_frame_of_a_trace_file_is_a_trace(tmp_path: Path) -> None:
    """Any Parquet reader's rows of a file carry the ego path, and win over another's."""
    trace = random_trace(np.random.default_rng(2), 30)
    write_table(trace, path := tmp_path / "trace.parquet")
    data = pl.read_parquet(path)
    assert data.equals(to_polars(trace, ego=True))
    assert from_polars(Trace, data, n_frames=12, dt=0.1) == trace
    assert from_polars(Trace, data, like=random_trace(np.random.default_rng(3), 5)) == trace
    without = (pl.col("kind") == "ego") & (pl.col("frame") == 4)
    with pytest.raises(TableError, match="EgoPath: expected one row in each of the 12 frames"):
        from_polars(Trace, data.filter(~without), n_frames=12, dt=0.1)


def test_types_of_polars_that_hold_the_same_are_taken() -> None:
    """Enumerations and categories as texts, small integers, shorter floats that are exact."""
    trace = random_trace(np.random.default_rng(4), 20)
    data = to_polars(trace).with_columns(
        pl.col("kind").cast(pl.Enum(KINDS)),
        pl.col("regime").cast(pl.Categorical),
        pl.col("frame").cast(pl.Int8),
    )
    assert from_polars(Trace, data, like=trace) == trace


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (pl.lit("lorry").alias("kind"), r"Trace: row 0: column 'kind' holds 'lorry', expected"),
        (pl.lit(None, pl.String).alias("regime"), r"row 0: column 'regime' holds None, expected"),
        (pl.lit(3).alias("kind"), r"row 0: column 'kind' holds 3, expected one of"),
        (
            pl.when(pl.int_range(pl.len()) != 7).then("frame").alias("frame"),
            r"Trace: row 7: column 'frame' is null, expected a value",
        ),
        (
            pl.when(pl.int_range(pl.len()) != 7).then("turning").alias("turning"),
            r"Trace: row 7: column 'turning' is null, expected a value",
        ),
        (
            (pl.col("frame") + (pl.int_range(pl.len()) == 5) * 0.5).alias("frame"),
            r"Trace: row 5: column 'frame' holds values that are no int64",
        ),
        (pl.lit("far").alias("x"), r"column 'x' holds .*, expected numbers"),
        (pl.concat_list("x", "y").alias("x"), r"column 'x' holds .*, expected numbers"),
        (pl.lit(None, pl.Float64).alias("y"), r"Trace: row 0 \(frame .*\): y is nan, expected"),
        (pl.lit(-1.0).alias("length"), r"Trace: row 0 \(frame .*\): length is -1.0, expected"),
        (pl.lit(0.0).alias("speed"), r"Trace: unknown column 'speed'; expected"),
    ],
)
def test_what_an_edit_broke_is_named(change: pl.Expr, message: str) -> None:
    """The error names the column, and the row where one row is wrong."""
    trace = random_trace(np.random.default_rng(5), 20)
    with pytest.raises(TableError, match=message):
        from_polars(Trace, to_polars(trace).with_columns(change), like=trace)


def test_what_is_missing_is_named() -> None:
    """A column, the number of frames, the ego path, another thing than a frame."""
    trace = random_trace(np.random.default_rng(6), 20)
    data = to_polars(trace)
    with pytest.raises(TableError, match="'yaw' is missing"):
        from_polars(Trace, data.drop("yaw"), like=trace)
    with pytest.raises(TableError, match="Trace: n_frames is missing"):
        from_polars(Trace, data, dt=0.1)
    with pytest.raises(TableError, match="Trace: ego is missing"):
        from_polars(Trace, data, n_frames=12, dt=0.1)
    with pytest.raises(TableError, match="LazyFrame, expected a polars DataFrame"):
        from_polars(Trace, data.lazy(), like=trace)  # type: ignore[arg-type]


def test_further_columns_of_tracks_are_diagnostics() -> None:
    """By name where names are given; null, where an estimator has no value."""
    tracks = random_tracks(np.random.default_rng(7), 10)
    data = to_polars(tracks).with_columns(nis=pl.lit(None, pl.Float64))
    assert list(from_polars(Tracks, data, like=tracks).diagnostics) == [*tracks.diagnostics, "nis"]
    with pytest.raises(TableError, match="unknown column 'nis'"):
        from_polars(Tracks, data, like=tracks, diagnostics=list(tracks.diagnostics))


def test_estimates_become_a_row_for_each_frame_and_track() -> None:
    """The numbers stand where frame and track say."""
    seen = np.random.default_rng(8).normal(0, 1, (7, 3, 2)).cumsum(axis=0)
    told = mdkf.filter_sequence(mdkf.estimator("ca"), seen, 0.01 * np.eye(2), 0.1)
    data = to_polars(told)
    assert len(data) == 21
    row = data.row(by_predicate=(pl.col("frame") == 5) & (pl.col("track") == 2), named=True)
    assert (row["x"], row["y"]) == tuple(told.position[5, 2])
    assert (row["vx"], row["vy"]) == tuple(told.velocity[5, 2])
    assert (row["cov_xx"], row["cov_xy"], row["cov_yy"]) == tuple(
        told.covariance[5, 2].ravel()[[0, 1, 3]]
    )
