"""Claim: how long the passing bus hides the car is what geometry says, to two frames.

The prediction looks at the corners of the two boxes in continuous time, by angles from the sensor
at the origin and by root finding; nothing of it comes from the code under test.
"""

import itertools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

import scenarios
import sim_bridge
from experiments.worlds.describe import describe
from mdkf import KINDS, REGIMES, Trace
from sim_bridge import SimulationError

HALF = 10.0  # s, when both are in front of the sensor
CAR = (4.5, 1.8)  # length, width [m]
BUS_WIDTH = 2.55  # m


def world(dt: float = 0.1, **given: float) -> tuple[Trace, Trace]:
    """The bus, and the car beyond it."""
    trace = sim_bridge.simulate(scenarios.load("passing_bus", **given), 0, dt)
    assert [KINDS[trace.kind[trace.rows_of(k)[0]]] for k in trace.ids()] == ["bus", "car"]
    bus, car = (trace.take(trace.rows_of(k)) for k in (0, 1))
    return bus, car


def bearings(x: float, y: float, length: float, width: float) -> tuple[float, float]:
    """From the y axis [rad]: the leftmost and the rightmost corner of an upright box."""
    ends = [
        np.arctan2(x + a * length / 2, y + b * width / 2)
        for a, b in itertools.product((-1, 1), repeat=2)
    ]
    return min(ends), max(ends)


def predicted(threshold: float, given: dict[str, float]) -> float:
    """For how long less than `threshold` of the car's angle is free of the bus's [s]; 0 means that
    nothing is."""

    def uncovered(time: float) -> float:
        since = time - HALF
        left, right = bearings(given["car_speed"] * since, given["car_distance"], *CAR)
        size = given["bus_length"], BUS_WIDTH
        start, stop = bearings(given["bus_speed"] * since, given["bus_distance"], *size)
        if threshold > 0:
            common = max(min(right, stop) - max(left, start), 0.0)
            return 1.0 - common / (right - left) - threshold
        return max(start - left, right - stop)  # negative within, zero as the last edge vanishes

    def crossing(uncovered: Callable[[float], float], outside: float) -> float:
        assert uncovered(HALF) < 0 < uncovered(outside)
        return float(brentq(uncovered, HALF, outside, xtol=1e-9))

    return crossing(uncovered, 2 * HALF) - crossing(uncovered, 0.0)


GRID = [
    {
        "bus_speed": bus_speed,
        "bus_length": bus_length,
        "bus_distance": bus_distance,
        "car_speed": car_speed,
        "car_distance": car_distance,
    }
    for bus_speed, bus_length, (bus_distance, car_distance), car_speed in itertools.product(
        (4.0, 8.0, 15.0, 30.0),
        (6.0, 12.0, 18.0),
        ((4.0, 20.0), (8.0, 20.0), (12.0, 50.0)),
        (-12.0, -3.0, 0.0, 2.0, 5.0),
    )
]


@pytest.mark.parametrize("dt", [0.1, 0.01])
def test_the_occlusion_is_as_long_as_predicted(dt: float) -> None:
    """Wholly hidden, and less than 15 % visible: one run of frames each, within two frames of the
    prediction at 10 Hz, and within two of 0.01 s at 100 Hz."""
    for given in GRID if dt == 0.1 else GRID[::7]:
        _, car = world(dt, **given)
        for threshold, hidden in ((0.15, car.visible < 0.15), (0.0, car.visible == 0.0)):
            assert np.count_nonzero(np.diff(hidden.astype(int))) == 2, (given, "one run")
            measured = np.count_nonzero(hidden)
            assert abs(measured - predicted(threshold, given) / dt) <= 2, (given, threshold)


@pytest.mark.parametrize("length", [6.0, 12.0, 20.0])
@pytest.mark.parametrize("speed", [4.0, 10.0, 25.0])
def test_a_standing_car_is_hidden_for_length_over_speed(speed: float, length: float) -> None:
    """By hand: the shadow's edges meet the near corners of the car, so that the bus has to be
    l Y' / y' longer than nothing; below 15 % the edge is at 0.7 of the car's half angle."""
    given = {"bus_speed": speed, "bus_length": length, "bus_distance": 8.0, "car_distance": 20.0}
    bus_side, car_side = 8.0 - BUS_WIDTH / 2, 20.0 - CAR[1] / 2
    _, car = world(0.01, **given)
    wholly = (length - CAR[0] * bus_side / car_side) / speed
    nearly = (length - 2 * bus_side * np.tan(0.7 * np.arctan(CAR[0] / 2 / car_side))) / speed
    assert abs(np.count_nonzero(car.visible == 0.0) * 0.01 - wholly) <= 0.02
    assert abs(np.count_nonzero(car.visible < 0.15) * 0.01 - nearly) <= 0.02
    standing = {**given, "car_speed": 0.0}
    assert predicted(0.0, standing) == pytest.approx(wholly, abs=1e-6)
    assert predicted(0.15, standing) == pytest.approx(nearly, abs=1e-6)


def test_a_slow_car_is_hidden_for_apparent_length_over_apparent_speed() -> None:
    """The formula of the module, while the car is in front of the sensor: towards and along."""
    for speed in (-0.6, 0.6):
        given = {"bus_speed": 6.0, "bus_length": 12.0, "bus_distance": 8.0, "car_distance": 20.0}
        bus_side, car_side = 8.0 - BUS_WIDTH / 2, 20.0 - CAR[1] / 2
        expected = (12.0 / bus_side - CAR[0] / car_side) / (6.0 / bus_side - speed / car_side)
        _, car = world(0.01, **given, car_speed=speed)
        assert abs(np.count_nonzero(car.visible == 0.0) * 0.01 - expected) <= 0.02


def test_both_move_by_the_formula() -> None:
    """At constant speed along their lines, in front of the sensor at 10 s, looking where they go;
    sizes are as given; the bus is never hidden."""
    bus, car = world(bus_speed=7.0, bus_length=15.0, car_speed=-4.0, car_distance=30.0)
    since = bus.frame * 0.1 - HALF
    for body, speed, y in ((bus, 7.0, 8.0), (car, -4.0, 30.0)):
        np.testing.assert_allclose(body.x, speed * since, atol=1e-12)
        np.testing.assert_allclose(body.y, y, atol=1e-12)
        np.testing.assert_allclose(body.vx, speed, atol=1e-12)
        np.testing.assert_allclose(np.cos(body.yaw), np.sign(speed), atol=1e-12)
        for column in ("vy", "ax", "ay", "jx", "jy", "yaw_rate"):
            np.testing.assert_allclose(getattr(body, column), 0.0, atol=1e-12)
        assert (body.regime == REGIMES.index("constant_velocity")).all()
    assert set(zip(bus.length, bus.width, bus.height, strict=True)) == {(15.0, 2.55, 3.2)}
    assert set(zip(car.length, car.width, car.height, strict=True)) == {(4.5, 1.8, 1.5)}
    assert (bus.visible == 1.0).all()


def test_every_choice_within_bounds_is_a_world() -> None:
    """No two parameters at their bounds make boxes overlap."""
    specs = scenarios.load("passing_bus").parameter_specs
    for values in itertools.product(*((spec.minimum, spec.maximum) for spec in specs)):
        world(0.5, **{spec.name: v for spec, v in zip(specs, values, strict=True)})


def test_the_description_tells_the_occlusion() -> None:
    """One natural occlusion, in the class of its length: 12 m at 5 m/s take 2.1 s."""
    trace = sim_bridge.simulate(scenarios.load("passing_bus"), 0)
    assert describe(trace).occlusions["21-50"] == 1


def test_its_parameters_are_its_own(tmp_path: Path) -> None:
    """A file without one of them, or with one of a lone car's, is refused."""
    definition = scenarios.load("passing_bus").definition.read_text()
    file = tmp_path / "mine.yaml"
    file.write_text(definition.replace("  car_speed:", "  heading:"))
    with pytest.raises(scenarios.ScenarioError, match=r"motion passing_bus takes .*car_speed"):
        scenarios.load(file)
    with pytest.raises(scenarios.ScenarioError, match=r"bus_speed: expected a number from 2 to 30"):
        scenarios.load("passing_bus", bus_speed=0.0)
    with pytest.raises(SimulationError, match="dt is"):
        sim_bridge.simulate(scenarios.load("passing_bus"), 0, 0.005)
