"""Claim: highway-env's worlds pass SUMO's gate: smooth, differentiable, no jumps, same bytes."""

import dataclasses
import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import scenarios
from mdkf.tables import KINDS, REGIMES, FloatArray, Trace
from scenarios import HighwayScenario, ScenarioError
from sim_bridge import SeedRefused, SimulationError, check_inputs, simulate
from sim_bridge.highway import FREQUENCY, run_highway
from tests.sim_bridge.worlds import (
    assert_velocity_acceleration_and_jerk,
    assert_yaw_rate,
    neighbours,
)

ROOT = Path(__file__).resolve().parents[2]
NAMES = [n for n in scenarios.list() if scenarios.load(n).source == "highway-env"]
FINE, FRAME = 0.01, 0.1  # s


def short(name: str, duration: float = 8.0, **changes: Any) -> HighwayScenario:
    scenario = scenarios.load(name)
    assert isinstance(scenario, HighwayScenario)
    return dataclasses.replace(scenario, duration=duration, **changes)


@cache
def world(name: str, dt: float) -> Trace:
    """The first seed that is not refused."""
    for seed in range(3):
        try:
            return simulate(short(name), seed, dt)
        except SeedRefused:
            continue
    raise AssertionError(f"{name}: three seeds are refused")


@pytest.fixture(scope="module", params=NAMES)
def fine(request: pytest.FixtureRequest) -> Trace:
    """A world at 100 Hz."""
    return world(request.param, FINE)


def speed_of(trace: Trace) -> FloatArray:
    return np.hypot(trace.vx, trace.vy)


def test_columns_are_derivatives_of_the_path(fine: Trace) -> None:
    """Central differences of 100 Hz positions are v, a and j; those of the yaw the yaw rate."""
    assert_velocity_acceleration_and_jerk(fine)
    assert_yaw_rate(fine)


def test_motion_is_physical(fine: Trace) -> None:
    """Jerk, acceleration and yaw rate stay within what vehicles do; nobody jumps or reverses, and
    rear axles roll without slip."""
    moving = speed_of(fine) > 0
    assert np.quantile(np.hypot(fine.jx, fine.jy)[moving], 0.99) < 15.0
    assert np.hypot(fine.ax, fine.ay).max() < 9.0
    assert np.abs(fine.yaw_rate).max() < 1.0
    before, after = neighbours(fine)
    np.testing.assert_array_equal(fine.frame[after] - fine.frame[before], 1)
    moved = (fine.x[after] - fine.x[before]) + 1j * (fine.y[after] - fine.y[before])
    for yaw in (fine.yaw[before], fine.yaw[after]):
        forwards = moved * np.exp(-1j * yaw)
        assert np.abs(forwards.imag).max() < 0.5 * FINE / FRAME
        assert forwards.real.min() > -1e-4
    across = fine.vy * np.cos(fine.yaw) - fine.vx * np.sin(fine.yaw)
    assert np.abs(across - 0.3 * fine.length * fine.yaw_rate).max() < 1e-9


@pytest.mark.parametrize("name", NAMES)
def test_the_smooth_motion_is_that_of_the_simulator(name: str) -> None:
    """Smoothed boxes stay within a metre of highway-env's own, ego vehicle included, mirrored to a
    right-handed frame in which bumper and heading agree."""
    scenario = short(name, 4.0, warmup=2.0)
    trace = simulate(scenario, 0)
    recording = run_highway(scenario, 0, margin=1.5)
    assert scenario.ego in recording.names
    others = [v for v, n in enumerate(recording.names) if n != scenario.ego]
    assert len(others) == len(trace.ids())
    for k, vehicle in enumerate(others):
        rows = recording.rows_of(vehicle)
        here = recording.time_index[rows] % (FREQUENCY * FRAME) == 0
        index = recording.time_index[rows][here] / (FREQUENCY * FRAME)
        half = recording.length[vehicle] / 2
        x = recording.x[rows][here] - half * np.cos(recording.heading[rows][here])
        y = recording.y[rows][here] - half * np.sin(recording.heading[rows][here])
        mine = trace.rows_of(k)
        same = np.isin(index, trace.frame[mine])
        assert same.sum() == len(trace.frame[mine])
        assert np.hypot(trace.x[mine] - x[same], trace.y[mine] - y[same]).max() < 1.0


def test_the_wave_halts_who_follows() -> None:
    """Followers come to an exact standstill, all derivatives zero, and there are tall vehicles."""
    trace = simulate(short("stop_and_go_wave", 16.0), 0)
    still = speed_of(trace) == 0.0
    np.testing.assert_array_equal(still, trace.regime == REGIMES.index("stationary"))
    for name in ("ax", "ay", "jx", "jy", "yaw_rate"):
        assert (getattr(trace, name)[still] == 0.0).all(), name
    assert len(np.unique(trace.object_id[still])) >= 3
    assert {KINDS.index("truck"), KINDS.index("van")} & set(trace.kind.tolist())


CHILD = """
import sys, dataclasses, scenarios, sim_bridge
for name in sys.argv[1:]:
    scenario = dataclasses.replace(scenarios.load(name), duration=2.0, warmup=2.0)
    print(name, sim_bridge.simulate(scenario, 1).content_hash())
"""


@pytest.fixture(scope="module")
def elsewhere() -> dict[str, str]:
    """Hashes of seed 1 of every scenario, from another process with another hash seed."""
    child = subprocess.run(
        [sys.executable, "-P", "-c", CHILD, *NAMES],
        env=os.environ | {"PYTHONHASHSEED": "7", "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    return dict(line.split() for line in child.stdout.splitlines())


@pytest.mark.parametrize("name", NAMES)
def test_a_seed_is_the_same_bytes_in_any_process(name: str, elsewhere: dict[str, str]) -> None:
    """Another process makes the same trace; another seed another."""
    here, other = (simulate(short(name, 2.0, warmup=2.0), seed).content_hash() for seed in (1, 2))
    assert elsewhere[name] == here != other


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"config": {"trafic": 3}}, r"has no number 'trafic' \(did you mean traffic\?\)"),
        ({"config": {"policy_frequency": 3}}, "'policy_frequency' is the bridge's own"),
        ({"parameters": {"lanes_count": 2.5}}, "lanes_count is 2.5, expected a whole number"),
        ({"environment": "mdkf/no-such-v0"}, "no-such"),
        ({"environment": "CartPole-v1"}, "CartPole-v1 is not one of highway-env's"),
    ],
)
def test_bad_settings_are_refused(changes: dict[str, Any], told: str) -> None:
    """highway-env would accept them all; here each is one line, and nothing is simulated."""
    with pytest.raises(SimulationError, match=told) as caught:
        check_inputs(short("motorway", **changes))
    assert "\n" not in str(caught.value)


def test_a_sensor_that_leaves_the_road_refuses_the_seed() -> None:
    """A crash cuts the ego vehicle's track: highway-env's own scenes work, this one does not."""
    few = {"vehicles_count": 15}
    scenario = short(
        "motorway", 2.0, warmup=2.0, environment="highway-v0", parameters={}, config=few
    )
    assert len(simulate(scenario, 0).ids()) > 10
    crowd = dataclasses.replace(scenario, config={**few, "vehicles_density": 40, "ego_spacing": 0})
    with pytest.raises(SeedRefused, match="'ego' is not on the road for all 2 s"):
        simulate(crowd, 0)


def test_a_setting_is_fixed_or_a_parameter(tmp_path: Path) -> None:
    """A name in both places is refused when the file is read; both decide the identity."""
    merge = scenarios.load("merge")
    file = tmp_path / "mine.yaml"
    file.write_text(merge.definition.read_text().replace("config:\n", "config:\n  traffic: 10\n"))
    with pytest.raises(ScenarioError, match="traffic is in config and among the parameters"):
        scenarios.load(file)
    for change in ({"config": {}}, {"parameters": {}}, {"environment": "merge-v0"}):
        assert dataclasses.replace(merge, **change).identity() != merge.identity()  # type: ignore[arg-type]
