"""Claim: `score` gives perfect tracks full marks, shows what is wrong with others, and refuses
tracks that belong elsewhere; its numbers are TrackEval's."""

import dataclasses
import json
import math
from collections.abc import Callable, Iterable

import numpy as np
import pytest
from trackeval.metrics import CLEAR, HOTA, Identity

import mdkf
import scenarios
import sim_bridge
from experiments import OcclusionProtocol, score
from experiments.population import population
from mdkf.tables import Detections, TableError, Trace, Tracks
from tests.tables import trace_of, tracks_of

N = 80
PROTOCOL = OcclusionProtocol("mid", 20, 35)
GAPS = [(0, 30, 50), (1, 40, 60)]
OBJECTS = (0, 1, 2)


def place(identifier: int, frame: int) -> tuple[float, float]:
    """Three cars side by side, 6 m apart, at 3 m/s."""
    return 0.3 * frame, 6.0 * identifier


@pytest.fixture(scope="module")
def trace() -> Trace:
    """Three cars in full view for 80 frames."""
    return trace_of([(k, i, *place(i, k)) for k in range(N) for i in OBJECTS], N)


def told(protocol: str, gaps: Iterable[tuple[int, int, int]]) -> dict[str, str]:
    """Provenance as the protocol writes it."""
    return {"occlusion": json.dumps({"protocol": protocol, "gaps": list(gaps)})}


def in_gap(identifier: int, frame: int) -> bool:
    return any(identifier == i and start <= frame < stop for i, start, stop in GAPS)


def tracks_for(
    name: Callable[[int, int], int] = lambda i, k: i + 10,
    reported: Callable[[int, int], bool] = lambda i, k: True,
    offset: Callable[[int, int], float] = lambda i, k: 0.0,
    occluded: bool = True,
) -> Tracks:
    """Tracks on the three cars, called by `name`, where `reported`, off by `offset` [m] along y."""
    keys = [(i, k) for k in range(N) for i in OBJECTS if reported(i, k)]
    rows = [(k, name(i, k), place(i, k)[0], place(i, k)[1] + offset(i, k)) for i, k in keys]
    coasted = [in_gap(i, k) for i, k in keys]
    return tracks_of(rows, N, coasted, told(str(PROTOCOL), GAPS) if occluded else {})


def test_perfect_tracks_get_full_marks(trace: Trace) -> None:
    """100 percent in every score and no error, by both conventions."""
    for convention in ("keep", "ignore"):
        summary = score(trace, tracks_for(), PROTOCOL, convention).summary()
        for name in ("hota", "deta", "assa", "mota", "motp", "idf1"):
            assert summary[name] == 100.0, name
        for name in ("idsw", "fp", "fn", "captured", "lost", "gap_median"):
            assert summary[name] == 0.0, name
        for phase in ("before", "gap", "after"):
            assert summary[f"error_{phase}"] == 0.0
        assert summary["gaps"] == summary["followed"] == 2


def test_an_identity_switch_shows_in_the_scores(trace: Trace) -> None:
    """One of three cars has another track in the second half. By hand: MOTA loses 1 of 240 rows;
    IDF1 the 40 rows of the second half; HOTA's association the switched car's half, so
    A = (80 + 80 + 40 * 1/2 + 40 * 1/2) / 240."""
    switched = tracks_for(name=lambda i, k: 99 if i == 2 and k >= 40 else i + 10)
    summary = score(trace, switched).summary()
    assert summary["idsw"] == 1
    assert summary["mota"] == pytest.approx(100 * (1 - 1 / 240))
    assert summary["idf1"] == pytest.approx(100 * 200 / 240)
    assert summary["deta"] == 100.0
    association = (80 + 80 + 80 / 2) / 240
    assert summary["assa"] == pytest.approx(100 * association)
    assert summary["hota"] == pytest.approx(100 * math.sqrt(association))


def test_keep_counts_what_a_silent_tracker_misses_and_ignore_does_not(trace: Trace) -> None:
    """Perfect outside the gaps, nothing inside: 40 of 240 rows are missed, or 200 of 200 found."""
    silent = tracks_for(reported=lambda i, k: not in_gap(i, k))
    kept = score(trace, silent, PROTOCOL, "keep").summary()
    assert (kept["fn"], kept["fp"], kept["idsw"]) == (40, 0, 0)
    assert kept["mota"] == pytest.approx(100 * 200 / 240)
    assert kept["deta"] == pytest.approx(100 * 200 / 240)
    assert kept["idf1"] == pytest.approx(100 * 2 * 200 / (2 * 200 + 40))
    ignored = score(trace, silent, PROTOCOL, "ignore").summary()
    for name in ("hota", "mota", "idf1"):
        assert ignored[name] == 100.0
    assert ignored["fn"] == 0


def test_a_track_that_strays_in_the_gap_is_wrong_by_both_conventions(trace: Trace) -> None:
    """3 m off is a false positive; under `keep` the object is missed as well."""
    astray = tracks_for(offset=lambda i, k: -3.0 * (i == 0 and in_gap(0, k)))
    kept = score(trace, astray, PROTOCOL, "keep").summary()
    assert (kept["fn"], kept["fp"]) == (20, 20)
    ignored = score(trace, astray, PROTOCOL, "ignore").summary()
    assert (ignored["fn"], ignored["fp"]) == (0, 20)


def test_a_false_positive_and_invisible_truth(trace: Trace) -> None:
    """A track on nothing costs MOTA; one on an invisible object costs nothing."""
    rows = [(k, i, *place(i, k)) for k in range(N) for i in OBJECTS]
    partly = trace_of(rows, N, visible=[0.0 if i == 2 else 1.0 for _, i, *_ in rows])
    summary = score(partly, tracks_for(occluded=False)).summary()
    assert (summary["mota"], summary["fp"]) == (100.0, 0)
    ghost = tracks_of(
        [*((k, i, *place(i, k)) for k in range(N) for i in OBJECTS), (7, 9, 9, 40)], N
    )
    summary = score(trace, ghost).summary()
    assert summary["fp"] == 1
    assert summary["mota"] == pytest.approx(100 * (1 - 1 / 240))


def test_states_are_those_of_tracks_on_truth_that_counts(trace: Trace) -> None:
    """Car 0's track is 0.6 m off, car 1's on it; car 2 is invisible and its track, 1.5 m off, does
    not count; nor does one on nothing, but for GOSPA. By hand, with the tables' covariance of 1,
    velocity (1, 1) and yaw 1 against a truth of 0."""
    rows = [(k, i, *place(i, k)) for k in range(N) for i in OBJECTS]
    partly = trace_of(rows, N, visible=[0.0 if i == 2 else 1.0 for _, i, *_ in rows])
    off = (0.6, 0.0, 1.5)
    ghost = [(k, 9, 9.0, 40.0) for k in range(N)]
    tracks = tracks_of([*((k, i, x, y + off[i]) for k, i, x, y in rows), *ghost], N)
    result = score(partly, tracks)
    summary = result.summary()
    expected = {
        "position_error": 0.3,
        "position_rmse": math.sqrt(0.18),
        "velocity_error": math.sqrt(2),
        "velocity_rmse": math.sqrt(2),
        "heading_error": 1.0,
        "backwards": 0.0,
        "nees": 0.18,
        "gospa": math.sqrt(0.36 + 2.0),
        "gospa_localisation": 0.6,
        "gospa_missed": 0.0,
        "gospa_false": math.sqrt(2.0),
        "miss_rate": 0.0,
    }
    assert {name: summary[name] for name in expected} == pytest.approx(expected, abs=1e-12)
    assert math.isnan(summary["nis"])
    assert len(result.states) == 2 * N


def test_errors_are_the_means_over_all_followed_gaps(trace: Trace) -> None:
    """Car 0 is off by 1 m and car 1 by 0.5 m in the gap, by 0.2 m and 0.1 m before it, by 0.4 m
    and 0 after it; both gaps are 20 frames long."""
    by_phase = {0: (0.2, 1.0, 0.4), 1: (0.1, 0.5, 0.0)}

    def offset(i: int, k: int) -> float:
        if i == 2:
            return 0.0
        _, start, stop = GAPS[i]
        return by_phase[i][(k >= start) + (k >= stop)]

    summary = score(trace, tracks_for(offset=offset), PROTOCOL).summary()
    assert summary["error_before"] == pytest.approx(0.15, abs=1e-12)
    assert summary["error_gap"] == pytest.approx(0.75, abs=1e-12)
    assert summary["error_after"] == pytest.approx(0.2, abs=1e-12)
    assert summary["gap_median"] == pytest.approx(0.75, abs=1e-12)


def test_captured_and_lost_are_shares_of_the_followed_gaps(trace: Trace) -> None:
    """Car 0's track is detected in its gap and gone afterwards; car 1's behaves; a third gap has
    no track at all and is not counted."""
    rows = [(k, i, *place(i, k)) for k in range(N) for i in (0, 1) if i == 1 or k < 50]
    coasted = [in_gap(i, k) and not (i == 0 and k == 45) for k, i, *_ in rows]
    tracks = tracks_of(rows, N, coasted, told(str(PROTOCOL), [*GAPS, (2, 30, 50)]))
    summary = score(trace, tracks, PROTOCOL).summary()
    assert (summary["gaps"], summary["followed"]) == (3, 2)
    assert summary["captured"] == 50.0
    assert summary["lost"] == 50.0


def test_without_gaps_there_are_no_errors_but_scores(trace: Trace) -> None:
    """NaN, not zero: nothing was measured."""
    summary = score(trace, tracks_for(occluded=False)).summary()
    assert summary["hota"] == 100.0
    assert summary["gaps"] == 0
    for name in ("error_before", "error_gap", "error_after", "gap_median", "captured", "lost"):
        assert math.isnan(summary[name]), name


def test_without_tracks_everything_is_missed(trace: Trace) -> None:
    """No tracks at all is a score, not an error."""
    summary = score(trace, tracks_of([], N)).summary()
    assert (summary["fn"], summary["fp"], summary["mota"]) == (240, 0, 0.0)
    assert summary["miss_rate"] == 100.0
    assert summary["gospa"] == summary["gospa_missed"] == pytest.approx(math.sqrt(3 * 2.0))
    for name in ("position_error", "velocity_error", "heading_error", "backwards", "nees", "nis"):
        assert math.isnan(summary[name]), name


def test_tracks_of_another_trace_are_refused(trace: Trace) -> None:
    """The trace's content hash travels with the tracks; one changed number is another trace."""
    own = dataclasses.replace(tracks_for(), provenance={"trace": trace.content_hash()})
    assert score(trace, own).summary()["hota"] == 100.0
    rows = [(k, i, *place(i, k)) for k in range(N) for i in OBJECTS]
    other = trace_of(rows, N, jx=[1e-12, *[0.0] * (len(rows) - 1)])
    with pytest.raises(TableError, match="another trace"):
        score(other, own)


def test_tracks_of_other_frames_are_refused(trace: Trace) -> None:
    """Another number of frames or another time between them; the message shows both."""
    with pytest.raises(TableError, match=r"79 frames of 0.1 s.* 80 of 0.1 s"):
        score(trace, tracks_of([], N - 1))
    slower = dataclasses.replace(tracks_for(), dt=0.2)
    with pytest.raises(TableError, match=r"80 frames of 0.2 s.* 80 of 0.1 s"):
        score(trace, slower)


@pytest.mark.parametrize("expected", ["late:20:35", "mid:10:35", "mid:20:34", "none"])
def test_tracks_of_another_protocol_are_refused(trace: Trace, expected: str) -> None:
    """The message names the protocol of the tracks and the expected one."""
    with pytest.raises(TableError, match=f"occlusion mid:20:35, expected {expected}"):
        score(trace, tracks_for(), OcclusionProtocol.parse(expected))


def test_tracks_without_a_protocol_are_refused_where_one_is_expected(trace: Trace) -> None:
    """Tracks of unhidden detections are not those of the experiment."""
    with pytest.raises(TableError, match="occlusion none, expected mid:20:35"):
        score(trace, tracks_for(occluded=False), PROTOCOL)
    assert score(trace, tracks_for(occluded=False), OcclusionProtocol("none")).gaps.start.size == 0


@pytest.fixture(scope="module")
def real() -> tuple[Trace, Detections]:
    """Ten seconds of traffic at a bus stop."""
    scenario = dataclasses.replace(scenarios.load("bus_stop"), duration=10.0)
    trace = sim_bridge.simulate(scenario, 1)
    return trace, sim_bridge.detect(trace, seed=1)


@pytest.mark.parametrize("convention", ["keep", "ignore"])
def test_a_real_runs_scores_are_trackevals(real: tuple[Trace, Detections], convention: str) -> None:
    """TrackEval is fed the rows that count, frame by frame, with similarities made in numpy."""
    trace, detections = real
    tracks = mdkf.Tracker(mdkf.estimator("md")).run(PROTOCOL.apply(detections))
    ours = score(trace, tracks, PROTOCOL, convention)  # type: ignore[arg-type]
    assert len(ours.gaps) >= 5
    kept = population(trace, tracks, ours.gaps, convention)  # type: ignore[arg-type]
    data = as_trackeval(trace.take(kept.truth), tracks.take(kept.tracks))
    theirs = {
        "hota": HOTA().eval_sequence(data),
        "clear": CLEAR({"PRINT_CONFIG": False}).eval_sequence(data),
        "identity": Identity({"PRINT_CONFIG": False}).eval_sequence(data),
    }
    expected = {
        "hota": 100 * np.mean(theirs["hota"]["HOTA"]),
        "deta": 100 * np.mean(theirs["hota"]["DetA"]),
        "assa": 100 * np.mean(theirs["hota"]["AssA"]),
        "mota": 100 * theirs["clear"]["MOTA"],
        "motp": 100 * theirs["clear"]["MOTP"],
        "idf1": 100 * theirs["identity"]["IDF1"],
        "idsw": theirs["clear"]["IDSW"],
        "fp": theirs["clear"]["CLR_FP"],
        "fn": theirs["clear"]["CLR_FN"],
    }
    summary = ours.summary()
    assert {name: summary[name] for name in expected} == pytest.approx(expected, abs=1e-9)
    assert 0 < expected["mota"] < 100


def as_trackeval(truth: Trace, tracks: Tracks) -> dict[str, object]:
    """What TrackEval's datasets hand to `eval_sequence`."""
    truth_ids, truth_index = np.unique(truth.object_id, return_inverse=True)
    track_ids, track_index = np.unique(tracks.track_id, return_inverse=True)
    frames = [(truth.frame_rows(k), tracks.frame_rows(k)) for k in range(truth.n_frames)]
    places, estimates = (np.column_stack([table.x, table.y]) for table in (truth, tracks))
    distance = [np.linalg.norm(places[a][:, None] - estimates[b], axis=2) for a, b in frames]
    return {
        "num_timesteps": truth.n_frames,
        "num_gt_dets": len(truth),
        "num_tracker_dets": len(tracks),
        "num_gt_ids": len(truth_ids),
        "num_tracker_ids": len(track_ids),
        "gt_ids": [truth_index[a] for a, _ in frames],
        "tracker_ids": [track_index[b] for _, b in frames],
        "similarity_scores": [np.maximum(0.0, 1.0 - d / 2.0) for d in distance],
    }


def test_the_gaps_that_are_scored_are_those_that_were_hidden(
    real: tuple[Trace, Detections],
) -> None:
    """The gaps arrive with the tracks as the protocol found them in the detections."""
    trace, detections = real
    tracks = mdkf.Tracker(mdkf.estimator("ca")).run(PROTOCOL.apply(detections))
    expected = PROTOCOL.gaps(detections)
    found = score(trace, tracks).gaps
    for name in ("object_id", "start", "stop"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    assert len(found) >= 5


def test_nothing_is_lost_that_does_not_reappear() -> None:
    """After a late gap the object is never detected again: neither lost nor an error after."""
    rows = [(k, 1, 0.3 * k, 5.0) for k in range(80)]
    told = {"occlusion": json.dumps({"protocol": "late:20:35", "gaps": [[1, 45, 65]]})}
    tracks = tracks_of(rows, 80, [k >= 45 for k in range(80)], told)
    result = score(trace_of(rows, 80), tracks, OcclusionProtocol("late", 20, 35))
    summary = result.summary()
    assert np.isnan(summary["lost"])
    assert np.isnan(summary["error_after"])
    assert summary["error_gap"] == 0.0
    assert result.errors["offset"].max() == 19
