"""Pedestrians that the bridge moves itself: along straight lines, exact, smooth, from a seed.

SUMO's own pedestrians move at up to 160 m/s where they change lanes. These blend from rest to
their speed v and back, s' = v `BLEND`(t / T), and stand where they turn: every number is a closed
form, and the jerk is continuous and differentiable.
"""

from collections.abc import Iterator

import numpy as np
from numpy.polynomial import Polynomial

from mdkf.tables import FloatArray, IntArray
from scenarios import Scenario, Walker
from sim_bridge.bodies import Body
from sim_bridge.kinematics import INTEGRATION_STEP, Motion, motion_of
from sim_bridge.randomness import stream
from sim_bridge.stretches import BLEND

PEDESTRIAN = (0.6, 0.6, 1.75)
"""Length, width and height [m]."""

ACCELERATION = 1.0
JERK = 2.0
"""Largest acceleration [m/s2] and jerk [m/s3]: 1.4 m/s are reached in 3.1 s."""

SLOPE = 35 / 16
CURVATURE = 84 / np.sqrt(125)
"""Largest first and second derivative of `BLEND`, at u = 1/2 and where u (1 - u) = 1/5."""

TURN = 1.0
"""For how long a walker stands at a corner and turns [s]."""


def walkers(scenario: Scenario, seed: int, ticks: IntArray) -> Iterator[Body]:
    """A scenario's pedestrians at ticks (n,), each drawn from a stream of its own."""
    for k, walker in enumerate(scenario.walkers):
        rng = stream("walker", scenario.name, seed, k)
        yield Body(f"walker {k}", "pedestrian", *PEDESTRIAN, motion=_walk(walker, rng, ticks))


def _walk(walker: Walker, rng: np.random.Generator, ticks: IntArray) -> Motion:
    def drawn(middle: float, spread: float) -> float:
        return middle + spread * float(rng.uniform(-1.0, 1.0))

    speed = drawn(walker.speed, walker.speed_spread)
    start = drawn(walker.start, walker.start_spread)
    pauses = [(p.after, drawn(p.duration, p.duration_spread), False) for p in walker.pauses]
    points = np.array(walker.path)
    legs = np.diff(points, axis=0)
    lengths = np.hypot(legs[:, 0], legs[:, 1])
    reached = np.concatenate([[0.0], np.cumsum(lengths)])  # distance at each point [m]
    corners = [(float(corner), TURN, True) for corner in reached[1:-1]]
    stops = [*sorted(corners + pauses), (float(reached[-1]), 0.0, False)]

    t = ticks.astype(np.float64) * INTEGRATION_STEP
    (distance, *derivatives), turns = _from_stop_to_stop(t, start, speed, stops)
    leg = np.searchsorted(turns, t, side="right")
    along = legs[leg] / lengths[leg, None]
    centre = points[leg] + (distance - reached[leg])[:, None] * along
    v, a, j = (derivative[:, None] * along for derivative in derivatives)
    yaw, rate = _looks(t, np.arctan2(legs[:, 1], legs[:, 0]), turns)
    return motion_of(ticks, centre, np.arctan2(np.sin(yaw), np.cos(yaw)), v, a, j, rate)


def _from_stop_to_stop(
    t: FloatArray, start: float, speed: float, stops: list[tuple[float, float, bool]]
) -> tuple[FloatArray, FloatArray]:
    """Distance and its first three derivatives (4, n) at times t (n,), and the times at which a
    walker begins to turn [s].

    stops: distance along the path [m], for how long it stands there [s], whether to turn.
    """
    motion = np.zeros((4, len(t)))
    turns = []
    now, before = start, 0.0
    for after, wait, turning in stops:
        if after > before:
            begun = t >= now
            now, motion[:, begun] = _from_rest_to_rest(t[begun], now, before, after, speed)
        if turning:
            turns.append(now)
        now, before = now + wait, after
    return motion, np.array(turns, dtype=np.float64)


def _from_rest_to_rest(
    t: FloatArray, begin: float, before: float, after: float, speed: float
) -> tuple[float, FloatArray]:
    """The time of arrival [s], and distance and its derivatives (4, n), from one distance [m] to
    another at a speed [m/s], or at what can be reached on the way."""
    distance = after - before
    # A change of speed takes T(v) on average at v / 2: v T(v) is the least distance for both.
    by_acceleration = np.sqrt(distance * ACCELERATION / SLOPE)
    by_jerk = np.cbrt(distance**2 * JERK / CURVATURE)
    peak = min(speed, by_acceleration, by_jerk)
    change = max(SLOPE * peak / ACCELERATION, np.sqrt(CURVATURE * peak / JERK))
    end = float(begin + distance / peak + change)
    # The way to a stop is the way from one, seen backwards: exact where the speed is nearly 0.
    since = np.minimum(t - begin, end - t)
    side = np.where(t - begin < end - t, 1.0, -1.0)
    u = np.clip(since / change, 0.0, 1.0)
    covered = peak * (change * BLEND.integ()(u) + np.maximum(since - change, 0.0))
    along = np.where(side > 0.0, before + covered, after - covered)
    derivatives = (peak * BLEND.deriv(d)(u) * (side / change) ** d for d in range(3))
    return end, np.stack([along, *derivatives])


def _looks(t: FloatArray, headings: FloatArray, turns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Yaw [rad] and its rate [rad/s]: the legs' headings, and the shorter way between them."""
    yaw, rate = np.full(len(t), headings[0]), np.zeros(len(t))
    slope: Polynomial = BLEND.deriv()
    for begin, difference in zip(turns, np.diff(headings), strict=True):
        angle = np.arctan2(np.sin(difference), np.cos(difference))
        u = np.clip((t - begin) / TURN, 0.0, 1.0)
        yaw += angle * BLEND(u)
        rate += angle * slope(u) / TURN
    return yaw, rate
