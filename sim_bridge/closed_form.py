"""Motions by formula: one car whose truth is exact to rounding, for tests and Monte Carlo.

Every motion is a distance s(t) along a path, with its first three derivatives. Changes of speed are
made of stretches of constant jerk, s''' = const, so that s, s' and s'' are continuous.
"""

from collections.abc import Callable, Mapping
from itertools import accumulate

import numpy as np

from mdkf.tables import FloatArray
from scenarios import ClosedFormScenario
from sim_bridge.bodies import Body, World, at_rest, static_bodies
from sim_bridge.kinematics import INTEGRATION_STEP, Motion, motion_of
from sim_bridge.network_check import SimulationError
from sim_bridge.randomness import stream

CAR = (4.5, 1.8, 1.5)
"""Length, width and height of the car and of the one that carries the sensor [m]."""

Parameters = Mapping[str, float]
Stretch = tuple[float, float]
"""A duration [s] and the jerk that acts in it [m/s3]."""

State = tuple[float, float, float, float]
"""Time [s], distance [m], speed [m/s], acceleration [m/s2]."""


def closed_form_world(scenario: ClosedFormScenario, seed: int, ticks: np.ndarray) -> World:
    """The world of a scenario at ticks (n,), multiples of `INTEGRATION_STEP`."""
    t = ticks * INTEGRATION_STEP
    given = scenario.parameters
    ego = Body("ego", "car", *CAR, motion=at_rest(ticks, 0.0, 0.0, 0.0))
    pose, derivatives = _MOTIONS[scenario.motion](t, given, scenario.duration, seed)
    ahead = np.column_stack([np.cos(pose[:, 2]), np.sin(pose[:, 2])])
    backwards = np.flatnonzero((derivatives[:, 0] * ahead).sum(axis=1) < 0.0)
    if len(backwards):
        raise SimulationError(
            f"{scenario.name}: the car drives backwards from {t[backwards[0]]:.1f} s on; brake"
            " less, or for a shorter time"
        )
    motion = _placed(ticks, pose, derivatives, given)
    car = Body("car", "car", *CAR, motion=motion)
    return World([car, *static_bodies(scenario.statics, ticks)], ego, "closed form")


Local = tuple[FloatArray, FloatArray]
"""Position and yaw (n, 3) in the frame of the start, and velocity, acceleration, jerk (n, 3, 2)."""


def _polynomial(t: FloatArray, given: Parameters, duration: float, seed: int) -> Local:
    """s = v t + a t^2 / 2 + j t^3 / 6."""
    return _straight(t, [(duration, given["jerk"])], given["speed"], given["acceleration"])


def _speed_change(t: FloatArray, given: Parameters, duration: float, seed: int) -> Local:
    """From `speed` to `target`, beginning at `begin`, within the given acceleration and jerk."""
    change = _change(given["speed"], given["target"], given["acceleration"], given["jerk"])
    return _straight(t, [(given["begin"], 0.0), *change], given["speed"], 0.0)


def _journey(t: FloatArray, given: Parameters, duration: float, seed: int) -> Local:
    """Changes between speeds drawn from 0 to `speed` (0 with probability 0.3), each kept for an
    exponential time of mean `pause`."""
    rng = stream("closed-form-journey", seed)

    def draw() -> float:
        return 0.0 if rng.random() < 0.3 else float(rng.uniform(0.0, given["speed"]))

    start = speed = draw()
    stretches: list[Stretch] = []
    while sum(length for length, _ in stretches) < duration:
        target = draw()
        stretches.append((float(rng.exponential(given["pause"])), 0.0))
        stretches += _change(speed, target, given["acceleration"], given["jerk"])
        speed = target
    return _straight(t, stretches, start, 0.0)


def _circle(t: FloatArray, given: Parameters, duration: float, seed: int) -> Local:
    """x = r sin(w t), y = r (1 - cos(w t)), w = speed / radius: a left bend, ahead at first."""
    r, w = given["radius"], given["speed"] / given["radius"]
    sine, cosine = np.sin(w * t), np.cos(w * t)
    pose = np.column_stack([r * sine, r * (1.0 - cosine), w * t])
    v = r * w * np.column_stack([cosine, sine])
    a = r * w**2 * np.column_stack([-sine, cosine])
    j = r * w**3 * np.column_stack([-cosine, -sine])
    return pose, np.stack([v, a, j], axis=1)


def _lane_change(t: FloatArray, given: Parameters, duration: float, seed: int) -> Local:
    """x = v t; y = width (35 u^4 - 84 u^5 + 70 u^6 - 20 u^7), u = (t - begin) / change in [0, 1]:
    the polynomial of degree 7 whose first three derivatives are 0 at both ends."""
    u = np.clip((t - given["begin"]) / given["change"], 0.0, 1.0)
    blend = np.polynomial.Polynomial([0, 0, 0, 0, 35, -84, 70, -20]) * given["width"]
    y, vy, ay, jy = ((blend.deriv(d) if d else blend)(u) / given["change"] ** d for d in range(4))
    vx = np.full(len(t), given["speed"])
    zero = np.zeros(len(t))
    pose = np.column_stack([given["speed"] * t, y, np.arctan2(vy, vx)])
    columns = [np.column_stack(pair) for pair in ((vx, vy), (zero, ay), (zero, jy))]
    return pose, np.stack(columns, axis=1)


_MOTIONS: Mapping[str, Callable[[FloatArray, Parameters, float, int], Local]] = {
    "polynomial": _polynomial,
    "speed_change": _speed_change,
    "circle": _circle,
    "lane_change": _lane_change,
    "journey": _journey,
}


def _change(speed: float, target: float, acceleration: float, jerk: float) -> list[Stretch]:
    """Stretches from one speed to another: jerk, constant acceleration, the opposite jerk."""
    difference = abs(target - speed)
    ramp = min(acceleration / jerk, float(np.sqrt(difference / jerk)))
    if ramp == 0.0:
        return []
    hold = max(difference / (jerk * ramp) - ramp, 0.0)
    sign = 1.0 if target > speed else -1.0
    return [(ramp, sign * jerk), (hold, 0.0), (ramp, -sign * jerk)]


def _straight(t: FloatArray, stretches: list[Stretch], speed: float, acceleration: float) -> Local:
    """Along x through stretches of constant jerk; after the last, at constant velocity."""
    knots = list(accumulate(stretches, _after, initial=(0.0, 0.0, speed, acceleration)))
    jerks = np.array([jerk for _, jerk in stretches] + [0.0])
    times = np.array([knot[0] for knot in knots])
    # A time within the last stretch belongs to it although a rounding may say otherwise.
    place = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(knots) - 1)
    _, s, v, a = np.array(knots)[place].T
    j, dt = jerks[place], t - times[place]
    zero = np.zeros(len(t))
    distance = s + dt * (v + dt * (a / 2 + dt * j / 6))
    along = [v + dt * (a + dt * j / 2), a + dt * j, j]
    pose = np.column_stack([distance, zero, zero])
    return pose, np.stack([np.column_stack([value, zero]) for value in along], axis=1)


def _after(state: State, stretch: Stretch) -> State:
    """The state at the end of a stretch."""
    time, s, v, a = state
    dt, j = stretch
    # Rounding must not leave a stopped car with a speed of 1e-16 m/s, nor with an acceleration.
    v_end, a_end = v + dt * (a + dt * j / 2), a + dt * j
    v_end, a_end = (0.0 if abs(value) < 1e-12 else value for value in (v_end, a_end))
    return time + dt, s + dt * (v + dt * (a / 2 + dt * j / 6)), v_end, a_end


def _placed(
    ticks: np.ndarray, pose: FloatArray, derivatives: FloatArray, given: Parameters
) -> Motion:
    """A motion turned to the heading and moved to the start."""
    cosine, sine = np.cos(given["heading"]), np.sin(given["heading"])
    turn = np.array([[cosine, -sine], [sine, cosine]])
    centre = pose[:, :2] @ turn.T + [given["x"], given["y"]]
    v, a, j = (derivatives[:, d] @ turn.T for d in range(3))
    squared = (v**2).sum(axis=1)
    cross = v[:, 0] * a[:, 1] - v[:, 1] * a[:, 0]
    rate = np.divide(cross, squared, out=np.zeros(len(v)), where=squared > 0)
    heading = given["heading"] + pose[:, 2]
    yaw = np.arctan2(np.sin(heading), np.cos(heading))
    return motion_of(ticks, centre, yaw, v, a, j, rate)
