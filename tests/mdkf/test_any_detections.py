"""Claim: any detections are refused in one line, or tracked and all numbers stay finite."""

import math
from typing import Any

import numpy as np
import pytest

from mdkf import ESTIMATORS, Detections, TableError, Tracker, Tracks
from tests.mdkf.scenes import BUILT_IN

N_FRAMES = 6
NUMBERS = "biuf"
VALUES = (0.0, -0.0, 1.0, -1.0, -2.0, 3.0, 5.0, 6.0, 0.5, 255.0, 1e9, -1e9, 2.0**53, 2.0**63, 1e308)
VALUES += (5e-324, 1e-9, math.nan, math.inf, -math.inf)
TYPES = ("f8", "f8", "f8", "f4", "f2", ">f8", "i8", "i8", "i4", "i1", "u8", "u1", "?")
STRANGE_TYPES = ("O", "U8", "S8", "c16", "M8[s]", "m8[s]")


def sound_columns(rng: np.random.Generator) -> dict[str, Any]:
    """Columns of a few boxes of distinct objects, the first of them clutter."""
    n = int(rng.integers(1, 9))
    columns: dict[str, Any] = {name: rng.normal(0, 50, n) for name in ("x", "y", "z", "yaw")}
    columns |= {name: rng.uniform(0.5, 9, n) for name in ("length", "width", "height", "score")}
    return columns | {"frame": rng.integers(0, N_FRAMES, n), "source": np.arange(-1, n - 1)}


def spoilt(rng: np.random.Generator, column: np.ndarray) -> Any:
    """A column with strange values, or of a strange type or shape."""
    values = column.astype(float)
    some = rng.random(len(values)) < rng.choice([0.2, 1.0])
    values[some] = rng.choice(VALUES, some.sum())
    match rng.integers(12):
        case 0:
            return values[: rng.integers(len(values))]
        case 1:
            return np.append(values, 1.0)
        case 2:
            return values[:, None]
        case 3:
            return values[0]
    kind = rng.choice(STRANGE_TYPES if rng.random() < 0.1 else TYPES)
    with np.errstate(invalid="ignore", over="ignore"):
        given = values.astype(kind)
    return given.tolist() if rng.random() < 0.2 else given


def is_sound(columns: dict[str, Any]) -> bool:
    """Whether columns are those of a table of detections, value by value."""
    if any(np.ndim(column) != 1 for column in columns.values()):
        return False
    if any(np.asarray(column).dtype.kind not in NUMBERS for column in columns.values()):
        return False
    if len({len(column) for column in columns.values()}) != 1:
        return False
    values = {name: np.asarray(column).tolist() for name, column in columns.items()}
    whole = {"frame": (0, N_FRAMES - 1), "source": (-1, 2**63 - 1)}
    for name, column in values.items():
        if not all(math.isfinite(value) for value in column):
            return False
        if name in whole:
            low, high = whole[name]
            if not all(value == int(value) and low <= value <= high for value in column):
                return False
        # Whole numbers that no float is would come out as others.
        if name not in whole and not all(
            value == int(float(value)) for value in column if isinstance(value, int)
        ):
            return False
        if name in ("length", "width", "height") and not all(value > 0 for value in column):
            return False
    objects = [
        pair for pair in zip(values["frame"], values["source"], strict=True) if pair[1] != -1
    ]
    return len(set(objects)) == len(objects)


def test_columns_are_a_table_or_refused() -> None:
    """6000 times one or two columns are spoilt: a table has the values that were given, in order of
    frames and sources; an error is one line and names the table and a column."""
    rng, taken = np.random.default_rng(0), 0
    for _ in range(6000):
        columns = sound_columns(rng)
        names = rng.choice(list(columns), rng.integers(1, 3), replace=False).tolist()
        columns |= {name: spoilt(rng, columns[name]) for name in names}
        if not is_sound(columns):
            with pytest.raises(TableError) as raised:
                Detections.from_columns(columns, n_frames=N_FRAMES, dt=0.1)
            message = str(raised.value)
            assert message.startswith("Detections: ")
            assert message.isprintable()
            assert len(message) < 400
            assert any(name in message for name in names)
            continue
        taken += 1
        table = Detections.from_columns(columns, n_frames=N_FRAMES, dt=0.1)
        given = {name: np.asarray(column).tolist() for name, column in columns.items()}
        rows = zip(*(given[name] for name in table.columns()), strict=True)
        stored = zip(*(column.tolist() for column in table.columns().values()), strict=True)
        keys = list(zip(table.frame.tolist(), table.source.tolist(), strict=True))
        assert sorted(tuple(map(float, row)) for row in rows) == sorted(stored)
        assert keys == sorted(keys)
    assert taken > 1000


# --- into the tracker -------------------------------------------------------------------------

SCALES = (1e-9, 1.0, 50.0, 1e6, 1e9)  # m
STEPS = (1e-3, 1e-2, 0.1, 1.0, 10.0)  # s
SIZES = (5e-324, 1e-9, 4.5, 1e9)  # m
YAWS = (0.0, np.pi, -np.pi, 1e-300, 1e9, -1e9)  # rad
SCORES = (-1e9, -1.0, 0.0, 1e-300, 0.5, 1.0, 10.0, 1e9)
OPTIONS: tuple[dict[str, Any], ...] = (
    {},
    {"confirmation": "online"},
    {"position": "measurement", "coasting": False},
    {"validity": -1e12, "score": -1e12, "confirmed_score": -1e12},
    {"validity": -1e12, "score": -1e12, "confirmed_score": -1e12, "max_variance": 1e12},
    {"gate": 1e10, "max_variance": 1e9, "max_missed": 3},
)


def extreme(rng: np.random.Generator) -> Detections:
    """Up to 30 boxes a frame: near and far, moving or at the same places, all at one place, on a
    grid with many at the same distance, or all in one frame."""
    n_frames, n = int(rng.integers(1, 40)), int(rng.choice([0, 1, 5, 30]))
    rows, scale = n * n_frames, float(rng.choice(SCALES))
    frame = np.repeat(np.arange(n_frames), n)
    place = rng.normal(0.0, scale, (rows, 2))
    match rng.integers(5):
        case 0:
            standing = rng.normal(0.0, scale, (n, 2))
            place = np.tile(standing, (n_frames, 1)) + rng.normal(0.0, 0.3, (rows, 2))
        case 1:
            place[:] = rng.normal(0.0, scale, 2)
        case 2:
            place = np.round(place / scale) * scale
        case 3:
            frame = np.full(rows, rng.integers(n_frames))
        case _:
            frame = np.sort(rng.integers(0, n_frames, rows))
    columns = {"frame": frame, "x": place[:, 0], "y": place[:, 1], "source": np.full(rows, -1)}
    columns |= {"z": rng.normal(0.0, scale, rows), "yaw": rng.choice(YAWS, rows)}
    columns |= {name: rng.choice(SIZES, rows) for name in ("length", "width", "height")}
    columns["score"] = rng.choice(SCORES, rows, p=rng.dirichlet(np.ones(len(SCORES))))
    return Detections.from_columns(columns, n_frames=n_frames, dt=float(rng.choice(STEPS)))


def assert_sound(tracks: Tracks, detections: Detections) -> None:
    """Numbers are finite, covariances positive, tracks without a break and no more of them than
    there are detections."""
    tracks.validate()
    for name in tracks.column_types():
        assert np.isfinite(getattr(tracks, name)).all(), name
    determinant = tracks.cov_xx * tracks.cov_yy - tracks.cov_xy**2
    assert ((tracks.cov_xx > 0) & (tracks.cov_yy > 0) & (determinant > 0)).all()
    assert len(tracks.ids()) <= len(detections)
    measured = np.bincount(tracks.frame[~tracks.coasted], minlength=tracks.n_frames)
    assert (measured <= np.diff(detections.frame_start)).all()


@pytest.mark.parametrize("name", BUILT_IN)
def test_extreme_detections_are_tracked(name: str) -> None:
    """60 recordings of the strangest detections that are allowed, under any settings: no error and
    no NaN."""
    rng, rows = np.random.default_rng(1), 0
    for _ in range(60):
        detections = extreme(rng)
        settings = rng.choice(["pointrcnn", "second", "ctrl-waymo"])
        tracker = Tracker(ESTIMATORS[name], str(settings), **rng.choice(OPTIONS))
        tracks = tracker.run(detections)
        assert_sound(tracks, detections)
        rows += len(tracks)
    assert rows > 10_000


@pytest.mark.parametrize("name", BUILT_IN)
@pytest.mark.parametrize("score", [1e9, -1e9])
def test_a_thousand_boxes_at_one_place(name: str, score: float) -> None:
    """Each is a track of its own as long as it is seen, or none is: it depends on the score."""
    n, n_frames = 1000, 4
    columns = {column: np.full(n * n_frames, 4.5) for column in Detections.column_types()}
    columns |= {"frame": np.repeat(np.arange(n_frames), n), "source": np.full(n * n_frames, -1)}
    columns["score"] = np.full(n * n_frames, score)
    detections = Detections.from_columns(columns, n_frames=n_frames, dt=0.1)
    tracks = Tracker(ESTIMATORS[name]).run(detections)
    assert_sound(tracks, detections)
    assert len(tracks) == (n * n_frames if score > 0 else 0)
    np.testing.assert_allclose(np.column_stack([tracks.x, tracks.y]), 4.5, rtol=0, atol=1e-9)
