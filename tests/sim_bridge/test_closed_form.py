"""Claim: closed-form truth is the formula, to 1e-12, at any heading, and the gate holds for it."""

import itertools
from typing import Any

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.interpolate import BPoly, PPoly

import scenarios
import sim_bridge
from mdkf import REGIMES, Trace

NAMES = [n for n in scenarios.list() if scenarios.load(n).source == "closed-form"]
SEED = 5


def truth(name: str, dt: float = 0.1, **parameters: float) -> Trace:
    """The trace of a scenario with its parameters."""
    return sim_bridge.simulate(scenarios.load(name, **parameters), SEED, dt)


def times(trace: Trace) -> np.ndarray:
    """Time of each row [s]."""
    return np.asarray(trace.frame * trace.dt)


def each(trace: Trace) -> list[Trace]:
    """The trace of each object alone."""
    return [trace.take(trace.rows_of(int(identifier))) for identifier in trace.ids()]


def along(trace: Trace, heading: float, x: float, y: float) -> list[np.ndarray]:
    """Distance, speed, acceleration and jerk along the heading; nothing happens across it."""
    u, n = np.array([np.cos(heading), np.sin(heading)]), [-np.sin(heading), np.cos(heading)]
    pairs = [np.column_stack([trace.x - x, trace.y - y])]
    pairs += [np.column_stack([getattr(trace, f"{d}{a}") for a in "xy"]) for d in "vaj"]
    for pair in pairs:
        np.testing.assert_allclose(pair @ n, 0.0, atol=1e-12)
    return [np.asarray(pair @ u) for pair in pairs]


def test_the_catalogue_has_the_motions() -> None:
    """Nine of one car, each with its place, heading and own parameters, and one of two bodies."""
    assert set(NAMES) == {
        *("stationary", "constant_velocity", "constant_acceleration", "constant_jerk"),
        *("brake_to_standstill", "pull_away", "circle", "lane_change", "journey", "passing_bus"),
    }


@pytest.mark.parametrize("heading", [0.0, 0.7, -2.9])
@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("stationary", {}),
        ("constant_velocity", {"speed": 7.3}),
        ("constant_acceleration", {"speed": 9.1, "acceleration": -1.1}),
        ("constant_jerk", {"speed": 3.0, "acceleration": 0.4, "jerk": 0.3}),
    ],
)
def test_polynomials(name: str, values: dict[str, float], heading: float) -> None:
    """s = v t + a t^2 / 2 + j t^3 / 6 and its derivatives."""
    trace = truth(name, heading=heading, x=3.0, y=40.0, **values)
    coefficients = [0.0, values.get("speed", 0.0), values.get("acceleration", 0.0) / 2]
    s = Polynomial([*coefficients, values.get("jerk", 0.0) / 6])
    for d, found in enumerate(along(trace, heading, 3.0, 40.0)):
        expected = s.deriv(d)(times(trace)) if d else s(times(trace))
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("heading", [0.0, 2.1])
@pytest.mark.parametrize(
    ("name", "values", "knots"),
    [
        # 10 -> 0 m/s at 2.5 m/s2 with ramps of 5 m/s3: 0.5 s, 3.5 s, 0.5 s.
        (
            "brake_to_standstill",
            {"speed": 10.0, "begin": 2.0, "acceleration": 2.5, "jerk": 5.0},
            ([0, 2, 2.5, 6, 6.5, 20], [0, -5, 0, 5, 0]),
        ),
        # 0 -> 2 m/s at 2 m/s3: 2 m/s2 is not reached for any time, 1 s up and 1 s down.
        (
            "pull_away",
            {"target": 2.0, "begin": 3.0, "acceleration": 4.0, "jerk": 2.0},
            ([0, 3, 4, 5, 12], [0, 2, -2, 0]),
        ),
    ],
)
def test_changes_of_speed(name: str, values: dict[str, float], knots: Any, heading: float) -> None:
    """scipy's integral of the piecewise constant jerk, three times."""
    trace = truth(name, heading=heading, x=0.0, y=9.0, **values)
    t = times(trace)
    jerk = PPoly(np.array([knots[1]], dtype=float), np.array(knots[0], dtype=float))
    a = jerk.antiderivative()
    v, s = a.antiderivative(), a.antiderivative(2)
    start = values.get("speed", 0.0)
    expected = [s(t) + start * t, v(t) + start, a(t), jerk(t)]
    for found, wanted in zip(along(trace, heading, 0.0, 9.0), expected, strict=True):
        np.testing.assert_allclose(found, wanted, atol=1e-12)
    if name == "brake_to_standstill":
        stands = t > 6.5
        assert (np.hypot(trace.vx, trace.vy)[stands] == 0.0).all()
        assert (trace.regime[stands] == REGIMES.index("stationary")).all()


def test_circle() -> None:
    """A point on a circle, in complex numbers: c + r e^(i phase); d times i w per derivative."""
    trace = truth("circle", speed=6.0, radius=15.0, heading=0.3, x=1.0, y=20.0)
    w = 6.0 / 15.0
    forward = np.exp(0.3j)
    spoke = -15.0j * forward * np.exp(1j * w * times(trace))
    centre = 1.0 + 20.0j + 15.0j * forward
    np.testing.assert_allclose(trace.x + 1j * trace.y, centre + spoke, atol=1e-12)
    for d, letter in enumerate("vaj", start=1):
        found = getattr(trace, f"{letter}x") + 1j * getattr(trace, f"{letter}y")
        np.testing.assert_allclose(found, (1j * w) ** d * spoke, atol=1e-12)
    np.testing.assert_allclose(trace.yaw_rate, w, atol=1e-12)
    turned = np.exp(1j * trace.yaw) / (forward * np.exp(1j * w * times(trace)))
    np.testing.assert_allclose(turned, 1.0, atol=1e-12)
    assert trace.turning.all()


def test_lane_change() -> None:
    """The polynomial of degree 7 with zero derivatives at both ends, as scipy finds it."""
    trace = truth("lane_change", speed=9.0, begin=1.5, change=3.0, width=3.2, heading=0.0, y=10.0)
    ends = [[0.0, 0.0, 0.0, 0.0], [3.2, 0.0, 0.0, 0.0]]
    y = BPoly.from_derivatives([0.0, 3.0], ends)
    t = np.clip(times(trace) - 1.5, 0.0, 3.0)
    np.testing.assert_allclose(trace.y - 10.0, y(t), atol=1e-12)
    for d, found in enumerate((trace.vy, trace.ay, trace.jy), start=1):
        np.testing.assert_allclose(found, y.derivative(d)(t), atol=1e-11)
    assert (trace.vx == 9.0).all()
    np.testing.assert_allclose(np.tan(trace.yaw), trace.vy / trace.vx, atol=1e-12)


def test_journeys_are_random_but_smooth() -> None:
    """Other seeds, other journeys; a within its bound, speed within its, jerk one of three."""
    scenario = scenarios.load("journey", acceleration=1.5, jerk=2.5)
    first, again, other = (sim_bridge.simulate(scenario, seed) for seed in (1, 1, 2))
    assert first.content_hash() == again.content_hash() != other.content_hash()
    for trace in (first, other):
        jerk = np.hypot(trace.jx, trace.jy)
        assert np.isclose(jerk[:, None], [0.0, 2.5], atol=1e-9).any(axis=1).all()
        assert (np.hypot(trace.ax, trace.ay) < 1.5 + 1e-9).all()
        assert (np.hypot(trace.vx, trace.vy) < scenario.parameters["speed"] + 1e-9).all()


@pytest.mark.parametrize("name", NAMES)
def test_columns_are_each_others_derivatives(name: str) -> None:
    """Central differences at 100 Hz; across a jump of the jerk the acceleration's is between."""
    trace = truth(name, dt=0.01)
    steps = 2 * trace.dt
    orders = (("", "v", 1e-3), ("v", "a", 2e-2), ("a", "j", None))
    for own, (low, high, tolerance) in itertools.product(each(trace), orders):
        for axis in "xy":
            values = getattr(own, f"{low}{axis}")
            slope = (values[2:] - values[:-2]) / steps
            wanted = getattr(own, f"{high}{axis}")
            if tolerance is not None:
                np.testing.assert_allclose(slope, wanted[1:-1], atol=tolerance)
            else:
                around = np.stack([wanted[:-2], wanted[1:-1], wanted[2:]])
                assert (slope >= around.min(axis=0) - 5e-2).all()
                assert (slope <= around.max(axis=0) + 5e-2).all()


@pytest.mark.parametrize("name", NAMES)
def test_frames_lie_on_one_curve(name: str) -> None:
    """At 100 Hz and at 10 Hz: the same numbers, bit for bit; and the detector sees the car."""
    coarse, fine = truth(name), truth(name, dt=0.01)
    for few, many in zip(each(coarse), each(fine), strict=True):
        for column in ("x", "y", "yaw", "vx", "ay", "jx"):
            assert np.array_equal(getattr(few, column), getattr(many, column)[::10])
    assert len(sim_bridge.detect(coarse, "pointrcnn", SEED)) > 0


def test_a_car_does_not_drive_backwards() -> None:
    """Braking beyond standstill is refused, with the time."""
    scenario = scenarios.load("constant_acceleration", speed=2.0, acceleration=-2.0)
    with pytest.raises(sim_bridge.SimulationError, match=r"drives backwards from 1\.\d s on"):
        sim_bridge.simulate(scenario, 0)


def test_a_motion_names_the_parameters_that_it_takes(tmp_path: Any) -> None:
    """A file that lacks one, or has one too many, is refused in one line."""
    definition = scenarios.load("circle").definition.read_text()
    file = tmp_path / "mine.yaml"
    file.write_text(definition.replace("  radius:", "  radios:"))
    with pytest.raises(
        scenarios.ScenarioError, match=r"motion circle takes the parameters .*radius"
    ):
        scenarios.load(file)
