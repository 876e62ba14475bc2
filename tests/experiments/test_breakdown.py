"""Claim: a breakdown's bins are of the rows that their names say, what they count adds up to the
whole, and a bin without rows has no value."""

import dataclasses
import json
import math
from typing import Any

import numpy as np
import polars as pl
import pytest
from trackeval.metrics import HOTA

import mdkf
import scenarios
import sim_bridge
from experiments import OcclusionProtocol, score
from experiments.breakdown import SCHEMA
from mdkf.tables import REGIMES, Trace, Tracks
from tests.experiments.test_score import as_trackeval
from tests.tables import Rows, trace_of, tracks_of

PARTITIONS = {
    "phase": ("in view", "before", "gap", "after"),
    "regime": tuple(name.replace("_", " ") for name in REGIMES),
    "range": ("0-30 m", "30-50 m", "50+ m"),
}
GAP_PARTS = ("gap 1-5", "gap 6-10", "gap 11-20", "gap 21-40", "gap 41+")
PER_TRACK = ("hota", "assa", "mota", "gospa_false")
"""Scores that need to know where a track on nothing belongs."""


@pytest.fixture(scope="module")
def real() -> tuple[Trace, Tracks]:
    """Fifteen seconds of traffic at a bus stop, half of whose objects are hidden for two."""
    scenario = dataclasses.replace(scenarios.load("bus_stop"), duration=15.0)
    trace = sim_bridge.simulate(scenario, 1)
    seen = OcclusionProtocol("mid", 20, 35).apply(sim_bridge.detect(trace, seed=1))
    return trace, mdkf.Tracker(mdkf.estimator("md")).run(seen)


def breakdown(
    trace: Trace, tracks: Tracks, group: str, gap_truth: Any = "keep", similarity: Any = "centre"
) -> pl.DataFrame:
    """Everything and the bins of one group."""
    return score(trace, tracks, None, gap_truth, similarity).by(group)


def value(table: pl.DataFrame, bin_name: str, name: str, column: str = "value") -> Any:
    """One score of one bin."""
    (row,) = table.filter(bin=bin_name, score=name).to_dicts()
    return row[column]


def total(table: pl.DataFrame, name: str, of: tuple[str, ...], power: float = 1.0) -> float:
    """Sum over bins of the value's p-th power times its samples, as sums are what adds up."""
    rows = table.filter(pl.col("bin").is_in(of), score=name).to_dicts()
    return math.fsum(row["value"] ** power * row["n"] for row in rows if row["n"])


@pytest.mark.parametrize("similarity", ["centre", "bird", "box"])
@pytest.mark.parametrize("convention", ["keep", "ignore"])
def test_everything_is_what_score_tells(
    real: tuple[Trace, Tracks], convention: Any, similarity: Any
) -> None:
    """The first bin of any breakdown, score by score."""
    table = breakdown(*real, "level", convention, similarity)
    summary = score(*real, gap_truth=convention, similarity=similarity).summary()
    found = {row["score"]: row["value"] for row in table.filter(bin="all").to_dicts()}
    assert len(found) == 17
    assert found == pytest.approx({name: summary[name] for name in found}, rel=1e-12)
    assert table.schema == pl.Schema(SCHEMA)
    assert table["bin"][0] == "all"


@pytest.mark.parametrize("by", PARTITIONS)
def test_bins_add_up_to_the_whole(real: tuple[Trace, Tracks], by: str) -> None:
    """Rows, misses, identity switches, GOSPA's costs, errors and NEES of bins that share no row
    and leave none out; by range, where tracks on nothing have a bin, what MOTA counts as well."""
    table = breakdown(*real, by)
    bins = PARTITIONS[by]
    counts = ["miss_rate", "position_error", "velocity_error", "heading_error", "nees", "nis"]
    for name in [*counts, *(("mota",) if by == "range" else ())]:
        assert total(table, name, bins) == pytest.approx(total(table, name, ("all",)), rel=1e-9)
        rows = table.filter(pl.col("bin").is_in(bins), score=name)
        assert rows["n"].sum() == value(table, "all", name, "n") > 1000
    switches = [value(table, name, "idsw") or 0 for name in bins]
    assert sum(switches) == value(table, "all", "idsw") > 0
    parts = ["localisation", "missed"] + ["false"] * (by == "range")
    for part in parts:
        found, whole = (total(table, f"gospa_{part}", of, 2.0) for of in (bins, ("all",)))
        assert found == pytest.approx(whole, rel=1e-9)


def test_a_gaps_parts_add_up_to_it(real: tuple[Trace, Tracks]) -> None:
    """Misses and errors by frames since it began."""
    table = breakdown(*real, "phase")
    for name in ("miss_rate", "position_error", "nees"):
        assert total(table, name, GAP_PARTS) == pytest.approx(
            total(table, name, ("gap",)), rel=1e-9
        )
    assert value(table, "gap", "miss_rate", "n") > 100


def test_scores_that_need_a_place_for_false_tracks_have_one(real: tuple[Trace, Tracks]) -> None:
    """Ranges and levels have one; phases and regimes have not, so there is no such score, and
    in natural occlusions no track is asked for."""
    for group in ("range", "level"):
        rows = breakdown(*real, group).filter(pl.col("score").is_in(PER_TRACK))
        assert rows["value"].null_count() == 0
        assert len(rows) == len(PER_TRACK) * (4 if group == "range" else 3)
    for group in ("phase", "regime"):
        rows = breakdown(*real, group).filter(pl.col("score").is_in(PER_TRACK))
        assert set(rows["bin"]) == {"all"}
    hidden = breakdown(*real, "phase").filter(bin="occluded")
    assert set(hidden["score"]) == {
        *("position_error", "position_rmse", "velocity_error", "velocity_rmse"),
        *("heading_error", "backwards", "nees", "nis"),
    }
    assert hidden["n"].min() > 0


def test_a_track_belongs_where_its_object_is_and_on_nothing_where_it_is_itself() -> None:
    """Frame 0: an object at 29.8 m whose track is at 30.2 m; it is found, at 0-30 m. An object at
    40 m is missed; tracks at 10 m and 55 m are on nothing. MOTA: 1 - 1/1 at 0-30 m, 1 - 1/1 at
    30-50 m; no truth beyond, so no value; but a false track costs GOSPA 2 m^2."""
    trace = trace_of([(0, 1, 29.8, 0.0), (0, 2, 40.0, 0.0)], 1)
    tracks = tracks_of([(0, 1, 30.2, 0.0), (0, 2, 10.0, 0.0), (0, 3, 0.0, 55.0)], 1)
    table = breakdown(trace, tracks, "range")
    found = {name: value(table, name, "mota") for name in PARTITIONS["range"]}
    assert found == {"0-30 m": 0.0, "30-50 m": 0.0, "50+ m": None}
    rates = {name: value(table, name, "miss_rate") for name in PARTITIONS["range"]}
    assert rates == {"0-30 m": 0.0, "30-50 m": 100.0, "50+ m": None}
    parts = {
        "0-30 m": (0.4, 0.0, math.sqrt(2)),
        "30-50 m": (0.0, math.sqrt(2), 0.0),
        "50+ m": (0.0, 0.0, math.sqrt(2)),
    }
    for name, expected in parts.items():
        whole = [value(table, name, f"gospa_{p}") for p in ("localisation", "missed", "false")]
        assert whole == pytest.approx(expected), name


@pytest.mark.parametrize(
    ("x", "expected"),
    [(29.999, "0-30 m"), (30.0, "30-50 m"), (49.999, "30-50 m"), (50.0, "50+ m"), (60.0, "50+ m")],
)
def test_ranges_hold_their_near_end(x: float, expected: str) -> None:
    """From the sensor, where it is in that frame."""
    trace = trace_of([(5, 1, x + 5.0, 0.0)], 6, ego=1.0)
    table = breakdown(trace, tracks_of([], 6), "range")
    counts = {name: value(table, name, "miss_rate", "n") for name in PARTITIONS["range"]}
    assert counts == dict.fromkeys(counts, 0) | {expected: 1}


def test_level_2_includes_level_1() -> None:
    """Half visible is LEVEL_1, less is LEVEL_2 only, below 0.15 neither. A track on truth of
    LEVEL_2 only is ignored at LEVEL_1, one on nothing is false at both levels."""
    rows = [(0, 1, 10.0, 0.0), (0, 2, 10.0, 9.0), (0, 3, 10.0, 18.0), (0, 4, 10.0, 27.0)]
    trace = trace_of(rows, 1, visible=[1.0, 0.5, 0.4999, 0.1])
    tracks = tracks_of([(0, 1, 10.0, 0.0), (0, 3, 10.0, 18.0), (0, 9, 30.0, 0.0)], 1)
    table = breakdown(trace, tracks, "level")
    level_1, level_2 = (
        [value(table, level, name) for name in ("mota", "miss_rate")]
        for level in ("LEVEL_1", "LEVEL_2")
    )
    assert [value(table, f"LEVEL_{k}", "mota", "n") for k in (1, 2)] == [2, 3]
    assert level_1 == pytest.approx([100 * (1 - 2 / 2), 50.0])
    assert level_2 == pytest.approx([100 * (1 - 2 / 3), 100 / 3])


GAP = [(1, 30, 75)]


def hidden_car() -> tuple[Trace, Tracks]:
    """A car 10 m away for 120 frames, hidden by the protocol in frames 30 to 74, out of view in the
    last five of them and in frames 100 to 109; its track is k / 100 m off in frame k."""
    rows = [(k, 1, 10.0, 0.0) for k in range(120)]
    hidden = {*range(70, 75), *range(100, 110)}
    trace = trace_of(rows, 120, visible=[0.0 if k in hidden else 1.0 for k, *_ in rows])
    told = {"occlusion": json.dumps({"protocol": "mid:45:20", "gaps": GAP})}
    return trace, tracks_of([(k, 1, x, k / 100) for k, _, x, _ in rows], 120, provenance=told)


def test_phases_are_frames_around_the_gap() -> None:
    """Ten frames before and after it, its own by their count, the natural occlusion, and what is
    left: by the mean error, which tells the frames."""
    frames = {
        "before": range(20, 30),
        "gap": range(30, 75),
        "gap 1-5": range(30, 35),
        "gap 6-10": range(35, 40),
        "gap 11-20": range(40, 50),
        "gap 21-40": range(50, 70),
        "gap 41+": range(70, 75),
        "after": range(75, 85),
        "occluded": range(100, 110),
        "in view": [*range(20), *range(85, 100), *range(110, 120)],
    }
    table = breakdown(*hidden_car(), "phase")
    assert set(table["bin"]) == {"all", *frames}
    for name, own in frames.items():
        assert value(table, name, "position_error", "n") == len(own), name
        assert value(table, name, "position_error") == pytest.approx(np.mean(own) / 100), name
    assert value(table, "all", "position_error", "n") == 110


def test_what_is_between_two_gaps_of_an_object_is_in_neither() -> None:
    """Frames 80 to 84 lie after the first and before the second, which begins within a second; the
    gaps' own frames stay theirs."""
    trace, tracks = hidden_car()
    told = {"occlusion": json.dumps({"protocol": "mid:45:20", "gaps": [(1, 85, 95), (1, 60, 80)]})}
    table = breakdown(trace, dataclasses.replace(tracks, provenance=told), "phase")
    frames = {
        name: value(table, name, "position_error", "n") for name in ("before", "gap", "after")
    }
    assert sum(frames.values()) == 10 + 20 + 5 + 10 + 5
    assert frames["gap"] == 30
    assert value(table, "gap 1-5", "position_error") == pytest.approx((0.62 + 0.87) / 2)


def test_a_late_gap_has_nothing_after_it() -> None:
    """Its object is never detected again."""
    trace, tracks = hidden_car()
    told = {"occlusion": json.dumps({"protocol": "late:45:20", "gaps": GAP})}
    table = breakdown(trace, dataclasses.replace(tracks, provenance=told), "phase")
    assert value(table, "after", "position_error", "n") == 0
    assert value(table, "in view", "position_error", "n") == 55


def test_gaps_that_are_ignored_have_no_value() -> None:
    """By the other convention truth there does not count; it is no natural occlusion either."""
    table = breakdown(*hidden_car(), "phase", "ignore")
    assert value(table, "occluded", "position_error", "n") == 10
    for name in ("gap", *GAP_PARTS):
        rows = table.filter(bin=name)
        assert rows["value"].null_count() == len(rows) > 0
        assert rows["n"].sum() == 0


def test_regimes_and_turning_are_the_truths() -> None:
    """Twenty frames of each regime in turn, of the unknown one too; a quarter of them turns. Of
    an unknown regime nobody knows whether it turns."""
    rows = [(k, 1, 10.0, 0.0) for k in range(100)]
    regime = np.repeat(np.arange(5), 20)
    trace = trace_of(rows, 100, regime=regime, turning=np.arange(100) % 4 == 0)  # type: ignore
    tracks = tracks_of([(k, 1, 10.0, 0.1 * r) for k, r in enumerate(regime)], 100)
    table = breakdown(trace, tracks, "regime")
    for code, name in enumerate(PARTITIONS["regime"]):
        assert value(table, name, "position_error") == pytest.approx(0.1 * code)
        assert value(table, name, "position_error", "n") == 20
    counts = [value(table, name, "miss_rate", "n") for name in ("turning", "not turning")]
    assert counts == [20, 60]


def test_several_groups_give_their_products(real: tuple[Trace, Tracks]) -> None:
    """3 ranges x 2 levels, as Waymo's table has them; LEVEL_2 of a range is the range."""
    table = breakdown(*real, "range,level")
    names = [f"{near}, LEVEL_{k}" for near in PARTITIONS["range"] for k in (1, 2)]
    assert table["bin"].unique(maintain_order=True).to_list() == ["all", *names]
    assert table["group"].unique(maintain_order=True).to_list() == ["all", "range,level"]
    by_range = breakdown(*real, "range")
    for near in PARTITIONS["range"]:
        own, whole = table.filter(bin=f"{near}, LEVEL_2"), by_range.filter(bin=near)
        assert own.drop("group", "bin").equals(whole.drop("group", "bin"))
        easy = value(table, f"{near}, LEVEL_1", "miss_rate", "n")
        assert 0 < easy <= value(by_range, near, "miss_rate", "n")
    crossed = breakdown(*real, "phase,range")
    assert not crossed.filter(bin="occluded, 0-30 m", score="position_error").is_empty()
    parts = tuple(f"{name}, 0-30 m" for name in PARTITIONS["phase"])
    assert total(crossed, "miss_rate", parts) == pytest.approx(
        total(by_range, "miss_rate", ("0-30 m",))
    )


def test_hota_and_assa_of_a_range_are_trackevals() -> None:
    """Cars from 10 to 55 m, whose tracks are up to 1.5 m off, missing now and then and swapped
    half-way through, and tracks on nothing 15 m beside: TrackEval is given one range's rows."""
    rng = np.random.default_rng(5)
    places = {1: 10.0, 2: 20.0, 3: 35.0, 4: 45.0, 5: 55.0}
    truth: Rows = [(k, i, x, 0.0) for k in range(60) for i, x in places.items()]
    swapped = {1: 2, 2: 1, 3: 4, 4: 3, 5: 5}
    rows = [
        (k, i if k < 30 else swapped[i], x, float(rng.uniform(-1.5, 1.5)))
        for k, i, x, _ in truth
        if rng.random() < 0.9
    ]
    rows += [(k, 100 + i, x, 15.0) for k, i, x, _ in truth if k % 10 < i]
    trace, tracks = trace_of(truth, 60), tracks_of(rows, 60)
    table = breakdown(trace, tracks, "range")
    for name, near, far in (("0-30 m", 0, 30), ("30-50 m", 30, 50), ("50+ m", 50, 61)):
        own = trace.take((trace.x >= near) & (trace.x < far))
        data = as_trackeval(own, tracks.take((tracks.x >= near) & (tracks.x < far)))
        whole = HOTA().eval_sequence(data)
        for score_name, official in (("hota", "HOTA"), ("assa", "AssA")):
            expected = 100 * np.mean(whole[official])
            assert value(table, name, score_name) == pytest.approx(expected, rel=1e-12)
            assert 0 < expected < 100


def test_without_tracks_misses_have_a_value_and_errors_have_none(
    real: tuple[Trace, Tracks],
) -> None:
    """Everything is missed; there is no estimate whose error could be told."""
    trace, _ = real
    table = breakdown(trace, tracks_of([], trace.n_frames), "range")
    assert value(table, "0-30 m", "miss_rate") == 100.0
    assert value(table, "0-30 m", "mota") == 0.0
    for name in ("position_error", "nees", "nis", "heading_error", "backwards"):
        assert value(table, "0-30 m", name) is None
        assert value(table, "0-30 m", name, "n") == 0
        assert value(table, "0-30 m", name, "verdict") is None


def test_consistency_comes_with_its_interval_and_verdict(real: tuple[Trace, Tracks]) -> None:
    """NEES and NIS only."""
    table = breakdown(*real, "range")
    with_interval = table.filter(pl.col("low").is_not_null())
    assert set(with_interval["score"]) == {"nees", "nis"}
    for row in with_interval.to_dicts():
        assert row["low"] < 2 < row["high"]
        side = (row["value"] > row["high"]) - (row["value"] < row["low"])
        assert row["verdict"] == ("consistent", "optimistic", "pessimistic")[side]
    assert table.filter(pl.col("low").is_null())["verdict"].null_count() > 0


def test_several_breakdowns_are_one_table(real: tuple[Trace, Tracks]) -> None:
    """Everything once, then each group's bins as they are alone."""
    both = score(*real).by("phase", "range,level")
    alone = [breakdown(*real, group) for group in ("phase", "range,level")]
    expected = pl.concat([alone[0], alone[1].filter(pl.col("group") != "all")])
    assert both.equals(expected)
    assert score(*real).by("phase", "range,level", "phase").equals(expected)
    assert score(*real).by().equals(expected.filter(group="all"))


@pytest.mark.parametrize("by", ["speed", "", "range,range", "range,"])
def test_unknown_groups_are_refused(real: tuple[Trace, Tracks], by: str) -> None:
    """The error lists those that there are."""
    with pytest.raises(ValueError, match="expected different ones of phase, regime, range, level"):
        breakdown(*real, by)


def test_unknown_similarities_are_refused(real: tuple[Trace, Tracks]) -> None:
    """An image's, of which a world knows nothing, too."""
    with pytest.raises(ValueError, match="similarity 'image', expected one of"):
        score(*real, similarity="image")  # type: ignore[arg-type]
