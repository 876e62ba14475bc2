"""Pedestrians that the bridge moves itself: along straight lines, exact, smooth, from a seed.

SUMO's own pedestrians move at up to 160 m/s where they change lanes. These change their speed in
stretches of constant jerk and stand where they turn, so that every number is a closed form.
"""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.polynomial import Polynomial

from mdkf.tables import FloatArray, IntArray
from scenarios import Scenario, Walker
from sim_bridge.bodies import Body
from sim_bridge.kinematics import INTEGRATION_STEP, Motion, motion_of
from sim_bridge.randomness import stream
from sim_bridge.stretches import BLEND, Stretch, straight, stretches_between

PEDESTRIAN = (0.6, 0.6, 1.75)
"""Length, width and height [m]."""

ACCELERATION = 1.0
JERK = 2.0
"""Largest acceleration [m/s2], and the jerk of its ramps [m/s3]: 1.4 m/s are reached in 1.9 s."""

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
    pauses = [(p.after, drawn(p.duration, p.duration_spread)) for p in walker.pauses]
    points = np.array(walker.path)
    legs = np.diff(points, axis=0)
    lengths = np.hypot(legs[:, 0], legs[:, 1])
    reached = np.concatenate([[0.0], np.cumsum(lengths)])  # distance at each point [m]
    corners = reached[1:-1]
    stretches, turns = _stretches(max(start, 0.0), speed, corners, pauses, float(reached[-1]))

    t = ticks.astype(np.float64) * INTEGRATION_STEP - min(start, 0.0)
    pose, derivatives = straight(t, stretches, 0.0, 0.0)
    leg = np.searchsorted(turns, t, side="right")
    along = legs[leg] / lengths[leg, None]
    centre = points[leg] + (pose[:, 0] - reached[leg])[:, None] * along
    v, a, j = (derivatives[:, d, :1] * along for d in range(3))
    yaw, rate = _looks(t, np.arctan2(legs[:, 1], legs[:, 0]), turns)
    return motion_of(ticks, centre, np.arctan2(np.sin(yaw), np.cos(yaw)), v, a, j, rate)


def _stretches(
    start: float, speed: float, corners: FloatArray, pauses: list[tuple[float, float]], end: float
) -> tuple[list[Stretch], FloatArray]:
    """All stretches of a walk, and the times at which it begins to turn at each corner [s].

    corners: distances along the path [m]; pauses: distances [m] and durations [s].
    """
    stops = [(float(corner), TURN, True) for corner in corners]
    stops += [(after, duration, False) for after, duration in pauses]
    stops.sort()
    stretches: list[Stretch] = [(start, 0.0)]
    turns = []
    for (before, _, _), (distance, wait, turning) in pairwise(
        [(0.0, 0.0, False), *stops, (end, 0.0, False)]
    ):
        stretches += _from_rest_to_rest(distance - before, speed)
        if turning:
            turns.append(sum(duration for duration, _ in stretches))
        stretches.append((wait, 0.0))
    return stretches, np.array(turns, dtype=np.float64)


def _from_rest_to_rest(distance: float, speed: float) -> list[Stretch]:
    """Stretches over a distance [m] at a speed [m/s], or at what can be reached on the way."""
    if distance <= 0.0:
        return []
    peak = min(speed, _peak(distance))
    faster = stretches_between(0.0, peak, ACCELERATION, JERK)
    slower = stretches_between(peak, 0.0, ACCELERATION, JERK)
    # Both changes of speed are symmetric: half their time at full speed is what they cover.
    changing = peak * sum(duration for duration, _ in faster)
    return [*faster, (max(distance - changing, 0.0) / peak, 0.0), *slower]


def _peak(distance: float) -> float:
    """The speed v [m/s] of which v T(v) is the distance [m], T being the time of a change to it:
    2 sqrt(v / j), or v / a + a / j where the acceleration a is reached."""
    a, j = ACCELERATION, JERK
    without_hold = float((distance * np.sqrt(j) / 2) ** (2 / 3))
    if without_hold <= a**2 / j:
        return without_hold
    return float(a * (np.sqrt((a / j) ** 2 + 4 * distance / a) - a / j) / 2)


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
