"""Motions along a line: changes of speed made of stretches of constant jerk, and where they lie.

s''' = const in each stretch, so that s, s' and s'' are continuous: truth exact to rounding, at rest
exactly where it is at rest.
"""

from itertools import accumulate

import numpy as np

from mdkf.tables import FloatArray, IntArray
from sim_bridge.kinematics import Motion, motion_of

Stretch = tuple[float, float]
"""A duration [s] and the jerk that acts in it [m/s3]."""

State = tuple[float, float, float, float]
"""Time [s], distance [m], speed [m/s], acceleration [m/s2]."""

Local = tuple[FloatArray, FloatArray]
"""Position and yaw (n, 3) in the frame of the start, and velocity, acceleration, jerk (n, 3, 2)."""

BLEND = np.polynomial.Polynomial([0, 0, 0, 0, 35, -84, 70, -20])
"""35 u^4 - 84 u^5 + 70 u^6 - 20 u^7: from 0 to 1 as u goes there, the polynomial of degree 7 whose
first three derivatives are 0 at both ends."""


def stretches_between(
    speed: float, target: float, acceleration: float, jerk: float
) -> list[Stretch]:
    """Stretches from one speed to another: jerk, constant acceleration, the opposite jerk."""
    difference = abs(target - speed)
    ramp = min(acceleration / jerk, float(np.sqrt(difference / jerk)))
    if ramp == 0.0:
        return []
    hold = max(difference / (jerk * ramp) - ramp, 0.0)
    sign = 1.0 if target > speed else -1.0
    return [(ramp, sign * jerk), (hold, 0.0), (ramp, -sign * jerk)]


def straight(t: FloatArray, stretches: list[Stretch], speed: float, acceleration: float) -> Local:
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


def placed(ticks: IntArray, local: Local, x: float, y: float, heading: float) -> Motion:
    """A motion turned to the heading [rad] and moved to the start x, y [m]."""
    pose, derivatives = local
    cosine, sine = np.cos(heading), np.sin(heading)
    turn = np.array([[cosine, -sine], [sine, cosine]])
    centre = pose[:, :2] @ turn.T + [x, y]
    v, a, j = (derivatives[:, d] @ turn.T for d in range(3))
    squared = (v**2).sum(axis=1)
    cross = v[:, 0] * a[:, 1] - v[:, 1] * a[:, 0]
    rate = np.divide(cross, squared, out=np.zeros(len(v)), where=squared > 0)
    looks = heading + pose[:, 2]
    yaw = np.arctan2(np.sin(looks), np.cos(looks))
    return motion_of(ticks, centre, yaw, v, a, j, rate)
