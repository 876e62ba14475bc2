"""Claim: several gaps of one object are told apart wherever gaps are measured."""

import json

import numpy as np
import polars as pl
import pytest

from experiments import score
from experiments.bins import around_gaps
from experiments.drift import drift, with_drift
from experiments.figures import gap_figure, mean_drift_figure
from experiments.kitti.gaps import gap_rows
from experiments.phases import WINDOW, gap_errors
from mdkf import Detections, Trace, Tracks, estimator
from tests.experiments.test_drift import SETTINGS, by_filterpy, scene
from tests.tables import gaps_of, trace_of, tracks_of

N = 80
FIRST, SECOND = (20, 30), (36, 46)
"""With six frames between them, fewer than are measured around a gap."""
GAPS = gaps_of((3, *FIRST), (3, *SECOND))


def trace() -> Trace:
    return trace_of([(k, 3, 0.5 * k, 4.0) for k in range(N)], N)


def tracks() -> Tracks:
    """On the object until it is lost in the second gap, 1 m off there and 0.5 m in the first; a new
    track takes over after that."""
    told = {"protocol": "mid:10:6:gaps=2", "gaps": GAPS.rows()}
    off = np.zeros(N)
    off[slice(*FIRST)], off[slice(*SECOND)] = 0.5, 1.0
    rows = [(k, 8 if k < 41 else 9, 0.5 * k + off[k], 4.0) for k in range(N) if not 41 <= k < 46]
    coasted = [20 <= k < 30 or 36 <= k < 46 for k, *_ in rows]
    return tracks_of(rows, N, coasted, provenance={"occlusion": json.dumps(told)})


def test_what_is_before_or_after_a_gap_is_in_no_other() -> None:
    """The frames between two gaps are after the one and before the other, and in neither."""
    errors = gap_errors(trace(), tracks(), GAPS)
    frames = {
        (start, phase): own["frame"].to_list()
        for (start, phase), own in errors.group_by("gap_start", "phase", maintain_order=True)
    }
    assert frames == {
        (20, "before"): list(range(20 - WINDOW, 20)),
        (20, "gap"): list(range(*FIRST)),
        (20, "after"): list(range(30, 36)),
        (36, "before"): list(range(30, 36)),
        (36, "gap"): list(range(*SECOND)),
        (36, "after"): list(range(46, 46 + WINDOW)),
    }


def test_each_gap_has_its_own_fate_and_errors() -> None:
    """The track survives the first, and is deleted in the second."""
    errors = gap_errors(trace(), tracks(), GAPS)
    by_gap = errors.group_by("gap_start", maintain_order=True).agg(
        pl.col("deleted", "recovered", "captured").first(),
        pl.col("error").filter(phase="gap").mean(),
    )
    assert by_gap.rows() == [(20, False, True, False, 0.5), (36, True, False, False, 1.0)]


def test_a_summary_counts_gaps_and_not_objects() -> None:
    """One of two gaps: half of them are deleted, and lost; 0.5 m in ten frames, 1 m in five."""
    summary = score(trace(), tracks()).summary()
    assert (summary["gaps"], summary["followed"]) == (2.0, 2.0)
    assert (summary["deleted"], summary["lost"], summary["captured"]) == (50.0, 50.0, 0.0)
    assert summary["error_gap"] == pytest.approx((10 * 0.5 + 5 * 1.0) / 15)


def test_a_row_of_recorded_gaps_counts_gaps_and_not_objects() -> None:
    """The same of KITTI's table, whose intervals are over objects."""
    errors = gap_errors(trace(), tracks(), GAPS).with_columns(
        filter=pl.lit("ca"), sequence=pl.lit("0000"), drift=pl.lit(0.1)
    )
    (row,) = gap_rows(errors)
    assert (row["gaps"], row["followed"], row["deleted"], row["lost"]) == (2, 2, 50.0, 50.0)


def test_a_picture_of_mean_drift_counts_gaps_and_not_objects() -> None:
    """Of one object and seed, two."""
    errors = gap_errors(trace(), tracks(), GAPS).with_columns(
        scenario=pl.lit("road"), seed=pl.lit(0), filter=pl.lit("ca"), drift=pl.lit(0.1)
    )
    figure = mean_drift_figure(errors, ["ca"], 10, 0.1)
    assert figure is not None
    assert figure.axes[0].get_title() == "road: 2 gaps"


def test_natural_gaps_are_pictured_as_long_as_each_lasts() -> None:
    """One of 10 frames and one of 4: both to the fourth frame, one from there on, none after."""
    gaps = gaps_of((3, 20, 30), (3, 50, 54))
    errors = gap_errors(trace(), tracks(), gaps)
    grown = 0.1 * (pl.col("offset") + 1) * (1 + 2 * (pl.col("gap_start") == 50))
    errors = errors.with_columns(
        scenario=pl.lit("road"), seed=pl.lit(0), filter=pl.lit("ca"), drift=grown
    )
    figure = mean_drift_figure(errors, ["ca"], 20, 0.1, natural=True)
    assert figure is not None
    (line,) = figure.axes[0].get_lines()
    seconds, means = (np.asarray(values) for values in (line.get_xdata(), line.get_ydata()))
    nth = np.arange(1, 11)
    np.testing.assert_allclose(seconds[seconds > -0.05], 0.1 * (nth - 1))
    np.testing.assert_allclose(means[seconds > -0.05], 0.1 * nth * np.where(nth <= 4, 2, 1))


def test_a_picture_of_one_gap_shows_what_was_removed_for_another() -> None:
    """Frames 36 to 45 are hidden too, and drawn hollow beside the ten of the first gap."""
    truth = trace()
    names = ("frame", "x", "y", "z", "yaw", "length", "width", "height")
    columns = {name: getattr(truth, name) for name in names}
    columns |= {"source": truth.object_id, "score": np.ones(N)}
    everything = Detections.from_columns(columns, n_frames=N, dt=0.1)
    seen = everything.take(~GAPS.covers(everything.source, everything.frame))
    errors = gap_errors(truth, tracks(), GAPS).with_columns(filter=pl.lit("ca"))
    own = errors.filter(gap_start=FIRST[0])
    figure = gap_figure(truth, everything, seen, {"ca": tracks()}, own, (3, *FIRST))
    drawn = {part.get_label(): len(part.get_offsets()) for part in figure.axes[0].collections}
    assert drawn == {"detections": 60 - 20, "removed detections": 20}


def test_a_phase_is_that_of_the_gap_that_has_just_ended() -> None:
    """Every frame has one phase: between the gaps it is after the first."""
    around = around_gaps(trace(), GAPS)
    expected = np.full(N, "", dtype="<U6")
    for phase, start, stop in (
        ("before", 10, 20),
        ("gap", *FIRST),
        ("after", 30, 36),
        ("gap", *SECOND),
        ("after", 46, 56),
    ):
        expected[start:stop] = phase
    assert around.phase.tolist() == expected.tolist()
    nth = np.zeros(N, dtype=int)
    nth[slice(*FIRST)] = nth[slice(*SECOND)] = np.arange(1, 11)
    assert around.nth.tolist() == nth.tolist()


def test_drift_goes_on_through_all_gaps_of_an_object() -> None:
    """CA, one filterpy filter for the object, which is never deleted in either gap."""
    rows, seen = scene(0)
    first, second = range(30, 45), range(50, 62)
    kept = seen.take(~((seen.source == 1) & np.isin(seen.frame, [*first, *second])))
    gaps = gaps_of((1, 30, 45), (1, 50, 62))
    told = drift(trace_of(rows, 70), kept, gaps, estimator("ca"), SETTINGS)
    truth = {k: (x, y) for k, i, x, y in rows if i == 1}
    hidden = [*first, *second]
    expected = by_filterpy(kept, 1, truth, hidden)  # type: ignore[arg-type]
    assert told["frame"].to_list() == list(expected)
    np.testing.assert_allclose(told["drift"], list(expected.values()), rtol=1e-9, atol=1e-12)


def test_each_gap_has_the_drift_of_its_own_first_frames() -> None:
    """Of each gap the protocol's length is measured; a frame that is around both has one value."""
    errors = gap_errors(trace(), tracks(), GAPS)
    columns = {"object_id": [3] * N, "frame": list(range(N)), "drift": [0.01 * k for k in range(N)]}
    both = with_drift(errors, pl.DataFrame(columns), 4)
    assert len(both) == len(errors)
    in_gap = both.filter(phase="gap").drop_nulls("drift")
    assert in_gap["frame"].to_list() == [*range(20, 24), *range(36, 40)]
    np.testing.assert_allclose(in_gap["drift"], 0.01 * in_gap["frame"].to_numpy())
