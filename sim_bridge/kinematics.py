"""A simulator's front-bumper samples into smooth motion with exact derivatives.

The front bumper follows a uniform quintic B-spline whose control points are its samples every
0.5 s: four times continuously differentiable, without overshoot, exactly at rest where six
control points are equal. The heading h is a tractrix behind it, the rear axle rolling without
slip at the wheelbase l behind the bumper: h' = (v . n) / l, with u = (cos h, sin h),
n = (-sin h, cos h); it is integrated, its derivatives are closed forms. The box centre is
c = p - L/2 u, so c' = v - L/2 h' n, c'' = a - L/2 (h'' n - h'^2 u),
c''' = j - L/2 ((h''' - h'^3) n - 3 h' h'' u).
"""

from dataclasses import dataclass, fields

import numpy as np
from numba import njit
from scipy.interpolate import BSpline

from mdkf.tables import FloatArray, IntArray

CONTROL_STEP = 0.5
"""Time between control points [s]: short enough to follow SUMO within a metre, long enough to
round its integrator's steps in acceleration."""

WHEELBASE = 0.8
"""Distance from front bumper to rear axle, as a share of the vehicle's length."""

INTEGRATION_STEP = 0.01
"""Step of the heading's Runge-Kutta integration [s]; frames must fall on it."""

_DEGREE = 5
_MARGIN = 2
"""Control points at either end that only shape the motion: a second before and after it."""


@dataclass(frozen=True, eq=False)
class Motion:
    """A box centre's motion, all (n,): ticks (multiples of `INTEGRATION_STEP`), x, y [m],
    yaw [rad], vx, vy [m/s], ax, ay [m/s2], jx, jy [m/s3], yaw_rate [rad/s]."""

    tick: IntArray
    x: FloatArray
    y: FloatArray
    yaw: FloatArray
    vx: FloatArray
    vy: FloatArray
    ax: FloatArray
    ay: FloatArray
    jx: FloatArray
    jy: FloatArray
    yaw_rate: FloatArray


def smooth_motion(
    first_tick: int,
    front: FloatArray,
    heading: FloatArray,
    length: float,
    stride: int,
) -> Motion | None:
    """Smooth motion of one vehicle, at every `stride`-th tick (counted from tick 0).

    first_tick: the time of the first control point in `INTEGRATION_STEP`; front (n, 2) [m]:
    front-bumper positions every `CONTROL_STEP`; heading (n,) [rad]: the simulator's, of which
    one value starts the tractrix; length [m]. None if the vehicle lives too shortly.
    """
    per_control = round(CONTROL_STEP / INTEGRATION_STEP)
    if len(front) <= _DEGREE:
        return None
    # A local origin: large coordinates would cost digits in every difference.
    origin = front[0]
    spline = BSpline(np.arange(len(front) + _DEGREE + 1) - 3.0, front - origin, _DEGREE)
    # Half steps for Runge-Kutta; the curve is defined between the inner control points.
    intervals = (len(front) - 1 - 2 * _MARGIN) * per_control
    halves = _MARGIN + np.arange(2 * intervals + 1) / (2 * per_control)
    halves[-1] = len(front) - 1 - _MARGIN
    velocity = spline.derivative()(halves) / CONTROL_STEP
    wheelbase = WHEELBASE * length
    yaw = _tractrix(velocity, heading[_MARGIN], wheelbase, INTEGRATION_STEP)

    start = first_tick + _MARGIN * per_control
    ticks = np.arange(start, start + intervals + 1)
    kept = ticks % stride == 0
    u = halves[::2][kept]
    p = spline(u) + origin
    v, a, j = (spline.derivative(d)(u) / CONTROL_STEP**d for d in (1, 2, 3))
    return _centre(ticks[kept], p, v, a, j, yaw[kept], length, wheelbase)


def within(motion: Motion, n_frames: int, stride: int) -> Motion | None:
    """The motion in the frames 0..n_frames-1, `stride` ticks apart; None if it is in none."""
    inside = (motion.tick >= 0) & (motion.tick < n_frames * stride) & (motion.tick % stride == 0)
    if not inside.any():
        return None
    return Motion(*(getattr(motion, field.name)[inside] for field in fields(Motion)))


def raw_motion(
    tick: IntArray,
    front: FloatArray,
    heading: FloatArray,
    speed: FloatArray,
    length: float,
    step: float,
) -> Motion | None:
    """The simulator's own numbers, for comparison: positions and headings as sampled every
    `step` [s] (n,), velocity along the heading, everything above it by differences. The
    columns are not each other's derivatives. None if there are fewer than two samples.
    """
    if len(front) < 2:
        return None
    u = np.column_stack([np.cos(heading), np.sin(heading)])
    centre, velocity = front - length / 2 * u, speed[:, None] * u
    acceleration = np.gradient(velocity, step, axis=0)
    jerk = np.gradient(acceleration, step, axis=0)
    yaw_rate = np.gradient(np.unwrap(heading), step)
    yaw = np.arctan2(u[:, 1], u[:, 0])
    return motion_of(tick, centre, yaw, velocity, acceleration, jerk, yaw_rate)


def _centre(
    tick: IntArray,
    p: FloatArray,
    v: FloatArray,
    a: FloatArray,
    j: FloatArray,
    yaw: FloatArray,
    length: float,
    wheelbase: float,
) -> Motion:
    """The box centre's motion from the bumper's p, v, a, j (n, 2) and the tractrix's yaw."""
    u = np.column_stack([np.cos(yaw), np.sin(yaw)])
    n = np.column_stack([-u[:, 1], u[:, 0]])
    along, across = (v * u).sum(1), (v * n).sum(1)
    h1 = across / wheelbase
    h2 = ((a * n).sum(1) - h1 * along) / wheelbase
    h3 = ((j * n).sum(1) - 2 * h1 * (a * u).sum(1) - h2 * along - h1**2 * across) / wheelbase
    half = length / 2
    h1c, h2c, h3c = h1[:, None], h2[:, None], h3[:, None]
    centre = p - half * u
    velocity = v - half * h1c * n
    acceleration = a - half * (h2c * n - h1c**2 * u)
    jerk = j - half * ((h3c - h1c**3) * n - 3 * h1c * h2c * u)
    wrapped = np.arctan2(u[:, 1], u[:, 0])
    return motion_of(tick, centre, wrapped, velocity, acceleration, jerk, h1)


def motion_of(
    tick: IntArray,
    centre: FloatArray,
    yaw: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    jerk: FloatArray,
    yaw_rate: FloatArray,
) -> Motion:
    """A motion from the centre and its derivatives, (n, 2) each."""
    return Motion(
        tick,
        x=centre[:, 0],
        y=centre[:, 1],
        yaw=yaw,
        vx=velocity[:, 0],
        vy=velocity[:, 1],
        ax=acceleration[:, 0],
        ay=acceleration[:, 1],
        jx=jerk[:, 0],
        jy=jerk[:, 1],
        yaw_rate=yaw_rate,
    )


@njit(cache=True)
def _tractrix(velocity: FloatArray, start: float, wheelbase: float, step: float) -> FloatArray:
    """Heading at whole steps from the bumper's velocity at half steps (2n + 1, 2); RK4."""
    n = (len(velocity) - 1) // 2
    yaw = np.empty(n + 1)
    yaw[0] = start
    for k in range(n):
        v0, v1, v2 = velocity[2 * k], velocity[2 * k + 1], velocity[2 * k + 2]
        h = yaw[k]
        k1 = _turn(v0, h, wheelbase)
        k2 = _turn(v1, h + 0.5 * step * k1, wheelbase)
        k3 = _turn(v1, h + 0.5 * step * k2, wheelbase)
        k4 = _turn(v2, h + step * k3, wheelbase)
        yaw[k + 1] = h + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return yaw


@njit(cache=True)
def _turn(v: FloatArray, h: float, wheelbase: float) -> float:
    return float((v[1] * np.cos(h) - v[0] * np.sin(h)) / wheelbase)
