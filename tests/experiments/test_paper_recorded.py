"""Claim: the study of recorded sequences has KITTI's own scores, of all sequences together and
without each of them."""

import dataclasses
import shutil
from pathlib import Path

import polars as pl
import pytest

from experiments.jobs import ROWS, Store
from experiments.kitti.recordings import (
    DetectorFolder,
    read_recordings,
    recorded_detections,
    sequences_in,
)
from experiments.kitti.rules import RULES
from experiments.kitti.run import Plan, run
from experiments.occlusion import OcclusionProtocol
from experiments.studies import recorded
from experiments.studies.recorded import METRICS, Recorded
from scenarios.kitti import kitti_root

there = pytest.mark.skipif(
    not (kitti_root() / "detections" / "second_iou").is_dir(), reason="no KITTI recordings here"
)
LEFT_OUT = "0012"


@pytest.fixture(scope="module")
def rows() -> pl.DataFrame:
    """Of CA with SECOND, in gaps of ten frames."""
    (job,) = recorded.jobs(["second"], ["mid:10"])
    return dataclasses.replace(job, filters=("ca",)).rows()


def value(rows: pl.DataFrame, scenario: str, metric: str) -> float:
    """One score."""
    return float(rows.filter(scenario=scenario, metric=metric)["value"].item())


@there
@pytest.mark.parametrize("without", [None, LEFT_OUT])
def test_rows_are_the_scores_of_the_sequences_they_name(
    rows: pl.DataFrame, without: str | None
) -> None:
    """As a run on these sequences alone scores them, which the official scorer confirms."""
    root = kitti_root()
    names = [name for name in sequences_in(root, "val") if name != without]
    recordings = read_recordings(root, names)
    folder = DetectorFolder.of(root / "detections" / "second_iou", None)
    seen = recorded_detections(root, folder.path, recordings)
    plan = Plan(("ca",), (RULES["paper"],), OcclusionProtocol("mid", 10))
    (expected,) = run(plan, folder, recordings, seen).rows
    scenario = "val" if without is None else f"val-{without}"
    assert {metric: value(rows, scenario, metric) for metric in METRICS} == {
        metric: expected[metric] for metric in METRICS
    }
    assert set(rows.filter(scenario=scenario)["n"]) == {len(names)}


@there
def test_there_is_a_row_for_each_sequence_left_out(rows: pl.DataFrame) -> None:
    """With the columns of all studies, no seeds, and names that the jackknife knows."""
    assert dict(rows.schema) == ROWS
    names = sequences_in(kitti_root(), "val")
    assert set(rows["scenario"]) == {"val", *(f"val-{name}" for name in names)}
    assert rows["seed"].null_count() == len(rows) == len(METRICS) * (1 + len(names))
    assert set(rows["study"]) == {"recorded"}
    assert set(rows["detector"]) == {"second"}
    # Eleven values that are not all one: leaving a sequence out changes the score.
    assert rows.filter(metric="hota")["value"].n_unique() > len(names) / 2


@there
def test_other_recordings_are_another_job(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """What is kept of one folder is never shown for a changed one; an equal copy is the same."""
    (job,) = recorded.jobs(["second"])
    store = Store(tmp_path / "jobs")
    copy, changed = tmp_path / "copy", tmp_path / "changed"
    for folder in (copy, changed):
        shutil.copytree(kitti_root(), folder)
    labels = changed / "label_02" / f"{LEFT_OUT}.txt"
    labels.write_text("".join(labels.read_text().splitlines(keepends=True)[:-1]))
    monkeypatch.setenv("MDKF_KITTI", str(copy))
    assert recorded.jobs(["second"]) == [job]
    monkeypatch.setenv("MDKF_KITTI", str(changed))
    (other,) = recorded.jobs(["second"])
    assert store.path(other) != store.path(job)


def test_only_detectors_with_a_folder_have_jobs(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """None without recordings, and none of a detector of which there are none."""
    monkeypatch.setenv("MDKF_KITTI", str(tmp_path / "nowhere"))
    assert recorded.jobs(["virconv", "pointrcnn", "pvrcnn", "second"]) == []
    (tmp_path / "some" / "detections" / "pvcnn").mkdir(parents=True)
    monkeypatch.setenv("MDKF_KITTI", str(tmp_path / "some"))
    found = recorded.jobs(["virconv", "pointrcnn", "pvrcnn", "second"], ["none", "mid:10"])
    assert [(job.detector, job.occlusion) for job in found] == [
        ("pvrcnn", "none"),
        ("pvrcnn", "mid:10"),
    ]
    assert all(isinstance(job, Recorded) for job in found)
