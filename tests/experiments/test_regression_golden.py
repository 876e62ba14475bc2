"""Claim: golden worlds are what the code simulates, are read without a simulator, and never change
unseen; worlds by name are made once in a session."""

import json
import subprocess
import sys

import numpy as np
import pytest

import scenarios
import sim_bridge
from experiments import OcclusionProtocol
from experiments.regression import golden_detections, golden_names, golden_trace
from experiments.regression.golden import FOLDER, PIECES, PREFIX, Piece, made, makers, manifest
from experiments.regression.worlds import Worlds
from mdkf import KINDS, Table
from scenarios import ScenarioError

SIMULATORS = ("libsumo", "highway-env", "gymnasium")
NAMES = golden_names()

READ = """
import json, sys
for simulator in ("libsumo", "gymnasium", "highway_env"):
    sys.modules[simulator] = None  # importing it fails
from experiments.regression import golden_detections, golden_names, golden_trace
hashes = {n: [golden_trace(n).content_hash(), golden_detections(n).content_hash()]
          for n in golden_names()}
print(json.dumps(hashes))
"""


@pytest.mark.parametrize("name", NAMES)
def test_they_are_what_the_code_simulates(name: str) -> None:
    """To the bit where everything that decides a bit is what it was, else to a micrometre; where a
    simulator is another one, it may drive otherwise."""
    then, here = manifest()["made_with"], makers()
    if changed := [package for package in SIMULATORS if then[package] != here[package]]:
        pytest.skip(f"made with {changed[0]} {then[changed[0]]}, here is {here[changed[0]]}")
    piece = name.removeprefix(PREFIX)
    trace, detections = made(PIECES[piece], piece)
    if then == here:
        assert trace == golden_trace(name)
        assert detections == golden_detections(name)
        return
    assert_close(trace, golden_trace(name))
    assert_close(trace.ego, golden_trace(name).ego)
    assert_close(detections, golden_detections(name))


def assert_close(made: Table, committed: Table) -> None:
    for column, values in made.columns().items():
        np.testing.assert_allclose(values, committed.columns()[column], atol=1e-6, err_msg=column)


def test_reading_them_needs_no_simulator() -> None:
    """In a process in which none can be imported; contents are those of the manifest."""
    told = manifest()["worlds"]
    ran = subprocess.run([sys.executable, "-c", READ], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    assert json.loads(ran.stdout) == {
        f"{PREFIX}{name}": [world["trace"], world["detections"]] for name, world in told.items()
    }
    assert tuple(json.loads(ran.stdout)) == NAMES


def test_the_manifest_tells_how_they_were_made() -> None:
    """Command, versions, and the part of each world; every file is of one of them, and small."""
    told = manifest()
    assert told["command"] == "python -m experiments.regression"
    assert told["made_with"].keys() == makers().keys()
    for name, piece in PIECES.items():
        world = told["worlds"][name]
        assert (world["scenario"], world["first_frame"], world["frames"]) == (
            piece.scenario,
            piece.first,
            piece.frames,
        )
        assert tuple(world["objects"]) == piece.objects
    files = {path.name: path.stat().st_size for path in FOLDER.glob("*.parquet")}
    names = {name.partition("/")[2] for name in PIECES}
    assert set(files) == {f"{n}.{kind}.parquet" for n in names for kind in ("trace", "detections")}
    assert max(files.values()) < 64_000


def test_a_piece_is_a_part_of_its_world() -> None:
    """Rows of the whole world, frames counted anew; objects outside the piece still hide those in
    it, and the sensor is where it was."""
    whole = sim_bridge.simulate(scenarios.load("circle"), 0)
    ids = tuple(int(i) for i in whole.ids()[:1])
    part = Piece("circle", 20, 30, ids).cut(whole, "part")
    rows = whole.rows_of(ids[0])[20:50]
    assert part.n_frames == 30
    assert part.frame.tolist() == list(range(30))
    for column in ("x", "y", "vx", "yaw_rate", "visible"):
        np.testing.assert_array_equal(getattr(part, column), getattr(whole, column)[rows])
    np.testing.assert_array_equal(part.ego.x, whole.ego.x[20:50])


def test_they_hold_what_makes_tracking_hard() -> None:
    """Of each source one; gaps by the occlusion protocol in all; a bus that hides standing cars;
    motion in every regime."""
    assert {golden_trace(name).provenance["source"] for name in NAMES} == {
        *("sumo", "highway-env", "closed-form"),
    }
    for name in NAMES:
        assert len(OcclusionProtocol().gaps(golden_detections(name))) >= 1
    regimes = np.concatenate([golden_trace(name).regime for name in NAMES])
    assert set(regimes.tolist()) == {0, 1, 2, 3}
    trace = golden_trace("golden:v1/bus_stop")
    speed = np.hypot(trace.vx, trace.vy)
    standing = [i for i in trace.ids() if speed[trace.rows_of(i)].max() == 0]
    assert len(standing) >= 3
    assert all(trace.visible[trace.rows_of(i)].min() == 0 for i in standing)
    assert KINDS.index("bus") in trace.kind


def test_worlds_by_name_are_made_once() -> None:
    """The same name, seed and parameters: the same trace and the same numbers of detections; other
    ones: another trace. With parameters, a path or a scenario, they are those of the library."""
    worlds = Worlds()
    trace = worlds.trace("circle", seed=1)
    assert trace is worlds.trace("circle", seed=1)
    scenario = scenarios.load("circle")
    assert trace is worlds.trace(scenario, seed=1) is worlds.trace(scenario.definition, seed=1)
    assert trace == sim_bridge.simulate(scenario, 1)
    assert trace.provenance["seed"] == "1"
    name, spec = next((s.name, s) for s in scenario.parameter_specs)
    other = worlds.trace("circle", seed=1, **{name: spec.maximum})
    assert other == sim_bridge.simulate(scenarios.load("circle", **{name: spec.maximum}), 1)
    assert other != trace
    seen = worlds.detections("circle", seed=1, detector="second", occlusion="mid:10")
    expected = sim_bridge.detect(trace, "second", 1)
    assert seen == OcclusionProtocol(length=10).apply(expected)
    assert worlds.detections("circle", seed=1, detector="second", occlusion="none") == expected


def test_detections_of_golden_worlds_are_the_committed_ones() -> None:
    """With the detector and seed that they were made with; with others they are made anew."""
    worlds, name = Worlds(), "golden:v1/overtaking"
    seen = worlds.detections(name, occlusion="none")
    assert seen == golden_detections(name)
    assert worlds.detections(name, seed=5, occlusion="none") == sim_bridge.detect(
        golden_trace(name), seed=5
    )


def test_what_there_is_not_is_named() -> None:
    """Unknown golden worlds, with the known ones; a seed or a parameter of one; parameters beside a
    scenario; an unknown scenario."""
    worlds = Worlds()
    for bad in ("golden:bus_stop", "golden:v2/bus_stop", "golden:"):
        with pytest.raises(ScenarioError, match=r"expected one of: golden:v1/stop_and_go, "):
            worlds.trace(bad)
    with pytest.raises(ScenarioError, match="expected no seed"):
        worlds.trace(NAMES[0], seed=1)
    with pytest.raises(ScenarioError, match="expected no seed and no parameters"):
        worlds.trace(NAMES[0], speed=3.0)
    with pytest.raises(ScenarioError, match="has its parameters"):
        worlds.trace(scenarios.load("circle"), speed=3.0)
    with pytest.raises(ScenarioError, match="unknown scenario"):
        worlds.trace("roundabuot")
