"""Claim: recorded worlds go through every command, and what nobody knows of them is "no value".

Labels have no derivatives: who stands, turns or accelerates is unknown.
"""

import json
import re
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import scenarios
import sim_bridge
from experiments.worlds.describe import describe
from mdkf import Tracks
from tests.experiments.commands import Mdkf, assert_refused
from tests.sim_bridge.kitti_folder import STILL, detection, files, label, written

FRAMES = 90


@pytest.fixture
def recordings(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Nine seconds of a parked car and of one that drives away at 5 m/s, detected to 0.1 m."""
    rng = np.random.default_rng(3)
    labels, found = [], []
    for k in range(FRAMES):
        for track, place in enumerate([(-4.0, 1.65, 15.0), (3.0, 1.65, 10.0 + 0.5 * k)]):
            labels.append(label(k, track, place, -np.pi / 2))
            found.append(detection(k, place + rng.normal(0, 0.1, 3), -np.pi / 2, 4.0))
    folder = tmp_path_factory.mktemp("recorded")
    monkeypatch.setenv("MDKF_KITTI", str(folder))
    return written(folder, files(labels, found, [STILL] * FRAMES))


def test_nobody_knows_who_stands_or_turns(
    recordings: Path, mdkf_command: Mdkf, tmp_path: Path
) -> None:
    """Both are told as no value; objects and occlusions are counted as ever, and drawn."""
    told = describe(sim_bridge.simulate(scenarios.load("kitti-0003"), 0))
    assert told.objects == {"car": 2}
    assert (told.standing, told.turning, told.regimes) == (None, None, {"unknown": 1.0})
    picture = tmp_path / "recorded.png"
    shown = mdkf_command("scenarios", "kitti-0003", "--picture", str(picture))
    assert shown.status == 0
    assert "2 car" in shown.out
    assert "never move" not in shown.out
    assert picture.read_bytes().startswith(b"\x89PNG")
    (row,) = json.loads(mdkf_command("scenarios", "kitti-0003", "--json").out)["rows"]
    assert (row["source"], row["standing"], row["turning"]) == ("kitti", None, None)


def test_the_catalogue_has_recordings_or_says_how(
    recordings: Path, mdkf_command: Mdkf, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """All four sources in the list; without recordings a hint at the variable."""
    rows = json.loads(mdkf_command("scenarios", "--json").out)["rows"]
    sources = {row["source"] for row in rows}
    assert sources == {"sumo", "highway-env", "closed-form", "kitti"}
    assert "MDKF_KITTI" not in mdkf_command("scenarios").out
    monkeypatch.setenv("MDKF_KITTI", str(tmp_path))
    assert "MDKF_KITTI" in mdkf_command("scenarios").out


RUN = ("run", "kitti-0003", "--filters", "ca,md", "--workers", 1, "--out", "out")


@pytest.mark.parametrize(
    ("detector", "seeds"),
    [(("--detector", "pointrcnn"), 3), (("--detector", "recorded:mine"), 1)],
)
@pytest.mark.parametrize("occlusion", ["mid:20", "late:10", "none"])
def test_filters_run_on_recordings(
    recordings: Path,
    mdkf_command: Mdkf,
    tmp_path: Path,
    detector: tuple[str, str],
    seeds: int,
    occlusion: str,
) -> None:
    """Simulated detections differ by seed; recorded ones are one world, with no interval. The page
    and the tables hold no NaN, and no picture says that its object stands or moves."""
    settings = ("--settings", "pointrcnn", "--occlusion", occlusion, "--seeds", 3, "--json")
    answer = mdkf_command(*RUN, *detector, *settings)
    assert answer.status == 0, answer.err
    rows = json.loads(answer.out)["rows"]
    assert [(row["filter"], row["seeds"]) for row in rows] == [("ca", seeds), ("md", seeds)]
    for row in rows:
        assert row["hota"] > 0
        assert row["gaps"] == (0 if occlusion == "none" else 2)
        assert (row["drift"] is None) == (occlusion == "none")
        assert (row["hota_low"] is None) == (seeds == 1)
    page = (tmp_path / "out" / "report.html").read_text()
    assert not re.search(r"\bnan\b", page, re.IGNORECASE)
    assert not re.search(r"all (standing|moving) objects", page)
    assert ("all labelled objects" in page) == (occlusion != "none")
    errors = pl.read_parquet(tmp_path / "out" / "errors.parquet")
    assert set(errors["regime"]) <= {"unknown"}


def test_recordings_have_no_switches_of_motion(
    recordings: Path, mdkf_command: Mdkf, tmp_path: Path
) -> None:
    """Nobody knows the true motion: one line says so, and nothing is left behind."""
    answer = mdkf_command(*RUN, "--occlusion", "switch:20")
    assert_refused(answer, tmp_path, "kitti-0003", "no switches of motion", "simulated world")


def test_recorded_detections_from_file_to_file(
    recordings: Path, mdkf_command: Mdkf, tmp_path: Path
) -> None:
    """simulate, detect, track, score: what the library gives, within the labels' 0.1 m. Labels
    have no velocity, so its errors have no value; all their regimes are unknown."""
    assert mdkf_command("simulate", "kitti-0003", "--out", "trace.parquet").status == 0
    seen = ("--detector", "recorded:mine", "--occlusion", "mid:20", "--out", "seen.parquet")
    assert mdkf_command("detect", "trace.parquet", *seen).status == 0
    filtered = ("--filter", "md", "--settings", "pointrcnn", "--out", "tracks.parquet")
    assert mdkf_command("track", "seen.parquet", *filtered).status == 0
    groups = ("--by", "regime", "--by", "phase")
    answer = mdkf_command("score", "trace.parquet", "tracks.parquet", *groups, "--json")
    assert answer.status == 0
    scores = json.loads(answer.out)
    assert (scores["velocity_error"], scores["velocity_rmse"]) == (None, None)
    assert scores["position_error"] < 0.3
    found = {(row["bin"], row["score"]): row for row in scores["breakdown"]}
    errors = {name: row["n"] for (name, score), row in found.items() if score == "position_error"}
    assert errors["unknown"] == errors["all"] > 100
    assert {errors[name] for name in ("stationary", "turning", "not turning")} == {0}
    assert {row["value"] for (_, score), row in found.items() if "velocity" in score} == {None}
    assert errors["gap"] == errors["gap 1-5"] + errors["gap 6-10"] + errors["gap 11-20"] > 20
    assert scores["gaps"] == scores["followed"] == 2
    assert scores["error_before"] < 0.3
    tracks = sim_bridge.read_table(tmp_path / "tracks.parquet", Tracks)
    assert tracks.provenance["scenario"] == "kitti-0003"


def test_recorded_detections_of_a_simulated_world_are_refused_at_once(
    recordings: Path, mdkf_command: Mdkf, tmp_path: Path
) -> None:
    """Before anything is simulated."""
    options = ("--detector", "recorded:mine", "--settings", "pointrcnn", "--out", "out")
    answer = mdkf_command("run", "bus_stop", *options)
    assert_refused(answer, tmp_path, "recorded:mine", "bus_stop has source sumo")


def test_a_malformed_recording_is_bad_input(
    recordings: Path, mdkf_command: Mdkf, tmp_path: Path
) -> None:
    """One line with the file and its line."""
    labels = recordings / "label_02" / "0003.txt"
    labels.write_text(labels.read_text().replace("Car", "Tank", 1))
    for command in ("scenarios", "run"):
        answer = mdkf_command(command, "kitti-0003")
        assert_refused(answer, tmp_path, str(labels), "line 1", "'Tank'")
