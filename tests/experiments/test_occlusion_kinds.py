"""Claim: empty gaps, several gaps and gaps around a switch of motion are where the protocol says;
natural ones are those that are there."""

from collections.abc import Sequence
from itertools import combinations, pairwise

import numpy as np
import pytest

from experiments.natural import natural_occlusions
from experiments.occlusion import OcclusionProtocol, recorded_gaps
from experiments.regime_switches import LASTING, regime_switches
from mdkf.tables import KINDS, REGIMES, Detections, TableError, Trace
from tests.experiments.test_occlusion import detections_of, random_detections
from tests.tables import trace_of, tracks_of

STANDS, STEADY, SPEEDS, CHANGES, UNKNOWN = range(len(REGIMES))


def moving(regimes: Sequence[int], identifier: int = 5) -> Trace:
    """One object in as many frames as it has regimes."""
    rows = [(k, identifier, 10.0, 0.1 * k) for k in range(len(regimes))]
    return trace_of(rows, len(regimes), regime=regimes)


# Empty gaps


@pytest.mark.parametrize("kind", ["mid", "late"])
@pytest.mark.parametrize("seed", range(5))
def test_a_gap_of_no_length_removes_nothing_and_keeps_the_eligible(kind: str, seed: int) -> None:
    """The table is the same; the objects are those with enough detections, as for any length."""
    given = random_detections(seed)
    protocol = OcclusionProtocol(kind, length=0, warmup=12)  # type: ignore[arg-type]
    assert protocol.apply(given) == given
    least = 12 + (kind == "mid")
    eligible = [i for i in given.ids().tolist() if i >= 0 and len(given.rows_of(i)) >= least]
    assert protocol.gaps(given).object_id.tolist() == eligible
    gaps = protocol.gaps(given)
    assert not gaps.covers(given.source, given.frame).any()


def test_an_empty_gap_is_where_a_gap_would_be() -> None:
    """Between the two halves of 100 detections, and after the last of them."""
    given = detections_of({5: range(30, 130)})
    assert OcclusionProtocol("mid", 0, 35).gaps(given).rows() == [(5, 80, 80)]
    assert OcclusionProtocol("late", 0, 35).gaps(given).rows() == [(5, 130, 130)]


def test_empty_gaps_travel_as_others_do() -> None:
    """They are read back from the tracks."""
    given = detections_of({5: range(30, 130)})
    protocol = OcclusionProtocol("mid", 0, 35)
    told = protocol.apply(given).provenance
    tracks = tracks_of([(0, 1, 0.0, 0.0)], 200, provenance=dict(told))
    assert recorded_gaps(tracks, protocol).rows() == [(5, 80, 80)]


# Several gaps


def test_several_gaps_part_the_detections_evenly() -> None:
    """Three of 10 in 130: four runs of 25."""
    gaps = OcclusionProtocol("mid", 10, 15, n_gaps=3).gaps(detections_of({5: range(130)}))
    assert gaps.rows() == [(5, 25, 35), (5, 60, 70), (5, 95, 105)]


def test_a_long_warm_up_moves_later_gaps_back() -> None:
    """Twice 35 + 20 in 111 detections leave one for the end; in 110 there is one gap only."""
    protocol = OcclusionProtocol("mid", 20, 35, n_gaps=2)
    assert protocol.gaps(detections_of({5: range(111)})).rows() == [(5, 35, 55), (5, 90, 110)]
    assert protocol.gaps(detections_of({5: range(110)})).rows() == [(5, 45, 65)]


@pytest.mark.parametrize("most", [1, 2, 4, 50])
@pytest.mark.parametrize("seed", range(10))
def test_as_many_gaps_as_fit_each_after_its_warm_up(seed: int, most: int) -> None:
    """Of n detections (n - 1) // (warmup + length) gaps fit; each removes `length` in a row, after
    `warmup` that stay, and the last is seen again. Others keep every number."""
    given = random_detections(seed)
    protocol = OcclusionProtocol("mid", 6, 8, n_gaps=most)
    gaps = protocol.gaps(given)
    kept = protocol.apply(given)
    assert kept == given.take(~gaps.covers(given.source, given.frame))
    for identifier in given.ids().tolist():
        frames = given.frame[given.rows_of(identifier)]
        own = [(a, b) for i, a, b in gaps.rows() if i == identifier]
        if identifier < 0:
            assert not own
            continue
        assert len(own) == min(most, max(len(frames) - 1, 0) // 14)
        since = 0
        for start, stop in own:
            first, after = np.searchsorted(frames, (start, stop)).tolist()
            assert after - first == 6
            assert first - since >= 8
            assert after < len(frames)
            assert frames[first - 1] == start - 1
            assert frames[after] == stop
            since = after
    if most == 1:
        assert gaps.rows() == OcclusionProtocol("mid", 6, 8).gaps(given).rows()


# Gaps around a switch


@pytest.mark.parametrize("start", [-12, -5, 0, 3])
def test_a_gap_begins_so_many_frames_from_the_switch(start: int) -> None:
    """The object stands for 60 frames, then drives."""
    trace = moving([STANDS] * 60 + [STEADY] * 60)
    gaps = OcclusionProtocol("switch", 10, 20, start=start).gaps(
        detections_of({5: range(120)}), trace
    )
    assert gaps.rows() == [(5, 60 + start, 70 + start)]
    assert gaps.reappear


@pytest.mark.parametrize(
    ("frames", "start"),
    [
        (range(120), -41),  # 19 detections before
        (range(120), 50),  # not seen again
        ([*range(54), *range(55, 120)], -5),  # missed in the frame before: the gap began with that
    ],
)
def test_where_the_gap_would_not_be_so_there_is_none(frames: Sequence[int], start: int) -> None:
    """Neither is it moved, nor shortened."""
    trace = moving([STANDS] * 60 + [STEADY] * 60)
    protocol = OcclusionProtocol("switch", 10, 20, start=start)
    assert len(protocol.gaps(detections_of({5: frames}), trace)) == 0


def test_of_several_switches_it_is_the_one_nearest_to_the_middle() -> None:
    """At 40, 70 and 100 of 140 frames; of several gaps, as many as the warm-up lets."""
    trace = moving([STANDS] * 40 + [STEADY] * 30 + [SPEEDS] * 30 + [STANDS] * 40)
    given = detections_of({5: range(140)})
    assert OcclusionProtocol("switch", 10, 20).gaps(given, trace).rows() == [(5, 70, 80)]
    every = [(5, 40, 50), (5, 70, 80), (5, 100, 110)]
    assert OcclusionProtocol("switch", 10, 20, n_gaps=9).gaps(given, trace).rows() == every
    two = OcclusionProtocol("switch", 10, 21, n_gaps=9).gaps(given, trace).rows()
    assert two == [(5, 40, 50), (5, 100, 110)]


@pytest.mark.parametrize("seed", range(20))
def test_as_many_switches_as_any_choice_has(seed: int) -> None:
    """All sets of switches are tried: none that leaves the warm-ups is larger."""
    rng = np.random.default_rng(seed)
    lasts = rng.integers(LASTING, 40, 9)
    trace = moving(np.repeat(np.arange(9) % 2, lasts).tolist())
    changes = np.cumsum(lasts)[:-1].tolist()
    given = detections_of({5: range(trace.n_frames)}, trace.n_frames)
    gaps = OcclusionProtocol("switch", 7, 18, n_gaps=9).gaps(given, trace)
    assert set(gaps.start.tolist()) <= set(changes)
    fits = [c for c in changes if c >= 18 and c + 7 < trace.n_frames]
    largest = max(
        size
        for size in range(len(fits) + 1)
        for chosen in combinations(fits, size)
        if all(b - a >= 25 for a, b in pairwise(chosen))
    )
    assert len(gaps) == largest > 0
    assert (np.diff(gaps.start) >= 25).all()


def test_a_switch_lasts_on_both_sides() -> None:
    """Nine frames are none, ten are; an object's first frame is none, nor another object's."""
    long, short = [STANDS] * 30, [SPEEDS] * (LASTING - 1)
    assert regime_switches(moving([*long, *short, *[STEADY] * 30])) == {}
    assert regime_switches(moving([*short, *long])) == {}
    found = regime_switches(moving([*long, *[SPEEDS] * LASTING, *[STEADY] * 30], identifier=3))
    assert {i: frames.tolist() for i, frames in found.items()} == {3: [30, 40]}
    rows = [(k, i, 10.0, float(i)) for k in range(30) for i in (1, 2)]
    two = trace_of(rows, 30, regime=[STANDS if i == 1 else STEADY for _, i, _, _ in rows])
    assert regime_switches(two) == {}


def test_recorded_objects_have_no_switches() -> None:
    """One line says whose."""
    given = detections_of({5: range(120)})
    with pytest.raises(TableError, match=r"no switches of motion.*expected the trace") as caught:
        OcclusionProtocol("switch", 10, 20).gaps(given, moving([UNKNOWN] * 120))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["switch", "natural"])
def test_what_needs_the_trace_says_so(kind: str) -> None:
    """Detections alone tell neither of switches nor of what is hidden."""
    with pytest.raises(ValueError, match=f"occlusion {kind}:10:20: expected the trace"):
        OcclusionProtocol(kind, 10, 20).apply(detections_of({5: range(120)}))  # type: ignore[arg-type]


# Natural occlusions


def hidden(kind: str) -> tuple[Trace, Detections]:
    """An object that is in the sensor's view but in frames 30 to 39, and 60 to 69."""
    out_of_view = [*range(30, 40), *range(60, 70)]
    rows = [(k, 5, 20.0, 0.0) for k in range(100)]
    visible = [0.0 if k in out_of_view else 1.0 for k in range(100)]
    trace = trace_of(rows, 100, visible=visible, kind=[KINDS.index(kind)] * 100)
    return trace, detections_of({5: [k for k in range(100) if k not in out_of_view]}, 100)


@pytest.mark.parametrize("kind", ["car", "bus", "pedestrian"])
def test_natural_takes_every_occlusion_of_a_road_user(kind: str) -> None:
    """Nothing is removed; the gaps are the absences, and travel as others do."""
    trace, seen = hidden(kind)
    protocol = OcclusionProtocol("natural", 20, 30)
    occluded = protocol.apply(seen, trace)
    assert occluded == seen
    gaps = [(5, 30, 40), (5, 60, 70)]
    assert protocol.gaps(seen, trace).rows() == gaps
    tracks = tracks_of([(0, 1, 0.0, 0.0)], 100, provenance=dict(occluded.provenance))
    assert recorded_gaps(tracks, protocol).rows() == gaps
    later = OcclusionProtocol("natural", 20, 31).gaps(seen, trace)
    assert later.rows() == gaps[1:], "30 detections before the first"


def test_walls_are_not_occluded() -> None:
    """They are no road users."""
    trace, seen = hidden("wall")
    assert len(natural_occlusions(trace, seen, np.array([5]), 10)) == 0
    assert len(OcclusionProtocol("natural", 20, 10).gaps(seen, trace)) == 0
