"""Claim: the items of speed measure what they say, form ratios within rounds, and show the means
of what was measured. Nothing here depends on how long anything takes."""

import json
import resource
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from experiments.bench import filters
from experiments.bench.measure import Case
from experiments.jobs import ROWS, as_rows
from experiments.paper import speed_tables
from experiments.paper.item import Answer
from experiments.studies import speed, worlds
from experiments.studies.scale import QUICK
from experiments.studies.speed import FILTERS, LATENCY, RECORDED, TO_CA, TO_MD, TRACKER, Timing
from mdkf import MotionDynamics
from tests.sim_bridge.kitti_folder import FOUND, GOOD, written

ROUNDS = 3
ITEMS = {item.id: item for item in speed_tables.ITEMS}


@pytest.fixture(scope="module")
def measured() -> pl.DataFrame:
    """What is measured with one object, and the tracker with five."""
    jobs = (Timing(FILTERS, 1, ROUNDS), Timing(TRACKER, 1, ROUNDS), Timing(TRACKER, 5, ROUNDS))
    return pl.concat(job.rows() for job in jobs)


def values(rows: pl.DataFrame, **key: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    """The values of some rows, by round."""
    return rows.filter(**key).sort("seed")["value"].to_numpy()


def cell(answer: Answer, table: str, line: str, column: str) -> dict[str, Any]:
    """The one cell of a place."""
    (found,) = answer.cells.filter(table=table, line=line, column=column).to_dicts()
    return found


def case(name: str, tier: str, size: int) -> Case:
    """A case that is never run."""
    return Case("any", name, tier, size, 1, "s", 1.0, lambda: None, lambda _: None)


def test_times_become_microseconds_of_a_frame_and_ratios_within_rounds() -> None:
    """A machine ten times as slow in one round leaves the ratios exact; a filter's step of one of
    20 tracks is a twentieth of a frame, the tracker's unit of work is a frame."""
    pace = np.array([1.0, 10.0, 0.5])
    costs = {"ca": 1e-6, "imm": 6e-6, "md": 2e-6}
    samples = {case(name, "kernel", 20): cost * pace for name, cost in costs.items()}
    for part, objects in ((FILTERS, 20), (TRACKER, 1)):
        rows = as_rows(Timing(part, 20, ROUNDS).measured(samples))
        for name, cost in costs.items():
            found = values(rows, filter=name, metric=LATENCY)
            np.testing.assert_allclose(found, objects * cost * 1e6 * pace, rtol=1e-12)
            for metric, other in ((TO_CA, "ca"), (TO_MD, "md")):
                ratio = np.full(ROUNDS, cost / costs[other])
                found = values(rows, filter=name, metric=metric)
                np.testing.assert_allclose(found, ratio, rtol=1e-12)
        assert set(rows["scenario"]) == {"kernel" if part == FILTERS else TRACKER}
        assert set(rows["bin"]) == {"20 objects"}


def test_every_tier_and_filter_is_measured_in_every_round(measured: pl.DataFrame) -> None:
    """All four filters where they are; what filterpy and numpy have of IMM; nothing takes no
    time."""
    assert dict(measured.schema) == ROWS
    assert set(measured["study"]) == {speed.STUDY}
    expected = {
        "filterpy": {"ca", "imm-zero", "md"},
        "numpy": {"ca", "imm", "md"},
        **{tier: set(speed.NAMES) for tier in ("calls", "kernel", TRACKER)},
    }
    latency = measured.filter(metric=LATENCY)
    for tier, names in expected.items():
        assert set(latency.filter(scenario=tier)["filter"]) == names
    assert set(latency["scenario"]) == expected.keys()
    counts = latency.group_by("scenario", "bin", "filter").len()["len"]
    assert set(counts) == {ROUNDS}
    assert (latency["value"] > 0).all()
    for tier, names in expected.items():
        own = {"scenario": tier, "bin": "1 object"}
        ca = values(latency, **own, filter="ca")
        for name in names:
            ratio = values(measured, **own, filter=name, metric=TO_CA)
            np.testing.assert_allclose(ratio, values(latency, **own, filter=name) / ca, rtol=1e-12)


@pytest.mark.skipif(sys.platform != "linux", reason="of glibc")
def test_memory_is_not_fetched_anew_while_it_is_kept() -> None:
    """Arrays so large that they are otherwise given back each time: page faults of ten of them."""

    def faults() -> int:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
        for _ in range(10):
            np.ones(5_000_000)  # 40 MB
        return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

    with speed.memory_kept():
        faults()  # the first one has to be fetched
        kept = faults()
    assert kept < 20
    assert faults() > 10 * max(kept, 10)


def test_filters_are_measured_with_full_windows() -> None:
    """MD's work in most of the steps is that of a window that is full."""
    assert MotionDynamics().window + 2 < speed.PLAN.steps / 2
    assert speed.PLAN.reference == speed.FEW


def test_what_is_measured_is_alone_and_each_has_a_key_of_its_own() -> None:
    """At every scale; the key is JSON."""
    jobs = {job for item in ITEMS.values() for job in item.jobs(QUICK) if isinstance(job, Timing)}
    assert all(job.alone for job in jobs)
    assert {job.rounds for job in jobs} == {QUICK.rounds}
    assert len({json.dumps(job.key(), sort_keys=True) for job in jobs}) == len(jobs)
    assert {job.of for job in jobs if job.part == speed.TRAFFIC} == set(speed.DETECTORS)


def test_latency_by_objects_is_the_mean_over_rounds(measured: pl.DataFrame) -> None:
    """Each cell, its interval within what was measured, and ratios beside the paper's in words."""
    answer = speed_tables.by_objects(measured)
    own = {"scenario": TRACKER, "bin": "5 objects", "filter": "md"}
    table = "CPU time of a frame: whole tracker, compiled"
    found = cell(answer, table, "md", "5 objects")
    times = values(measured, **own, metric=LATENCY)
    assert found["value"] == pytest.approx(times.mean(), rel=1e-12)
    tolerance = 1e-9 * times.max()
    assert times.min() - tolerance <= found["low"] <= found["high"] <= times.max() + tolerance
    assert (found["n"], found["unit"], found["source"]) == (ROUNDS, "us", "machine")
    ratio = cell(answer, "ratios of CPU time", "tracker: md / ca", "5 objects")
    assert ratio["value"] == pytest.approx(values(measured, **own, metric=TO_CA).mean(), rel=1e-12)
    lines = set(answer.cells.filter(table="ratios of CPU time")["line"])
    assert {"filterpy: imm-zero / md", "numpy: imm / md", "kernel: md / ca"} <= lines
    assert not {"filterpy: imm / md", "numpy: imm-zero / md"} & lines
    # 1847 / 1003 and 5586 / 1847 ms.
    assert "md/ca 1.84, imm/md 3.02" in answer.captions["ratios of CPU time"]
    assert "differ from one measurement to the next" in answer.captions["ratios of CPU time"]


def test_the_figure_by_objects_is_logarithmic_with_units(measured: pl.DataFrame) -> None:
    """A panel for each tier, a line for each of its filters, and a legend that names all."""
    (picture,) = speed_tables.by_objects(measured).pictures
    figure = picture.draw()
    panels = [axes for axes in figure.axes if axes.get_title()]
    assert [len(axes.lines) for axes in panels] == [3, 3, 4, 4, 4]
    for axes in panels:
        assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
        assert axes.get_xlabel() == "objects in a frame"
    assert panels[0].get_ylabel() == "CPU time of a frame [µs]"
    (legend,) = (axes.get_legend() for axes in figure.axes if axes.get_legend())
    assert [text.get_text() for text in legend.get_texts()] == ["ca", "imm", "imm-zero", "md"]
    drawn = panels[-1].lines[-1].get_ydata()
    own = picture.data.filter(tier="whole tracker, compiled", filter="md")
    np.testing.assert_array_equal(drawn, own["time"])
    assert own["objects"].to_list() == [1, 5]


def accuracy() -> Iterator[dict[str, Any]]:
    """HOTA [%] of three worlds with two seeds: MD gains 1 in one world, and IMM half in all."""
    for world in range(3):
        for seed in range(2):
            for name, gain in (("ca", 0.0), ("imm", 0.5), ("imm-zero", -0.5), ("md", world == 1)):
                value = 80.0 + 5.0 * world + seed + gain
                yield {"scenario": f"world {world}", "seed": seed, "filter": name, "value": value}


@pytest.fixture(scope="module")
def traded() -> Answer:
    """Of that accuracy, and of times that are twice as long for MD and thrice for IMM."""
    hota = as_rows(accuracy(), study=worlds.STUDY, detector="virconv", occlusion="none")
    hota = hota.with_columns(pl.lit("hota").alias("metric"))
    costs = {"ca": 1.0, "imm": 3.0, "imm-zero": 3.0, "md": 2.0}
    pace = np.array([1e-6, 2e-6])
    samples = {case(name, "virconv", 1): cost * pace for name, cost in costs.items()}
    times = Timing(speed.TRAFFIC, "virconv", 2).measured(samples)
    return speed_tables.tradeoff(pl.concat([hota, as_rows(times, study=speed.STUDY)]))


def test_the_trade_off_pairs_accuracy_by_world_and_time_by_round(traded: Answer) -> None:
    """Gains over CA of the same worlds and seeds, ratios of the same rounds, and the paper's."""
    table = "HOTA, and CPU time of the whole tracker"
    gain = cell(traded, table, "md", "HOTA − ca")
    assert gain["value"] == pytest.approx(1 / 3)
    assert -1e-9 <= gain["low"] <= gain["high"] <= 1.0 + 1e-9
    assert gain["paper"] == pytest.approx(86.36 - 85.95)
    steady = cell(traded, table, "imm", "HOTA − ca")
    assert (steady["value"], steady["low"], steady["high"]) == pytest.approx((0.5, 0.5, 0.5))
    assert cell(traded, table, "ca", "HOTA")["value"] == pytest.approx(85.5)
    for name, ratio, paper in (("imm", 3.0, 5586 / 1003), ("md", 2.0, 1847 / 1003)):
        found = cell(traded, table, name, "tracker / ca")
        assert (found["value"], found["low"], found["high"]) == pytest.approx((ratio,) * 3)
        assert found["paper"] == pytest.approx(paper, abs=0.005)
    assert cell(traded, table, "md", "tracker")["value"] == pytest.approx(3.0)


def test_the_figure_of_the_trade_off_draws_gains_against_times(traded: Answer) -> None:
    """A panel for the tier that there is, with a logarithmic axis of time and bars."""
    (picture,) = traded.pictures
    (axes,) = picture.draw().axes
    assert axes.get_title() == "whole tracker, compiled"
    assert axes.get_xscale() == "log"
    assert axes.get_xlabel() == "CPU time of a frame [µs]"
    assert axes.get_ylabel() == "HOTA minus that of ca [%]"
    points = {bars.get_label(): bars.lines[0].get_xydata()[0] for bars in axes.containers}
    assert points["md"] == pytest.approx((3.0, 1 / 3))
    assert points["imm-zero"] == pytest.approx((4.5, -0.5))


def test_time_that_md_adds_is_paired_by_round(monkeypatch: pytest.MonkeyPatch) -> None:
    """The whole tracker on simulated traffic, by detector, beside the paper's times."""
    monkeypatch.setattr(speed, "WORLDS", ("intersection",))
    rows = Timing(speed.TRAFFIC, "virconv", ROUNDS).rows()
    answer = speed_tables.runtime(rows)
    times = {name: values(rows, filter=name, metric=LATENCY) for name in speed.NAMES}
    added = cell(answer, speed.TRAFFIC, "virconv", "added by md")
    assert added["value"] == pytest.approx((times["md"] - times["ca"]).mean(), rel=1e-9)
    assert added["paper"] == 73
    for name, paper in (("ca", 542), ("md", 615), ("imm", None), ("imm-zero", None)):
        found = cell(answer, speed.TRAFFIC, "virconv", name)
        assert found["value"] == pytest.approx(times[name].mean(), rel=1e-12)
        assert found["paper"] == paper
    ratio = cell(answer, speed.TRAFFIC, "virconv", "imm / md")
    assert ratio["value"] == pytest.approx((times["imm"] / times["md"]).mean(), rel=1e-12)


def test_the_papers_times_add_up() -> None:
    """Its last row is the difference of the other two; on average it is the text's 0.078 ms."""
    times = [speed_tables.paper_times(name) for name in speed.DETECTORS]
    added = [(dynamic or 0) - (baseline or 0) for baseline, dynamic in times]
    assert added == [73, 68, 94, 71, 83]
    assert np.mean(added) == pytest.approx(78, abs=0.5)


def test_recorded_detections_are_measured_where_they_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Detectors by their folders; without recordings the table is of simulated ones alone."""
    jobs = ITEMS["table-runtime"].jobs
    monkeypatch.setenv("MDKF_KITTI", str(tmp_path / "nothing"))
    assert RECORDED not in {job.part for job in jobs(QUICK) if isinstance(job, Timing)}
    split = {"evaluate_tracking.seqmap.val": GOOD["evaluate_tracking.seqmap.training"]}
    found = {f"detections/{name}/0003.txt": GOOD[FOUND] for name in ("pvcnn", "mine")}
    monkeypatch.setenv("MDKF_KITTI", str(written(tmp_path / "kitti", {**GOOD, **split, **found})))
    own = [job for job in jobs(QUICK) if isinstance(job, Timing) and job.part == RECORDED]
    assert [job.of for job in own] == ["pvcnn"]
    answer = speed_tables.runtime(Timing(RECORDED, "pvcnn", 2).rows())
    assert cell(answer, RECORDED, "pvcnn", "md")["paper"] == 696
    assert set(answer.cells["table"]) == {RECORDED}


def test_every_tier_of_the_benchmark_is_in_the_figure(measured: pl.DataFrame) -> None:
    """None is left out."""
    assert set(filters.TIERS) | {TRACKER} == set(measured["scenario"])
    tables = set(speed_tables.by_objects(measured).cells["table"])
    assert len(tables) == len(filters.TIERS) + 2
