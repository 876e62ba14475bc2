"""Claim: errors around a gap are the followed track's distances from its object, frame by frame."""

from collections.abc import Callable, Sequence

import numpy as np
import polars as pl
import pytest

from experiments.phases import WINDOW, gap_errors
from mdkf.tables import REGIMES, Trace
from tests.tables import gaps_of, trace_of, tracks_of

N = 60
OBJECT, TRACK = 3, 8
START, STOP = 20, 30
GAP = gaps_of((OBJECT, START, STOP))
FRAMES = range(N)


def truth(frame: int) -> tuple[float, float]:
    """The object drives at 5 m/s past the sensor."""
    return 0.5 * frame, 4.0


def trace(frames: Sequence[int] = FRAMES) -> Trace:
    return trace_of([(k, OBJECT, *truth(k)) for k in frames], N)


def errors_of(
    offset: Callable[[int], tuple[float, float]],
    frames: Sequence[int] = FRAMES,
    detected: Callable[[int], bool] = lambda k: not START <= k < STOP,
) -> pl.DataFrame:
    """Errors of one track with an offset [m] from the truth in each frame."""
    rows = [(k, TRACK, *np.add(truth(k), offset(k))) for k in frames]
    tracks = tracks_of(rows, N, coasted=[not detected(k) for k in frames])
    return gap_errors(trace(), tracks, GAP)


def test_a_constant_offset_is_the_error_in_every_frame_and_phase() -> None:
    """3-4-5: an offset of (0.3, -0.4) m is 0.5 m, from ten frames before to ten after."""
    errors = errors_of(lambda k: (0.3, -0.4))
    np.testing.assert_allclose(errors["error"], 0.5, rtol=0, atol=1e-12)
    assert errors["frame"].to_list() == list(range(START - WINDOW, STOP + WINDOW))
    assert errors["offset"].to_list() == list(range(-WINDOW, STOP - START + WINDOW))
    phases = ["before"] * WINDOW + ["gap"] * (STOP - START) + ["after"] * WINDOW
    assert errors["phase"].to_list() == phases
    for column, value in (("object_id", OBJECT), ("track_id", TRACK), ("gap_start", START)):
        assert errors[column].unique().to_list() == [value]
    assert errors["gap_stop"].unique().to_list() == [STOP]
    assert errors["captured"].unique().to_list() == [False]
    assert errors["recovered"].unique().to_list() == [True]


def test_a_linear_drift_is_the_known_error_in_each_frame() -> None:
    """2 m/s too fast in the gap: 0.2 m in its first frame, 2 m in its last, mean 1.1 m."""
    errors = errors_of(lambda k: (0.2 * max(min(k, STOP - 1) - START + 1, 0), 0.0))
    by_phase = errors.group_by("phase").agg(pl.col("error").mean())
    means = dict(by_phase.iter_rows())
    assert means == pytest.approx({"before": 0.0, "gap": 1.1, "after": 2.0}, abs=1e-12)
    in_gap = errors.filter(phase="gap")["error"]
    np.testing.assert_allclose(in_gap, 0.2 * np.arange(1, 11), rtol=0, atol=1e-12)


def test_a_track_that_is_deleted_in_the_gap_has_no_error_from_there_on() -> None:
    """Null, neither zero nor the error of the track that takes over; and it is not recovered."""
    rows = [(k, TRACK, *truth(k)) for k in range(25)]
    rows += [(k, TRACK + 1, *truth(k)) for k in range(STOP, N)]
    tracks = tracks_of(rows, N, coasted=[START <= k < STOP for k, *_ in rows])
    errors = gap_errors(trace(), tracks, GAP)
    for frame, error in errors.select("frame", "error").iter_rows():
        assert error == (0.0 if frame < 25 else None)
    assert errors["track_id"].unique().to_list() == [TRACK]
    assert not errors["recovered"].any()
    assert errors["deleted"].all()


def test_the_followed_track_is_the_nearest_before_the_gap_and_is_followed_anywhere() -> None:
    """A nearer track later on, or a jump to 30 m away, changes neither the track nor the rule."""
    rows = [(k, TRACK, truth(k)[0] + (0.2 if k < START else 30.0), 4.0) for k in FRAMES]
    rows += [(k, 1, truth(k)[0] + (0.3 if k < START else 0.0), 4.0) for k in FRAMES]
    errors = gap_errors(trace(), tracks_of(rows, N), GAP)
    assert errors["track_id"].unique().to_list() == [TRACK]
    np.testing.assert_allclose(errors.filter(phase="before")["error"], 0.2, atol=1e-12)
    np.testing.assert_allclose(errors.filter(pl.col("frame") >= START)["error"], 30.0, atol=1e-12)


@pytest.mark.parametrize("frame", [START, STOP - 1])
def test_one_detection_in_the_gap_is_a_capture(frame: int) -> None:
    """The object has none there, so it was another's."""
    errors = errors_of(lambda k: (0.1, 0.0), detected=lambda k: not START <= k < STOP or k == frame)
    assert errors["captured"].all()


def test_detections_outside_the_gap_are_no_capture() -> None:
    """The frames next to the gap are not in it."""
    errors = errors_of(lambda k: (0.1, 0.0), detected=lambda k: k in (START - 1, STOP))
    assert not errors["captured"].any()


@pytest.mark.parametrize(
    ("detected_again", "far", "recovered"),
    [(True, 0.0, True), (True, 1.99, True), (True, 2.0, False), (False, 0.0, False)],
)
def test_recovered_means_with_its_object_and_detected_since(
    detected_again: bool, far: float, recovered: bool
) -> None:
    """At the end of the window closer than 2 m, and detected at least once after the gap."""
    errors = errors_of(
        lambda k: (0.0, far if k == STOP + WINDOW - 1 else 0.0),
        detected=lambda k: k < START or (detected_again and k == STOP + 4),
    )
    assert errors["recovered"].unique().to_list() == [recovered]


@pytest.mark.parametrize(("distance", "track_id"), [(1.99, TRACK), (2.0, -1)])
def test_a_gap_that_no_track_follows_has_no_errors(distance: float, track_id: int) -> None:
    """In the last frame before it no track is within 2 m."""
    errors = errors_of(lambda k: (0.0, distance if k == START - 1 else 0.1))
    assert errors["track_id"].unique().to_list() == [track_id]
    assert len(errors) == STOP - START + 2 * WINDOW
    if track_id < 0:
        assert errors["error"].null_count() == len(errors)
        assert not errors["captured"].any()
        assert not errors["recovered"].any()


def test_without_tracks_every_gap_is_unfollowed() -> None:
    """No estimates at all: rows are there, errors are not."""
    errors = gap_errors(trace(), tracks_of([], N), GAP)
    assert errors["track_id"].unique().to_list() == [-1]
    assert errors["error"].null_count() == len(errors) == STOP - START + 2 * WINDOW


def test_the_window_ends_where_the_truth_does() -> None:
    """An object that comes four frames before the gap and goes two after it."""
    own = trace(range(START - 4, STOP + 2))
    tracks = tracks_of([(k, TRACK, *truth(k)) for k in FRAMES], N)
    assert gap_errors(own, tracks, GAP)["frame"].to_list() == list(range(START - 4, STOP + 2))


def test_regime_and_turning_are_the_truths_as_the_gap_begins() -> None:
    """What the object does before or later in the gap does not count."""
    regimes = [3 if k == START else 1 for k in FRAMES]
    rows = [(k, OBJECT, *truth(k)) for k in FRAMES]
    own = trace_of(rows, N, regime=regimes, turning=[k == START for k in FRAMES])
    errors = gap_errors(own, tracks_of([(k, TRACK, *truth(k)) for k in FRAMES], N), GAP)
    assert errors["regime"].unique().to_list() == [REGIMES[3]]
    assert errors["turning"].all()


def test_gaps_are_measured_one_by_one() -> None:
    """Two objects, two tracks, two gaps: each with its own error."""
    rows = [(k, i, 0.5 * k, 10.0 * i) for k in FRAMES for i in (1, 2)]
    estimates = [(k, i + 10, 0.5 * k, 10.0 * i + 0.1 * i) for k in FRAMES for i in (1, 2)]
    gaps = gaps_of((1, 15, 20), (2, 25, 40))
    errors = gap_errors(trace_of(rows, N), tracks_of(estimates, N), gaps)
    assert errors.group_by("object_id").len().sort("object_id").rows() == [
        (1, 5 + 2 * WINDOW),
        (2, 15 + 2 * WINDOW),
    ]
    expected = 0.1 * errors["object_id"].to_numpy()
    np.testing.assert_allclose(errors["error"], expected, rtol=0, atol=1e-9)
    assert errors["track_id"].to_list() == (errors["object_id"] + 10).to_list()


def test_no_gaps_give_an_empty_table_of_the_same_columns() -> None:
    """So that results of worlds with and without gaps can be joined."""
    tracks = tracks_of([(k, TRACK, *truth(k)) for k in FRAMES], N)
    empty = gap_errors(trace(), tracks, gaps_of())
    assert len(empty) == 0
    assert empty.schema == gap_errors(trace(), tracks, GAP).schema
