"""Claim: a recorded sequence is a scenario, and its recorded detections are a detector, by name.

The recordings are made by hand, as in `kitti_folder`; `MDKF_KITTI` names their folder.
"""

import json
import pickle
import shutil
from pathlib import Path

import numpy as np
import pytest

import scenarios
import sim_bridge
from scenarios import KittiScenario, ScenarioError
from sim_bridge import ProfileError, SimulationError, kitti_detections, kitti_trace
from tests.sim_bridge.kitti_folder import STILL, detection, files, label, written

FRAMES = 5
OWN = "closed-form", "highway-env", "sumo"


@pytest.fixture
def recordings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Sequence 0003 of five frames with two cars, and what `mine` detected of them."""
    places = [((3, 1.65, 20 + k), (-4, 1.65, 15)) for k in range(FRAMES)]
    labels = [label(k, i, p, 0.1) for k, both in enumerate(places) for i, p in enumerate(both)]
    found = [detection(k, (3.1, 1.65, 20 + k), 0.1, 4.0) for k in range(FRAMES)]
    monkeypatch.setenv("MDKF_KITTI", str(tmp_path / "recorded"))
    return written(tmp_path / "recorded", files(labels, found, [STILL] * FRAMES))


def test_sequences_are_listed_where_they_are(recordings: Path) -> None:
    """After the catalogue's own scenarios, with their length; without recordings, those alone."""
    sources = {scenarios.load(name).source for name in scenarios.list()}
    assert sources == {*OWN, "kitti"}
    assert scenarios.list()[-1] == "kitti-0003"
    scenario = scenarios.load("kitti-0003")
    assert isinstance(scenario, KittiScenario)
    assert (scenario.name, scenario.duration) == ("kitti-0003", pytest.approx(0.5))
    assert pickle.loads(pickle.dumps(scenario)) == scenario
    shutil.rmtree(recordings)
    assert {scenarios.load(name).source for name in scenarios.list()} == {*OWN}


@pytest.mark.parametrize(
    ("name", "parameters", "parts"),
    [
        ("kitti-0004", {}, ("'kitti-0004'", "kitti-0003")),
        ("kitti-0003", {"speed": 3.0}, ("'speed'", "known: none")),
        ("kitti_0003", {}, ("did you mean kitti-0003?",)),
    ],
)
def test_what_is_not_recorded_is_one_line(
    recordings: Path, name: str, parameters: dict[str, float], parts: tuple[str, ...]
) -> None:
    """Another sequence, a parameter, a misspelling."""
    with pytest.raises(ScenarioError) as caught:
        scenarios.load(name, **parameters)
    assert "\n" not in str(caught.value)
    for part in parts:
        assert part in str(caught.value)


def test_without_recordings_the_variable_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The answer to a missing folder is which variable to set."""
    monkeypatch.setenv("MDKF_KITTI", str(tmp_path / "nowhere"))
    with pytest.raises(ScenarioError, match=r"no KITTI recordings in .*nowhere; set MDKF_KITTI"):
        scenarios.load("kitti-0003")


def test_every_seed_is_the_recorded_trace(recordings: Path) -> None:
    """All numbers are `kitti_trace`'s; the provenance tells the seed, as for every trace."""
    recorded = kitti_trace(recordings, "0003")
    for seed in (0, 7):
        trace = sim_bridge.simulate(scenarios.load("kitti-0003"), seed)
        assert trace == recorded
        assert trace.provenance == {**recorded.provenance, "parameters": "{}", "seed": str(seed)}
        assert trace.ego.provenance == trace.provenance
    with pytest.raises(SimulationError, match=r"dt is 0\.2 s, expected 0\.1 s"):
        sim_bridge.simulate(scenarios.load("kitti-0003"), 0, 0.2)


def test_the_simulated_detector_sees_recorded_cars(recordings: Path) -> None:
    """Its noise hangs on the seed, its truth does not."""
    trace = sim_bridge.simulate(scenarios.load("kitti-0003"), 0)
    first, again, other = (sim_bridge.detect(trace, "pointrcnn", seed) for seed in (1, 1, 2))
    assert len(first) > 0
    assert first == again
    assert first != other


def test_recorded_detections_are_a_detector(recordings: Path, tmp_path: Path) -> None:
    """`recorded:mine` gives what `kitti_detections` reads, whatever the seed, also of a trace that
    was in a file; the car that nobody detected stays undetected."""
    wanted = kitti_detections(recordings, "mine", "0003")
    assert len(wanted) == FRAMES
    trace = sim_bridge.simulate(scenarios.load("kitti-0003"), 4)
    sim_bridge.write_table(trace, tmp_path / "trace.parquet")
    for same in (trace, sim_bridge.read_table(tmp_path / "trace.parquet", type(trace))):
        found = sim_bridge.detect(same, "recorded:mine", seed=9)
        assert found == wanted
        assert found.provenance == {**trace.provenance, **wanted.provenance}
    assert sim_bridge.detector_name("recorded:mine") == "mine"


def test_recorded_detections_need_their_own_trace(recordings: Path) -> None:
    """Not one that was simulated, nor one that is no longer the recording."""
    simulated = sim_bridge.simulate(scenarios.load("stationary"), 0)
    with pytest.raises(ProfileError, match=r"stationary has source closed-form, expected a rec"):
        sim_bridge.detect(simulated, "recorded:mine")
    with pytest.raises(ProfileError, match="stationary has source closed-form"):
        sim_bridge.check_detector("recorded:mine", scenarios.load("stationary"))
    sim_bridge.check_detector("recorded:mine", scenarios.load("kitti-0003"))
    trace = sim_bridge.simulate(scenarios.load("kitti-0003"), 0)
    with pytest.raises(ProfileError, match=r"the trace is not kitti-0003 of .* \(MDKF_KITTI\)"):
        sim_bridge.detect(trace.between(0, 2), "recorded:mine")
    with pytest.raises(sim_bridge.KittiError, match=r"unknown detector 'yours'; known: mine"):
        sim_bridge.detect(trace, "recorded:yours")


def test_identity_is_that_of_the_files(recordings: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same in another folder, another for another label."""
    identity = scenarios.load("kitti-0003").identity()
    assert json.loads(identity)["source"] == "kitti"
    moved = shutil.copytree(recordings, recordings.parent / "elsewhere")
    monkeypatch.setenv("MDKF_KITTI", str(moved))
    assert scenarios.load("kitti-0003").identity() == identity
    labels = moved / "label_02" / "0003.txt"
    labels.write_text(labels.read_text().replace("20", "21", 1))
    changed = scenarios.load("kitti-0003")
    assert changed.identity() != identity
    moved_car = sim_bridge.simulate(changed, 0)
    assert not np.array_equal(moved_car.x, kitti_trace(recordings, "0003").x)
