"""Claim: truth counts within range and where visible or in a gap; a track on what does not count is
neither right nor wrong; every other track counts."""

from itertools import permutations

import numpy as np
import pytest

from experiments.population import MATCH_DISTANCE, SCORED_RANGE, SCORED_VISIBLE, population
from tests.tables import gaps_of, trace_of, tracks_of

NO_GAPS = gaps_of()
NO_TRACKS = tracks_of([], 20)


def test_truth_counts_up_to_the_range_from_the_moving_sensor() -> None:
    """60 m on the ground from where the sensor is in that frame."""
    far = np.nextafter(SCORED_RANGE, np.inf)
    rows = [(0, 1, 60.0, 0.0), (0, 2, far, 0.0), (0, 3, -36.0, 48.0)]
    rows += [(5, 1, 60.0, 0.0), (5, 2, far, 0.0), (5, 3, -36.0, 48.0)]
    counted = population(trace_of(rows, 20, ego=1.0), NO_TRACKS, NO_GAPS, "keep").truth
    assert counted.tolist() == [True, False, True, True, True, False]


def test_truth_counts_from_the_visible_fraction_on() -> None:
    """Exactly 0.15 counts, less does not."""
    trace = trace_of(
        [(0, 1, 5, 0), (0, 2, 9, 0), (0, 3, 13, 0)],
        20,
        visible=[SCORED_VISIBLE, np.nextafter(SCORED_VISIBLE, 0), 0.0],
    )
    counted = population(trace, NO_TRACKS, NO_GAPS, "keep").truth
    assert counted.tolist() == [True, False, False]


def test_truth_in_a_gap_counts_though_invisible_or_is_ignored_though_visible() -> None:
    """`keep` counts it within range, `ignore` never; start is in the gap, stop is not."""
    rows = [(k, 1, 10.0, 0.0) for k in range(6)] + [(k, 2, 10.0, 9.0) for k in range(6)]
    visible = [1, 0, 1, 0, 1, 0] * 2
    trace = trace_of(rows, 20, visible=visible)
    gaps = gaps_of((1, 2, 4))
    for convention, of_first in (
        ("keep", [True, False, True, True, True, False]),
        ("ignore", [True, False, False, False, True, False]),
    ):
        counted = population(trace, NO_TRACKS, gaps, convention).truth
        assert counted[trace.rows_of(1)].tolist() == of_first
        assert counted[trace.rows_of(2)].tolist() == [True, False] * 3


def test_truth_out_of_range_does_not_count_even_in_a_gap() -> None:
    """By neither convention."""
    trace = trace_of([(k, 1, 61.0, 0.0) for k in range(6)], 20)
    for convention in ("keep", "ignore"):
        assert not population(trace, NO_TRACKS, gaps_of((1, 2, 4)), convention).truth.any()


def test_a_track_out_of_range_is_not_scored() -> None:
    """On an object or not; the sensor's place in that frame decides."""
    trace = trace_of([(0, 1, 65.0, 0.0), (5, 1, 65.0, 0.0)], 20, ego=1.0)
    tracks = tracks_of([(0, 1, 65, 0), (0, 2, 0, -61), (0, 3, 0, -60), (5, 1, 65.0, 0)], 20)
    scored = population(trace, tracks, NO_GAPS, "keep").tracks
    assert scored.tolist() == [False, False, True, True]


def test_a_track_in_range_on_an_object_out_of_range_is_not_scored() -> None:
    """The object does not count, so the track on it is not wrong."""
    trace = trace_of([(0, 1, 60.5, 0.0)], 20)
    assert not population(trace, tracks_of([(0, 1, 59.5, 0)], 20), NO_GAPS, "keep").tracks.any()


def test_a_track_near_nothing_is_a_false_positive() -> None:
    """It is scored, with and without ignored truth elsewhere in the frame."""
    trace = trace_of([(0, 1, 10, 0), (1, 1, 10, 0)], 20, visible=[0.0, 1.0])
    tracks = tracks_of([(0, 1, 20, 0), (1, 1, 20, 0), (2, 1, 20, 0)], 20)
    assert population(trace, tracks, NO_GAPS, "keep").tracks.all()


@pytest.mark.parametrize(("distance", "scored"), [(0.0, False), (1.999, False), (2.0, True)])
def test_a_track_on_an_invisible_object_is_not_scored(distance: float, scored: bool) -> None:
    """Closer than 2 m it is on it; from 2 m on it has nothing to do with it."""
    trace = trace_of([(0, 1, 10.0, 0.0)], 20, visible=[0.0])
    tracks = tracks_of([(0, 4, 10.0 + distance, 0.0)], 20)
    assert population(trace, tracks, NO_GAPS, "keep").tracks.tolist() == [scored]


def test_a_track_coasting_through_a_gap_is_scored_or_ignored_by_the_convention() -> None:
    """Right there if gaps are kept, neither right nor wrong if they are ignored."""
    trace = trace_of([(k, 1, 10.0, 0.0) for k in range(6)], 20)
    tracks = tracks_of([(k, 4, 10.5, 0.0) for k in range(6)], 20)
    gaps = gaps_of((1, 2, 4))
    assert population(trace, tracks, gaps, "keep").tracks.all()
    scored = population(trace, tracks, gaps, "ignore").tracks
    assert scored.tolist() == [True, True, False, False, True, True]


def test_a_track_belongs_to_the_nearer_of_two_objects() -> None:
    """Between a counted object and an ignored one 1.5 m away."""
    trace = trace_of([(0, 1, 10.0, 0.0), (0, 2, 11.5, 0.0)], 20, visible=[1.0, 0.0])
    for x, scored in ((10.6, True), (10.9, False)):
        tracks = tracks_of([(0, 1, x, 0.0)], 20)
        assert population(trace, tracks, NO_GAPS, "keep").tracks.tolist() == [scored]


def test_a_second_track_on_an_ignored_object_is_a_false_positive() -> None:
    """One object excuses one track: the nearest."""
    trace = trace_of([(0, 1, 10.0, 0.0)], 20, visible=[0.0])
    tracks = tracks_of([(0, 1, 10.9, 0.0), (0, 2, 9.5, 0.0)], 20)
    assert population(trace, tracks, NO_GAPS, "keep").tracks.tolist() == [True, False]


@pytest.mark.parametrize("seed", range(8))
def test_ignored_tracks_are_those_of_the_best_assignment(seed: int) -> None:
    """All one-to-one assignments of up to four objects and tracks in a crowd are tried: the one
    with the largest sum of max(0, 2 m - distance) says which tracks are on ignored objects."""
    rng = np.random.default_rng(seed)
    n_frames = 40
    truth, estimates, visible, expected = [], [], [], []
    for frame in range(n_frames):
        n_objects, n_tracks = rng.integers(1, 5, 2).tolist()
        places, at = rng.uniform(5.0, 9.0, (n_objects, 2)), rng.uniform(5.0, 9.0, (n_tracks, 2))
        seen = rng.random(n_objects) < 0.5
        truth += [(frame, k, *xy) for k, xy in enumerate(places)]
        estimates += [(frame, k, *xy) for k, xy in enumerate(at)]
        visible += seen.tolist()
        closeness = np.maximum(MATCH_DISTANCE - np.hypot(*(places[:, None] - at).T).T, 0.0)
        # Spare columns stand for objects without a track.
        spare = np.hstack([closeness, np.zeros((n_objects, n_objects))]).tolist()
        best = max(
            permutations(range(n_tracks + n_objects), n_objects),
            key=lambda chosen, spare=spare: sum(spare[k][j] for k, j in enumerate(chosen)),
        )
        on_ignored = {j for k, j in enumerate(best) if spare[k][j] > 0 and not seen[k]}
        expected += [j not in on_ignored for j in range(n_tracks)]
    trace = trace_of(truth, n_frames, visible=visible)
    scored = population(trace, tracks_of(estimates, n_frames), NO_GAPS, "keep").tracks
    assert scored.tolist() == expected


def test_an_unknown_convention_is_refused() -> None:
    """The error shows the two that there are."""
    with pytest.raises(ValueError, match="'drop', expected one of"):
        population(trace_of([], 20), NO_TRACKS, NO_GAPS, "drop")  # type: ignore[arg-type]


def test_a_track_counts_as_its_object_does_across_the_range() -> None:
    """An object just inside the range whose track is just outside is found, not missed; the
    other way round neither counts."""
    trace = trace_of([(0, 1, 59.9, 0.0), (0, 2, 0.0, 60.1)], 20)
    tracks = tracks_of([(0, 1, 60.1, 0.0), (0, 2, 0.0, 59.9), (0, 3, 0.0, -61.0)], 20)
    kept = population(trace, tracks, NO_GAPS, "keep")
    assert kept.truth.tolist() == [True, False]
    assert kept.tracks.tolist() == [True, False, False]
