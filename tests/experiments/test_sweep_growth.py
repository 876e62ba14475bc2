"""Claim: a sweep of gap lengths gives the error-growth curve of each filter and regime."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

import mdkf
import sim_bridge
from experiments import OcclusionProtocol
from experiments.sweeps import run_sweep
from experiments.sweeps.growth_files import CURVES
from experiments.world import follow
from tests.experiments.commands import Mdkf
from tests.experiments.sweeping import small

LENGTHS = (0, 5, 20)


def test_the_curve_is_the_error_at_the_end_of_gaps_of_each_length(tmp_path: Path) -> None:
    """Each point against the same worlds followed one by one: the mean over seeds of the drift in
    the last frame of the gap, and before it of the gap of no length."""
    occlusions = [OcclusionProtocol("mid", length) for length in LENGTHS]
    own = small(scenarios=["brake_to_standstill"], seeds=3, occlusions=occlusions)
    results = run_sweep(own, tmp_path / "out", workers=1, cached=False)
    curve = pl.read_parquet(tmp_path / "out" / "growth.parquet")
    assert curve.equals(results.curves)
    assert dict(curve.schema) == CURVES
    assert {path.name for path in (tmp_path / "out").glob("growth.*")} == {
        *("growth.parquet", "growth.svg", "growth.png")
    }
    for name in ("ca", "md"):
        line = curve.filter(filter=name, regime="all").sort("length")
        assert line["length"].to_list() == list(LENGTHS)
        expected = []
        for protocol in occlusions:
            ends = []
            for seed in range(3):
                trace = sim_bridge.simulate(own.scenarios[0], seed)
                seen = protocol.apply(sim_bridge.detect(trace, "pointrcnn", seed), trace)
                settings = mdkf.DETECTORS["pointrcnn"]
                errors = follow(trace, seen, mdkf.estimator(name), settings, protocol).errors
                ends.append(errors.filter(offset=protocol.length - 1)["drift"].item())
            expected.append(np.mean(ends))
        np.testing.assert_allclose(line["error"], expected, rtol=1e-12)
        assert (line["seeds"].to_list(), line["gaps"].to_list()) == ([3] * 3, [3] * 3)


def test_gaps_of_one_length_grow_within_and_natural_ones_beside(tmp_path: Path) -> None:
    """Frame by frame of the same gaps; and each detector has its own curve and picture."""
    own = small(
        scenarios=["passing_bus"],
        seeds=2,
        occlusions=["mid:10", "natural:10:10"],
        detectors=["pointrcnn", "second"],
    )
    results = run_sweep(own, tmp_path / "out", workers=1, cached=False)
    assert set(results.curves["protocol"]) == {"mid:*:35", "natural:*:10"}
    line = results.curves.filter(detector="second", filter="md", regime="all", protocol="mid:*:35")
    assert line["length"].to_list() == list(range(11))
    assert {path.name for path in results.pictures} == {
        "growth-pointrcnn.png",
        "growth-second.png",
    }


def test_a_scenario_with_two_parameters_is_two_clusters(tmp_path: Path) -> None:
    """The curve counts them apart, as it does scenarios."""
    results = run_sweep(small(), tmp_path / "out", workers=1, cached=False)
    assert set(results.curves.filter(regime="all")["scenarios"]) == {3}


def test_the_command_shows_the_curve(mdkf_command: Mdkf, tmp_path: Path) -> None:
    """A table by regime, and where the picture is."""
    file = tmp_path / "sweep.yaml"
    file.write_text(
        "scenarios: [stationary]\nseeds: 2\nfilters: [ca]\n"
        "occlusions: [{kind: mid, length: [0, 10]}]\n"
    )
    answer = mdkf_command("sweep", file, "--out", tmp_path / "out", "--workers", 1)
    assert answer.status == 0
    assert "drift [m] after so many frames without a detection" in " ".join(answer.out.split())
    assert str(tmp_path / "out" / "growth.png") in answer.out.replace("\n", "")


def test_without_gaps_there_is_no_picture(tmp_path: Path) -> None:
    """And no curve; what a sweep of nothing hidden gives is otherwise as usual."""
    results = run_sweep(small(occlusions=["none"]), tmp_path / "out", workers=1, cached=False)
    assert (len(results.curves), results.pictures) == (0, [])
    assert [path.name for path in (tmp_path / "out").glob("growth.*")] == ["growth.parquet"]
    assert results.summary["hota"].null_count() == 0
    assert results.summary["drift"].null_count() == len(results.summary)


@pytest.mark.parametrize("text", ["switch:20:35:start=-5", "mid:5:20:gaps=2", "late:10:20"])
def test_every_protocol_can_be_swept(tmp_path: Path, text: str) -> None:
    """Around switches of motion, several gaps, at the end: as text or by its fields."""
    own = small(scenarios=["brake_to_standstill"], occlusions=[text], seeds=1, filters=["ca"])
    results = run_sweep(own, tmp_path / "out", workers=1, cached=False)
    assert results.runs["status"].to_list() == ["done"]
    assert results.runs["occlusion"].to_list() == [text]
