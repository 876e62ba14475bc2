"""Claim: every kind of occlusion goes through the commands from file to file, and through a run."""

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import scenarios
import sim_bridge
from experiments.occlusion import OcclusionProtocol, recorded_gaps
from experiments.regime_switches import regime_switches
from mdkf import Detections, Trace, Tracks
from tests.experiments.commands import Mdkf, answered, shortened

KINDS = ("mid:0", "mid:10:9:gaps=3", "switch:10:9:start=-4", "natural:20:5")


@pytest.mark.parametrize("occlusion", KINDS)
def test_it_goes_from_file_to_file(
    made: Path, mdkf_command: Mdkf, tmp_path: Path, occlusion: str
) -> None:
    """Detections, tracks and scores tell of the gaps that the library finds in the same trace."""
    seen, tracked = tmp_path / "seen.parquet", tmp_path / "tracks.parquet"
    hide = ("--seed", 3, "--occlusion", occlusion)
    assert mdkf_command("detect", made / "trace.parquet", *hide, "--out", seen).status == 0
    assert mdkf_command("track", seen, "--filter", "ca", "--out", tracked).status == 0
    trace = sim_bridge.read_table(made / "trace.parquet", Trace)
    protocol = OcclusionProtocol.parse(occlusion)
    everything = sim_bridge.detect(trace, seed=3)
    expected = protocol.gaps(everything, trace)
    assert len(expected) > 0
    gaps = recorded_gaps(sim_bridge.read_table(tracked, Tracks), protocol)
    assert gaps.rows() == expected.rows()
    inside = expected.covers(everything.source, everything.frame)
    assert sim_bridge.read_table(seen, Detections) == everything.take(~inside)
    assert inside.any() == occlusion.startswith(("mid:10", "switch"))
    told = answered(mdkf_command("score", made / "trace.parquet", tracked, "--json"))
    assert json.dumps(told).count(f'"gaps": {len(expected)}') > 0


def test_gaps_around_switches_begin_there(made: Path) -> None:
    """In simulated traffic: four frames before a true change of regime."""
    trace = sim_bridge.read_table(made / "trace.parquet", Trace)
    switches = regime_switches(trace)
    seen = sim_bridge.detect(trace, seed=3)
    for own, start, _ in OcclusionProtocol("switch", 10, 9, start=-4).gaps(seen, trace).rows():
        assert start + 4 in switches[own]
        regime = dict(
            zip(trace.frame[trace.rows_of(own)], trace.regime[trace.rows_of(own)], strict=True)
        )
        assert regime[start + 3] != regime[start + 4]


@pytest.mark.parametrize("occlusion", KINDS)
def test_it_goes_through_a_run(mdkf_command: Mdkf, tmp_path: Path, occlusion: str) -> None:
    """Errors are of the protocol's gaps, and the page is there; of empty gaps there is no drift
    and no picture, and none of those whose track was captured."""
    scenario = shortened(tmp_path / "own")
    out = tmp_path / "out"
    few = ("--seeds", 1, "--filters", "ca", "--workers", 1, "--no-cache", "--json")
    told = answered(mdkf_command("run", scenario, *few, "--occlusion", occlusion, "--out", out))
    (row,) = told["rows"]
    trace = sim_bridge.simulate(scenarios.load(scenario), 0)
    protocol = OcclusionProtocol.parse(occlusion)
    expected = protocol.gaps(sim_bridge.detect(trace, "pointrcnn", 0), trace)
    assert (row["gaps"], row["occlusion"]) == (len(expected), str(protocol))
    errors = pl.read_parquet(out / "errors.parquet")
    assert set(errors.select("object_id", "gap_start", "gap_stop").rows()) == set(expected.rows())
    drifts = errors.filter(phase="gap")["drift"].drop_nulls()
    assert (row["drift"] is None) == drifts.is_empty() == (protocol.length == 0)
    page = (out / "report.html").read_text()
    hidden = pl.col("gap_stop") > pl.col("gap_start")
    shown = errors.filter(hidden, pl.col("track_id") >= 0, ~pl.col("captured"))
    assert ("in its gap" in page) == (not shown.is_empty())
    assert np.isfinite(drifts.to_numpy()).all()
