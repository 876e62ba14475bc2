"""Claim: whatever enters a table comes out sorted and valid, or is refused by row and column."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mdkf.tables import Detections, EgoPath, TableError, Trace, Tracks
from tests.tables import random_detections, random_trace, random_tracks


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 10**6), rows=st.integers(0, 80))
def test_row_order_does_not_matter(seed: int, rows: int) -> None:
    """Any permutation of the rows gives the same table, sorted by (frame, id)."""
    rng = np.random.default_rng(seed)
    for table in (random_trace(rng, rows), random_detections(rng, rows), random_tracks(rng, rows)):
        order = rng.permutation(rows)
        others = {"n_frames": table.n_frames, "dt": table.dt}
        if isinstance(table, Trace):
            others["ego"] = table.ego
        if diagnostics := getattr(table, "diagnostics", None):
            others["diagnostics"] = {c: a[order] for c, a in diagnostics.items()}
        fixed = {c: table.columns()[c][order] for c in table.column_types()}
        shuffled = type(table).from_columns(fixed, **others)
        assert shuffled == table
        keys = np.column_stack([table.frame, getattr(table, table.ID)])
        assert np.array_equal(keys, keys[np.lexsort(keys.T[::-1])])


def test_frames_and_objects_are_slices() -> None:
    """The frames' slices partition the rows; an object's rows are all of its rows."""
    table = random_trace(np.random.default_rng(0), 60)
    rows = [np.arange(len(table))[table.frame_rows(k)] for k in range(table.n_frames)]
    assert np.array_equal(np.concatenate(rows), np.arange(60))
    for k, of_frame in enumerate(rows):
        assert (table.frame[of_frame] == k).all()
    for identifier in table.ids():
        np.testing.assert_array_equal(
            table.rows_of(identifier), np.flatnonzero(table.object_id == identifier)
        )
    part = table.between(3, 6)
    assert set(part.frame) <= {3, 4, 5}
    assert len(part) == sum(len(rows[k]) for k in (3, 4, 5))
    with pytest.raises(IndexError, match="frame 12"):
        table.frame_rows(12)


def test_tables_cannot_be_changed() -> None:
    """Columns are read-only, so a table shared by three filters stays what it was."""
    table = random_detections(np.random.default_rng(0), 5)
    with pytest.raises(ValueError, match="read-only"):
        table.x[0] = 1.0
    with pytest.raises(AttributeError):
        table.dt = 1.0  # type: ignore[misc]


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        ("x", np.nan, r"row \d+ \(frame 3, object_id 5\): x is nan, expected finite"),
        ("yaw", np.inf, "yaw is inf"),
        ("vx", np.nan, "vx is nan"),
        ("length", 0.0, "length is 0.0, expected above 0"),
        ("frame", 12, "frame is 12"),
        ("kind", 17, "kind is 17"),
        ("regime", 9, "regime is 9"),
        ("visible", 1.1, "visible is 1.1"),
        ("object_id", -4, "object_id is -4"),
        ("object_id", 1.5, "no int64"),
    ],
)
def test_a_bad_value_is_named(column: str, value: float, message: str) -> None:
    """The error names the table, the row by frame and id, the value and what was expected."""
    table = random_trace(np.random.default_rng(4), 80)
    columns = {c: a.astype(float) for c, a in table.columns().items()}
    row = np.flatnonzero((table.frame == 3) & (table.object_id == 5))[0]
    columns["regime"][row] = 0
    columns[column][row] = value
    with pytest.raises(TableError, match=message):
        Trace.from_columns(columns, n_frames=12, dt=0.1, ego=table.ego)


def test_wrong_columns_are_named() -> None:
    """Missing, unknown and unequal columns, a repeated id, a gap in the ego path."""
    table = random_trace(np.random.default_rng(5), 20)
    columns = dict(table.columns())
    others = {"n_frames": 12, "dt": 0.1, "ego": table.ego}
    with pytest.raises(TableError, match="'vx' is missing"):
        Trace.from_columns({c: a for c, a in columns.items() if c != "vx"}, **others)
    with pytest.raises(TableError, match="unknown column 'speed'"):
        Trace.from_columns(columns | {"speed": columns["x"]}, **others)
    with pytest.raises(TableError, match="differ in length"):
        Trace.from_columns(columns | {"x": columns["x"][1:]}, **others)
    with pytest.raises(TableError, match="expected numbers"):
        Trace.from_columns(columns | {"x": np.array(["a"] * 20)}, **others)
    twice = {c: np.repeat(a[:1], 2) for c, a in columns.items()}
    with pytest.raises(TableError, match="at most once in a frame"):
        Trace.from_columns(twice, **others)
    ego = {c: a[1:] for c, a in table.ego.columns().items()}
    with pytest.raises(TableError, match="one row in each"):
        EgoPath.from_columns(ego, n_frames=12, dt=0.1)


def test_what_would_change_a_value_is_refused() -> None:
    """Counts and times of other types, ragged and masked columns, whole numbers that no float is,
    diagnostics of another length; equal numbers of other types give equal tables."""
    table = random_detections(np.random.default_rng(7), 20)
    columns = dict(table.columns())
    made = {"n_frames": 12, "dt": 1}
    for n_frames in ("12", None, 12.0, 2.5):
        with pytest.raises(TableError, match=r"n_frames is .*, expected a whole number"):
            Detections.from_columns(columns, n_frames=n_frames, dt=0.1)  # type: ignore[arg-type]
    for dt in ("0.1", None, [0.1]):
        with pytest.raises(TableError, match=r"dt is .*, expected a number of seconds"):
            Detections.from_columns(columns, n_frames=12, dt=dt)  # type: ignore[arg-type]
    with pytest.raises(TableError, match="provenance is NoneType, expected texts"):
        Detections.from_columns(columns, provenance=None, **made)
    x: object
    for x, message in (
        ([[1.0], [1.0, 2.0]], "'x' is no array"),
        (np.ma.masked_greater(columns["x"], 0.0), "'x' has masked values"),
        (np.full(20, 2**53 + 1), "'x' holds values that are no float64"),
    ):
        with pytest.raises(TableError, match=message):
            Detections.from_columns(columns | {"x": x}, **made)
    same = Detections.from_columns(columns, n_frames=np.int64(12), dt=np.float32(1.0))
    assert same.content_hash() == Detections.from_columns(columns, **made).content_hash()
    tracks = random_tracks(np.random.default_rng(8), 20)
    with pytest.raises(TableError, match=r"differ in length.*nis 3"):
        Tracks.from_columns(
            {name: getattr(tracks, name) for name in Tracks.column_types()},
            **made,
            diagnostics={"nis": np.ones(3)},
        )


def test_clutter_may_repeat_in_a_frame() -> None:
    """Several false boxes share the source -1."""
    table = random_detections(np.random.default_rng(6), 2)
    columns = {c: np.repeat(a[:1], 2) for c, a in table.columns().items()}
    columns["source"] = np.array([-1, -1])
    assert len(Detections.from_columns(columns, n_frames=12, dt=0.1)) == 2
