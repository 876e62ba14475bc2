"""Claim: a table survives its file unchanged, and a bad file gives one clear error."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mdkf.tables import Detections, Table, TableError, Trace, Tracks
from sim_bridge.parquet import read_table, replacing, write_table
from tests.tables import random_detections, random_trace, random_tracks

MAKERS = {Trace: random_trace, Detections: random_detections, Tracks: random_tracks}


@pytest.mark.parametrize("kind", MAKERS)
@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6), rows=st.integers(0, 60))
def test_round_trip_is_identity(
    tmp_path_factory: pytest.TempPathFactory, kind: type[Table], seed: int, rows: int
) -> None:
    """Every value, the frame count and the provenance come back; so do empty tables."""
    path = tmp_path_factory.mktemp("parquet") / "table.parquet"
    table = MAKERS[kind](np.random.default_rng(seed), rows)
    write_table(table, path)
    again = read_table(path, kind)
    assert again == table
    assert again.provenance == table.provenance
    for name, column in table.columns().items():
        np.testing.assert_array_equal(again.columns()[name], column)
    write_table(again, second := path.with_name("second.parquet"))
    assert second.read_bytes() == path.read_bytes()


@pytest.mark.parametrize("kind", MAKERS)
def test_truncated_files_are_refused(tmp_path: Path, kind: type[Table]) -> None:
    """At whatever byte the file ends, the error is ours and names the file."""
    path = tmp_path / "table.parquet"
    write_table(MAKERS[kind](np.random.default_rng(1), 40), path)
    whole = path.read_bytes()
    for length in np.linspace(0, len(whole) - 1, 40).astype(int):
        path.write_bytes(whole[:length])
        with pytest.raises(TableError, match=r"table\.parquet: "):
            read_table(path, kind)


def test_altered_bytes_never_pass_as_other_values(tmp_path: Path) -> None:
    """A flipped byte is either refused or, where it carries no value, harmless."""
    path = tmp_path / "table.parquet"
    table = random_detections(np.random.default_rng(2), 40)
    write_table(table, path)
    whole = bytearray(path.read_bytes())
    rng = np.random.default_rng(3)
    refused = 0
    for place in rng.integers(0, len(whole), 150):
        altered = whole.copy()
        altered[place] ^= 0xFF
        path.write_bytes(altered)
        try:
            assert read_table(path, Detections) == table
        except TableError:
            refused += 1
    assert refused > 75


def test_foreign_files_are_refused(tmp_path: Path) -> None:
    """Missing, text, foreign Parquet, another table, another version: each says what it is."""
    with pytest.raises(TableError, match="no such file"):
        read_table(tmp_path / "missing.parquet", Trace)
    text = tmp_path / "text.parquet"
    text.write_text("frame,x\n0,1\n")
    with pytest.raises(TableError, match="not a readable Parquet file"):
        read_table(text, Trace)
    foreign = tmp_path / "foreign.parquet"
    pl.DataFrame({"frame": [0]}).write_parquet(foreign)
    with pytest.raises(TableError, match="not one of mdkf's tables"):
        read_table(foreign, Trace)
    other = tmp_path / "other.parquet"
    write_table(random_detections(np.random.default_rng(0), 3), other)
    with pytest.raises(TableError, match="holds Detections, expected Trace"):
        read_table(other, Trace)
    metadata = pl.read_parquet_metadata(other)["mdkf"].replace('"schema": 1', '"schema": 99')
    pl.read_parquet(other).write_parquet(other, metadata={"mdkf": metadata})
    with pytest.raises(TableError, match="schema version 99"):
        read_table(other, Detections)


def test_a_value_changed_behind_our_back_is_noticed(tmp_path: Path) -> None:
    """Rewriting one number with another tool breaks the content hash."""
    path = tmp_path / "table.parquet"
    write_table(random_detections(np.random.default_rng(0), 3), path)
    metadata = {"mdkf": pl.read_parquet_metadata(path)["mdkf"]}
    pl.read_parquet(path).with_columns(pl.col("x") + 1e-9).write_parquet(path, metadata=metadata)
    with pytest.raises(TableError, match="does not match its hash"):
        read_table(path, Detections)


def test_an_interrupted_write_leaves_the_old_file(tmp_path: Path) -> None:
    """Whatever stops the writer, the old file stays and no temporary one does."""
    path = tmp_path / "table.parquet"
    path.write_text("old")

    def interrupted() -> None:
        with replacing(path) as temporary:
            temporary.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
