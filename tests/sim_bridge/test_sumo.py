"""Claims about `run_sumo`: the same bits everywhere, the ego throughout, nothing left behind."""

import dataclasses
import math
import os
import pickle
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest

import scenarios
from scenarios import Scenario
from sim_bridge.recording import Recording
from sim_bridge.sumo import STEP, run_sumo
from tests.sim_bridge.worlds import SUMO

ROOT = Path(__file__).resolve().parents[2]


def short(name: str) -> Scenario:
    """A catalogue scenario cut to a few recorded seconds."""
    return dataclasses.replace(scenarios.load(name), duration=5.0)


@pytest.fixture(scope="module", params=SUMO)
def pair(request: pytest.FixtureRequest) -> tuple[Scenario, Recording]:
    scenario = scenarios.load(request.param)
    return scenario, run_sumo(scenario, 3, margin=1.0)


def test_rows_are_sorted_by_vehicle_and_time(pair: tuple[Scenario, Recording]) -> None:
    """Vehicles stand in the order of their names, each with consecutive steps."""
    _, recording = pair
    assert list(recording.names) == sorted(recording.names)
    order = np.lexsort((recording.time_index, recording.vehicle))
    np.testing.assert_array_equal(order, np.arange(len(order)))
    for vehicle in range(len(recording.names)):
        rows = recording.rows_of(vehicle)
        assert rows.stop > rows.start
        assert (recording.vehicle[rows] == vehicle).all()
        assert (np.diff(recording.time_index[rows]) == 1).all()


def test_the_ego_is_there_from_the_first_step_to_the_last(
    pair: tuple[Scenario, Recording],
) -> None:
    """Its samples cover the recording and its margins without a gap."""
    scenario, recording = pair
    times = recording.time_index[recording.rows_of(recording.names.index(scenario.ego))]
    margin = round(1.0 / STEP)
    np.testing.assert_array_equal(
        times, np.arange(-margin, round(scenario.duration / STEP) + margin + 1)
    )


def test_speed_and_heading_agree_with_the_front_bumpers_path(
    pair: tuple[Scenario, Recording],
) -> None:
    """x-y-heading are right-handed: away from curves, displacement is speed along heading."""
    _, recording = pair
    same = (np.diff(recording.vehicle) == 0) & (np.abs(np.diff(recording.heading)) < 1e-9)
    moved = np.diff(recording.x) + 1j * np.diff(recording.y)
    mean_speed = (recording.speed[1:] + recording.speed[:-1]) / 2
    expected = mean_speed * STEP * np.exp(1j * recording.heading[1:])
    assert same.sum() > 1000
    assert np.quantile(np.abs(moved - expected)[same], 0.99) < 0.02


def test_kinds_and_sizes_are_those_of_the_vehicle_types(
    pair: tuple[Scenario, Recording],
) -> None:
    """Mixed traffic with the sizes that the route file declares."""
    _, recording = pair
    assert {"car", "van", "truck"} <= set(recording.kinds)
    lengths = {"bus": {12.0}, "van": {5.4}, "truck": {8.0}, "bicycle": {1.7}}
    lengths["car"] = {4.2, 4.5, 4.6, 4.7}
    for kind, length in zip(recording.kinds, recording.length, strict=True):
        assert length in lengths[kind]
    assert recording.simulator.startswith("SUMO ")


def test_another_seed_gives_other_traffic() -> None:
    """Two seeds differ; one seed is the same twice."""
    scenario = short("stop_and_go")
    first, again, other = (run_sumo(scenario, seed) for seed in (1, 1, 2))
    assert first.same_as(again)
    assert not first.same_as(other)


@pytest.mark.parametrize("name", SUMO)
def test_another_process_elsewhere_gives_the_same_bits(name: str, tmp_path: Path) -> None:
    """Neither the working directory, nor the process, nor the hash seed matters."""
    script = (
        "import dataclasses, pickle, sys, scenarios; from sim_bridge.sumo import run_sumo;"
        f"s = dataclasses.replace(scenarios.load({name!r}), duration=5.0);"
        "sys.stdout.buffer.write(pickle.dumps(run_sumo(s, 11)))"
    )
    # A module of this name in the working directory must not be picked up by the child.
    (tmp_path / "libsumo.py").write_text("raise SystemExit('picked up from the cwd')")
    code = f"import sys; sys.path = [{str(ROOT)!r}] + [p for p in sys.path if p]; {script}"
    elsewhere = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env=os.environ | {"PYTHONHASHSEED": "5"},
        capture_output=True,
        check=True,
    )
    assert pickle.loads(elsewhere.stdout).same_as(run_sumo(short(name), 11))


def test_a_margin_adds_rows_and_changes_none() -> None:
    """The rows without margin are found again in those with it."""
    scenario = short("bus_stop")
    plain, wide = run_sumo(scenario, 4), run_sumo(scenario, 4, margin=1.5)
    assert wide.time_index.min() == -15
    inside = (wide.time_index >= 0) & (wide.time_index <= 50)
    for column in ("time_index", "x", "y", "heading", "speed"):
        np.testing.assert_array_equal(getattr(wide, column)[inside], getattr(plain, column))


def test_parameters_reach_the_traffic() -> None:
    """A higher wanted speed and more traffic are seen in the recording."""
    slow, fast = (
        run_sumo(dataclasses.replace(scenarios.load("bus_stop", speed=v), duration=5.0), 2)
        for v in (7.0, 12.0)
    )
    assert np.quantile(slow.speed, 0.9) < 8.5
    assert np.quantile(fast.speed, 0.9) > 10.0
    thin, dense = (
        run_sumo(dataclasses.replace(scenarios.load("bus_stop", traffic=v), duration=5.0), 2)
        for v in (0.05, 0.4)
    )
    assert len(dense.names) > 2 * len(thin.names)


def test_no_vehicle_touches_a_parked_one(pair: tuple[Scenario, Recording]) -> None:
    """Every raw vehicle stays clear of every static box (both are nearly parallel to an axis)."""
    scenario, recording = pair
    length = recording.length[recording.vehicle]
    width = recording.width[recording.vehicle]
    centre_x = recording.x - length / 2 * np.cos(recording.heading)
    centre_y = recording.y - length / 2 * np.sin(recording.heading)
    along = np.abs(np.cos(recording.heading))
    across = np.abs(np.sin(recording.heading))
    for box in scenario.statics:
        cos, sin = abs(math.cos(box.yaw)), abs(math.sin(box.yaw))
        assert math.isclose(max(cos, sin), 1.0, rel_tol=1e-6)
        size_x, size_y = box.length * cos + box.width * sin, box.length * sin + box.width * cos
        gap_x = np.abs(centre_x - box.x) - (length * along + width * across + size_x) / 2
        gap_y = np.abs(centre_y - box.y) - (length * across + width * along + size_y) / 2
        assert np.maximum(gap_x, gap_y).min() > 0.2  # m


def test_nothing_is_left_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The private temporary directory is gone afterwards."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    run_sumo(short("bus_stop"), 1)
    assert list(tmp_path.iterdir()) == []
