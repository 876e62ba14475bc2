"""Claim: `fit-detector` and `check-detector` print how simulated detections compare with recorded
ones, and refuse bad input in one line.

The recordings are read from the folder `MDKF_KITTI`, by default `../shared/kitti`.
"""

import json
from pathlib import Path

import pytest

from scenarios.kitti import kitti_root
from sim_bridge import load_profile
from tests.experiments.commands import Mdkf, assert_refused

recorded = pytest.mark.skipif(
    not (kitti_root() / "label_02").is_dir(), reason=f"no KITTI data in {kitti_root()} (MDKF_KITTI)"
)


@recorded
def test_shipped_profiles_resemble_the_detectors_where_they_were_not_fitted(
    mdkf_command: Mdkf,
) -> None:
    """On the val split, all three: recall of all cars within three points, median radial and
    lateral errors within 10 %; the rest is told, within its limits or not."""
    answer = mdkf_command("check-detector", "--seeds", "2", "--json")
    assert answer.status == 0
    document = json.loads(answer.out)
    assert set(document["distances"]) == {"pointrcnn", "pvrcnn", "second"}
    for row in document["rows"]:
        if row["of"] == "all" and row["what"] in (
            "recall",
            "radial error [m]",
            "lateral error [m]",
        ):
            assert row["within"], row
        if row["within"] is not None:
            apart = abs(row["simulated"] - row["real"])
            assert row["within"] == (apart <= row["limit"])
            assert row["low"] <= row["real"] <= row["high"]
    asked = {(row["what"], row["of"]) for row in document["rows"]}
    assert {("recall", "60-70 m"), ("recall", "largely hidden"), ("false boxes", "all")} <= asked


@recorded
def test_a_fit_writes_a_profile_that_detects(mdkf_command: Mdkf, tmp_path: Path) -> None:
    """A profile of the given name with what it was fitted to, a picture, and the shipped numbers:
    the fit is the same everywhere."""
    folder = kitti_root() / "detections" / "pointrcnn"
    options = ("--detections", str(folder), "--name", "mine", "--seeds", "1", "--out")
    answer = mdkf_command("fit-detector", *options, str(tmp_path))
    assert answer.status == 0
    assert "mine on the val sequences, held out" in " ".join(answer.out.split())
    assert (tmp_path / "mine.png").read_bytes().startswith(b"\x89PNG")
    made, shipped = load_profile(tmp_path / "mine.yaml"), load_profile("pointrcnn")
    assert made.name == "mine"
    assert made.evidence["detections"] == "pointrcnn"
    assert made.evidence["cars"] == shipped.evidence["cars"]
    assert made.radial.constant == pytest.approx(shipped.radial.constant, rel=0.02)
    assert made.clutter.ghosts.life == pytest.approx(shipped.clutter.ghosts.life, rel=0.02)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("check-detector", "lidar"), "unknown detector 'lidar'"),
        (("check-detector", "--split", "test"), "--split is 'test', expected one of train, val"),
        (("check-detector", "--root", "nowhere"), "nowhere: no such folder"),
        (("fit-detector",), "--detections"),
        (("fit-detector", "--root", "nowhere", "--detections", "x"), "nowhere: no such folder"),
    ],
)
def test_bad_input_is_one_line(
    mdkf_command: Mdkf, tmp_path: Path, arguments: tuple[str, ...], told: str
) -> None:
    """Status 2, and nothing written."""
    assert_refused(mdkf_command(*arguments), tmp_path, told)


@recorded
def test_a_guess_is_not_checked_unasked(mdkf_command: Mdkf, tmp_path: Path) -> None:
    """An interpolated profile has no recordings of its own."""
    assert_refused(mdkf_command("check-detector", "casa"), tmp_path, "casa", "give --detections")
