"""Claim: `mdkf bench` compares like with like, and says what it measured. Nothing here is timed."""

import gc
import json
import subprocess
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mdkf
from experiments.bench import (
    command,
    filters,
    recordings,
    scoring,
    sensing,
    simulation,
    targets,
    trackers,
)
from experiments.bench.measure import Block, Case, Summary, measure, paired, summary
from experiments.bench.parts import PARTS
from experiments.bench.plan import Plan
from experiments.bench.results import Results
from experiments.metrics import bird_iou
from scenarios.kitti import kitti_names
from sim_bridge import simulate
from sim_bridge.line_of_sight import visible_fractions
from sim_bridge.overlap import first_overlap
from tests.experiments.commands import Mdkf
from tests.sim_bridge.kitti_folder import FOUND, GOOD, written

TINY = Plan(
    rounds=2,
    processes=1,
    shortest=0.0,
    tracks=(1, 10, 50),
    reference=(1, 10),
    steps=15,
    updates=0,
    passes=15,
    objects=(4,),
    frames=12,
    crowds=(5,),
    scored=10,
    boxes=9,
    simulated=2.0,
    seeds=1,
    driven=("stationary",),
    drives=1,
)
KEYS = [
    *("what", "name", "tier", "size", "median", "unit", "ratio", "ratio_to"),
    *("low", "high", "ratio_low", "ratio_high"),
]
WORDS = ("filter", "filter-ratio", "tracker", "tracker-ratio", "scoring", "line-of-sight")


class FakeTime:
    """A clock that moves when a case says so, and a record of what was run."""

    def __init__(self) -> None:
        self.now = 0.0
        self.order: list[str] = []

    def __call__(self) -> float:
        return self.now

    def case(self, name: str, costs: Iterator[float], work: float = 1.0, **key: Any) -> Case:
        """A case whose runs cost so much, one after another; preparing costs 1000."""

        def prepare() -> str:
            self.now += 1000.0
            return name

        def run(given: str) -> None:
            assert given == name
            self.order.append(name)
            self.now += next(costs)

        row = {"what": "filter", "tier": "kernel", "size": 50} | key
        return Case(**row, name=name, work=work, unit="s", per_second=1.0, prepare=prepare, run=run)


def test_time_is_per_unit_of_work_without_preparation_and_first_runs() -> None:
    """The warm-up's cost is in no sample, nor is what happens before the clock starts."""
    clock = FakeTime()
    case = clock.case("a", iter([99.0, 4.0, 6.0, 8.0]), work=2.0)
    samples = measure([Block((case,))], rounds=3, shortest=0.0, clock=clock)
    np.testing.assert_allclose(samples[case], [2.0, 3.0, 4.0])


def test_a_measurement_repeats_short_runs() -> None:
    """As many runs as fill the shortest time by the second run; the sample is their mean."""
    clock = FakeTime()
    case = clock.case("a", iter([99.0, 0.4, 1.0, 2.0, 6.0, 3.0, 3.0, 3.0]))
    samples = measure([Block((case,))], rounds=2, shortest=1.0, clock=clock)
    np.testing.assert_allclose(samples[case], [3.0, 3.0])
    assert len(clock.order) == 2 + 2 * 3


def test_ratios_are_formed_within_rounds() -> None:
    """A machine that slows down tenfold from round to round leaves a ratio of 3 exact."""
    clock = FakeTime()
    pace = [7.0, 1.0, 10.0, 0.1, 4.0, 1.0]
    fast = clock.case("fast", iter(pace))
    slow = clock.case("slow", iter(3.0 * p for p in pace))
    block = Block((fast, slow), anchor=slow, ratios=((slow, fast),))
    results = Results((block,), measure([block], rounds=5, shortest=0.0, clock=clock))
    first, second, cost = results.rows()
    expected = np.array(pace[1:])
    assert first.median == pytest.approx(np.median(expected))
    assert (first.low, first.high) == pytest.approx(tuple(np.percentile(expected, (10, 90))))
    assert (first.ratio, first.ratio_low, first.ratio_high) == pytest.approx((3.0, 3.0, 3.0))
    assert first.ratio_to == "kernel slow, 50"
    assert (second.ratio, second.ratio_to) == (None, None)
    assert (cost.what, cost.name, cost.unit, cost.ratio_to) == (
        *("filter-ratio", "slow/fast", "1", "fast"),
    )
    assert (cost.median, cost.low, cost.high, cost.ratio) == pytest.approx((3.0, 3.0, 3.0, 3.0))


def test_a_paired_ratio_is_no_ratio_of_medians() -> None:
    """The median of the quotients, by hand."""
    first, second = np.array([1.0, 8.0, 9.0]), np.array([1.0, 2.0, 9.0])
    assert paired(first, second).median == 1.0
    assert summary(first).median / summary(second).median == 4.0
    assert summary(np.arange(11.0)) == Summary(5.0, 1.0, 9.0)


def test_cases_are_interleaved_by_block_in_changing_order() -> None:
    """Each round has every case once, blocks together, in an order that is drawn anew and the
    same again in the next run."""
    rounds = 8

    def orders() -> list[list[str]]:
        clock = FakeTime()
        cases = [clock.case(name, repeat(1.0)) for name in "abcdef"]
        blocks = [Block(tuple(cases[:3])), Block(tuple(cases[3:5]), anchor=cases[5])]
        measure(blocks, rounds, shortest=0.0, clock=clock)
        ran = clock.order[len(cases) :]  # without the warm-up
        return [ran[k : k + len(cases)] for k in range(0, len(ran), len(cases))]

    drawn = orders()
    assert len(drawn) == rounds
    for order in drawn:
        assert sorted(order) == list("abcdef")
        assert set(order[:3]) in ({*"abc"}, {*"def"})
    assert len({tuple(order) for order in drawn}) > rounds / 2
    assert drawn == orders()


def test_measuring_leaves_the_garbage_collector_as_it_was() -> None:
    """Off while the clock runs, on again afterwards, also after an error."""
    seen: list[bool] = []

    def run(_: None) -> None:
        seen.append(gc.isenabled())
        if len(seen) == 3:
            raise RuntimeError

    case = Case("filter", "a", "kernel", 1, 1.0, "s", 1.0, lambda: None, run)
    with pytest.raises(RuntimeError):
        measure([Block((case,))], rounds=3, shortest=0.0)
    assert gc.isenabled()
    assert not any(seen)


@pytest.mark.parametrize("block", filters.blocks(TINY), ids=lambda block: str(block.cases[0].size))
def test_all_tiers_compute_the_same_positions(block: Block) -> None:
    """filterpy, numpy, call by call and compiled pass: within 1e-6 m after the same steps."""
    answers: dict[str, dict[str, Any]] = defaultdict(dict)
    for case in block.timed():
        if case.size == block.cases[0].size:
            assert case.work == TINY.steps * case.size
            answers[case.name][case.tier] = case.run(case.prepare())
    assert set(answers) >= set(filters.NAMES)
    for name, by_tier in answers.items():
        expected = by_tier[filters.CALLS]
        assert expected.shape == (block.cases[0].size, 2)
        assert np.isfinite(expected).all()
        for tier, positions in by_tier.items():
            np.testing.assert_allclose(positions, expected, rtol=0, atol=1e-6, err_msg=name + tier)


def test_the_reference_tier_has_every_kind_of_filter() -> None:
    """What a tier's ratios need: CA, MD and an IMM on the same objects."""
    at_ten = next(block for block in filters.blocks(TINY) if block.cases[0].size == 10)
    ratios = {(a.tier, a.name, b.name) for a, b in at_ten.ratios}
    assert {(tier, "md", "ca") for tier in filters.TIERS} <= ratios
    assert {("filterpy", "imm-zero", "md"), ("numpy", "imm", "md")} <= ratios


def test_filters_work_on_moving_and_standing_objects() -> None:
    """MD's weights are below 1 for some tracks and 1 for others: both branches are measured."""
    z = filters.measurements(40, 60)
    md = mdkf.MotionDynamics()
    noise = np.tile(filters.R, (40, 1, 1))
    state = md.start(z[0], noise)
    for seen in z[1:]:
        state = md.update(md.predict(state, filters.DT), seen, noise)
    damped = state.weight[:, :, 1] < 1.0
    assert 0.1 < damped.mean() < 0.9


def test_the_tracker_follows_the_objects_of_its_workload() -> None:
    """Every filter has a track within a metre of nine of ten true detections in the last frame,
    and the workload has misses and false boxes."""
    seen = trackers.detections(50, 60)
    assert seen == trackers.detections(50, 60)
    false = seen.source == mdkf.CLUTTER
    assert 0.02 < false.sum() / len(seen) < 0.1
    assert len(seen) - false.sum() < 50 * 60
    last = seen.between(59, 60)
    true = np.column_stack([last.x, last.y])[last.source != mdkf.CLUTTER]
    for name in trackers.NAMES:
        tracks = mdkf.Tracker(mdkf.estimator(name), trackers.DETECTOR).run(seen).between(59, 60)
        distance = np.hypot(*(true[:, None] - np.column_stack([tracks.x, tracks.y])).T)
        assert (distance.min(axis=0) < 1.0).mean() > 0.9, name


def test_recorded_detections_are_tracked_where_their_settings_are_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Folders of other detectors may lie beside RobMOT's."""
    split = {"evaluate_tracking.seqmap.val": GOOD["evaluate_tracking.seqmap.training"]}
    found = {f"detections/{name}/0003.txt": GOOD[FOUND] for name in ("pvcnn", "second")}
    monkeypatch.setenv("MDKF_KITTI", str(written(tmp_path, {**GOOD, **split, **found})))
    blocks = recordings.blocks(TINY)
    assert [block.cases[0].tier for block in blocks] == ["pvcnn", "second"]


@pytest.mark.parametrize("objects", [20, 200])
def test_scoring_and_trackeval_agree_on_the_workload(objects: int) -> None:
    """The same HOTA, MOTA and IDF1, none perfect, of a crowd: many people are near to others."""
    block, _ = scoring.blocks(replace(TINY, crowds=(objects,), scored=200))
    ours, theirs = (case.run(case.prepare()) for case in block.cases)
    assert block.anchor is block.cases[1]
    hota, clear, identity = ours
    expected = np.mean(theirs[0]["HOTA"]), theirs[1]["MOTA"], theirs[2]["IDF1"]
    assert (hota.hota_mean, clear.mota, identity.idf1) == pytest.approx(expected, abs=1e-12)
    assert 0.2 < identity.idf1 < 0.95
    assert clear.idsw > 0
    per_object = np.diff(scoring.sequence(objects, 200).pairs.start)
    assert (per_object > 1).mean() > 0.25


def test_boxes_in_the_jam_overlap_their_own_and_little_else() -> None:
    """Every true box has its track, and some reach into their neighbours."""
    truth, track = scoring.jam(200, 0)
    overlap = bird_iou(truth, track)
    assert (overlap.diagonal() > 0.3).all()
    assert 200 < (overlap > 0.0).sum() < 400


def test_boxes_stand_apart_and_hide_each_other() -> None:
    """200 boxes without an overlap; some are seen whole, some in part, some not at all."""
    boxes = sensing.scene(200, 0)
    assert boxes.shape == (200, 7)
    assert first_overlap(np.array([0, 200]), boxes[:, [0, 1, 3, 4, 5]]) == (-1, -1)
    fractions = visible_fractions([sensing.SENSOR], [0, 200], boxes)
    assert (fractions == 1.0).any()
    assert ((fractions > 0.01) & (fractions < 0.99)).any()
    assert (fractions < 0.01).any()


def test_the_simulated_world_is_as_dense_as_it_says() -> None:
    """About 200 objects in every frame, and SUMO alone runs on the same inputs."""
    dense = simulation.world(3.0)
    per_frame = np.bincount(simulate(dense, simulation.SEED).frame)
    assert len(per_frame) == 30
    assert abs(per_frame / simulation.VEHICLES - 1.0).max() < 0.15
    simulation.sumo_alone(dense)
    with pytest.raises(subprocess.CalledProcessError):
        simulation.sumo_alone(replace(dense, network=Path("no.net.xml")))


def test_targets_are_judged_by_the_median() -> None:
    """600 of 500 times is met, 150 of 200 is not, 1.9 of 2 is met but not clearly."""
    clock = FakeTime()

    def case(name: str, *costs: float, **key: Any) -> Case:
        return clock.case(name, iter([1.0, *costs]), **key)

    anchor = case("ca", 600.0, 600.0, 600.0, tier="filterpy", size=10)
    at_50 = Block((case("ca", 1.0, 1.0, 1.0), case("md", 4.0, 4.0, 4.0)), anchor)
    few = Block((case("ca", 1.0, 1.0, 1.0, size=1000), case("md", 1.0, 1.0, 1.0, size=1000)))
    many = Block((case("ca", 1.0, 1.0, 1.0, size=10_000), case("md", 1.8, 1.9, 2.9, size=10_000)))
    blocks = (at_50, few, many)
    judged = targets.targets(Results(blocks, measure(blocks, 3, 0.0, clock)))
    assert [t.median for t in judged] == pytest.approx([600.0, 150.0, 1.9])
    assert [(t.met, t.clear) for t in judged] == [(True, True), (False, True), (True, False)]


def test_the_papers_ratios() -> None:
    """1.84 and 3.02, from the latencies of its table."""
    assert {k: round(v, 2) for k, v in targets.PAPER_RATIOS.items()} == {
        "md/ca": 1.84,
        "imm/md": 3.02,
    }


@pytest.fixture
def tiny(monkeypatch: pytest.MonkeyPatch) -> None:
    """`--quick` is tiny."""
    monkeypatch.setattr(command, "QUICK", TINY)


@pytest.mark.usefixtures("tiny")
def test_the_document_has_rows_of_the_promised_form(mdkf_command: Mdkf) -> None:
    """One JSON document on standard output, all parts in it, finite positive numbers, and an
    exit status that no target decides."""
    answer = mdkf_command("bench", "--quick", "--json")
    assert (answer.status, answer.err) == (0, "")
    document = json.loads(answer.out)
    rows = document["rows"]
    recorded = {"recorded", "recorded-ratio"} if kitti_names() else set()
    assert {row["what"] for row in rows} == {
        *(*WORDS, *recorded, "simulation", "start-up", "sweep", "scaling")
    }
    for row in rows:
        assert list(row) == KEYS
        assert 0 < row["low"] <= row["median"] <= row["high"] < np.inf
        assert (row["ratio"] is None) == (row["ratio_to"] is None)
        if row["ratio"] is not None:
            assert 0 < row["ratio_low"] <= row["ratio"] <= row["ratio_high"] < np.inf
        if row["what"].endswith("-ratio"):
            assert row["unit"] == "1"
            assert row["ratio"] == row["median"]
            assert row["name"].split("/")[1] == row["ratio_to"]
    keys = [(row["what"], row["name"], row["tier"], row["size"]) for row in rows]
    assert len(set(keys)) == len(keys)
    for size in TINY.tracks:
        for name in filters.NAMES:
            assert {("filter", name, "calls", size), ("filter", name, "kernel", size)} <= set(keys)
    compared = [r for r in rows if r["what"] == "filter" and r["ratio_to"] is not None]
    assert {row["ratio_to"] for row in compared} == {"filterpy ca, 10"}
    assert ("filter", "ca", "filterpy", 50) not in keys
    assert {"numpy", "numba", "rounds"} <= set(document["setting"])
    assert not all(target["met"] for target in document["targets"])


@pytest.mark.usefixtures("tiny")
def test_the_tables_fit_in_120_columns(mdkf_command: Mdkf) -> None:
    """With the setting above them, the paper's ratios and the targets; nothing is cut off."""
    answer = mdkf_command("bench", "--quick", "--only", "filter,tracker,scoring,line-of-sight")
    assert (answer.status, answer.err) == (0, "")
    assert max(map(len, answer.out.splitlines())) <= 120
    assert "…" not in answer.out
    for text in ("CPU time of one thread, 2 interleaved rounds", "numba", "1.84", "3.02", "≥ 500"):
        assert text in answer.out


@pytest.mark.usefixtures("tiny")
@pytest.mark.parametrize(
    ("only", "expected"),
    [("line-of-sight", {"line-of-sight"}), (" scoring , tracker", set(WORDS[2:5]))],
)
def test_only_restricts(mdkf_command: Mdkf, only: str, expected: set[str]) -> None:
    """To the named parts, in any order; targets of the others are not shown."""
    document = json.loads(
        mdkf_command("bench", "--quick", "--json", "--rounds", "1", "--only", only).out
    )
    assert {row["what"] for row in document["rows"]} == expected
    assert document["targets"] == []
    assert document["setting"]["rounds"] == 1


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (("--only", "filtre"), ("unknown part 'filtre'", "did you mean 'filter'?", *PARTS)),
        (("--only", ""), ("unknown part ''",)),
        (("--rounds", "0"), ("--rounds",)),
    ],
)
def test_bad_options_are_one_line(
    mdkf_command: Mdkf, arguments: tuple[str, ...], parts: tuple[str, ...]
) -> None:
    """Exit status 2, before anything is measured."""
    answer = mdkf_command("bench", *arguments)
    assert (answer.status, answer.out) == (2, "")
    assert answer.err.count("\n") == 1
    assert answer.err.startswith("mdkf: ")
    for part in parts:
        assert part in answer.err


def test_progress_is_told_in_order() -> None:
    """From above 0 to 1, rising."""
    clock = FakeTime()
    told: list[float] = []
    blocks = [Block((clock.case(name, repeat(1.0)),)) for name in "abc"]
    measure(blocks, 4, 0.0, clock, told.append)
    assert told == sorted(told)
    assert told[0] > 0
    assert told[-1] == 1.0
