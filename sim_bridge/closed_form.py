"""Motions by formula: one car, or a bus that hides one, for tests and Monte Carlo.

Every motion is a distance s(t) along a path, with its first three derivatives: truth exact to
rounding. Changes of speed are made of stretches of constant jerk (`sim_bridge.stretches`).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from mdkf.tables import FloatArray, IntArray
from scenarios import ClosedFormScenario
from sim_bridge.bodies import Body, World, at_rest
from sim_bridge.kinematics import INTEGRATION_STEP
from sim_bridge.network_check import SimulationError
from sim_bridge.randomness import stream
from sim_bridge.stretches import BLEND, Local, Stretch, placed, straight, stretches_between

CAR = (4.5, 1.8, 1.5)
"""Length, width and height of a car and of the one that carries the sensor [m]."""

BUS_SECTION = (2.55, 3.2)
"""Width and height of a bus [m]."""

Parameters = Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Mover:
    """What moves by a formula: kind, length, width, height [m]; x, y [m] and heading [rad] of its
    start, and its motion from there."""

    kind: str
    size: tuple[float, float, float]
    start: tuple[float, float, float]
    local: Local


def closed_form_world(scenario: ClosedFormScenario, seed: int, ticks: IntArray) -> World:
    """The world of a scenario at ticks (n,), multiples of `INTEGRATION_STEP`."""
    t = ticks.astype(np.float64) * INTEGRATION_STEP
    given, duration = scenario.parameters, scenario.duration
    if scenario.motion == "passing_bus":
        movers = _passing_bus(t, given, duration)
    else:
        start = given["x"], given["y"], given["heading"]
        movers = [Mover("car", CAR, start, _MOTIONS[scenario.motion](t, given, duration, seed))]
    for mover in movers:
        _refuse_backwards(scenario.name, mover, t)
    bodies = [
        Body(m.kind, m.kind, *m.size, motion=placed(ticks, m.local, *m.start)) for m in movers
    ]
    ego = Body("ego", "car", *CAR, motion=at_rest(ticks, 0.0, 0.0, 0.0))
    return World(bodies, ego, "closed form")


def _refuse_backwards(name: str, mover: Mover, t: FloatArray) -> None:
    pose, derivatives = mover.local
    ahead = np.column_stack([np.cos(pose[:, 2]), np.sin(pose[:, 2])])
    backwards = np.flatnonzero((derivatives[:, 0] * ahead).sum(axis=1) < 0.0)
    if len(backwards):
        raise SimulationError(
            f"{name}: the {mover.kind} drives backwards from {t[backwards[0]]:.1f} s on; brake"
            " less, or for a shorter time"
        )


def _passing_bus(t: FloatArray, given: Parameters, duration: float) -> list[Mover]:
    """A bus and a car beyond it on parallel lines y = Y and y = y_c, seen from the origin, both at
    x = 0 when half the time is over.

    With near sides at Y' and y_c' and speeds V and v (v < 0: against the bus), the bus of
    length L hides the car of length l wholly for (L / Y' - l / y_c') / |V / Y' - v / y_c'|:
    apparent length over apparent speed, as long as x = 0 lies within both.
    """
    bus = (given["bus_length"], *BUS_SECTION)
    return [
        _cruising(t, "bus", bus, given["bus_speed"], given["bus_distance"], duration / 2),
        _cruising(t, "car", CAR, given["car_speed"], given["car_distance"], duration / 2),
    ]


def _cruising(
    t: FloatArray, kind: str, size: tuple[float, float, float], speed: float, y: float, half: float
) -> Mover:
    """Along the line y [m] at constant speed [m/s], at x = 0 at `half` [s]."""
    heading = np.pi if speed < 0 else 0.0
    return Mover(kind, size, (-speed * half, y, heading), straight(t, [], abs(speed), 0.0))


def _polynomial(t: FloatArray, given: Parameters, duration: float, seed: int) -> Local:
    """s = v t + a t^2 / 2 + j t^3 / 6."""
    return straight(t, [(duration, given["jerk"])], given["speed"], given["acceleration"])


def _speed_change(t: FloatArray, given: Parameters, duration: float, seed: int) -> Local:
    """From `speed` to `target`, beginning at `begin`, within the given acceleration and jerk."""
    change = stretches_between(
        given["speed"], given["target"], given["acceleration"], given["jerk"]
    )
    return straight(t, [(given["begin"], 0.0), *change], given["speed"], 0.0)


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
        stretches += stretches_between(speed, target, given["acceleration"], given["jerk"])
        speed = target
    return straight(t, stretches, start, 0.0)


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
    """x = v t; y = width `BLEND`(u), u = (t - begin) / change in [0, 1]."""
    u = np.clip((t - given["begin"]) / given["change"], 0.0, 1.0)
    blend = BLEND * given["width"]
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
