"""What an object is really doing: a regime for each row of truth, and whether it turns.

Regimes look along the path, at speed s = |v|, s' = a . v / s and
s'' = (j . v + a . a - s'^2) / s; bends are told by the turning flag instead. Stationary is v = 0
exactly: a car that still creeps to its stop counts as constant velocity.
"""

import numpy as np

from mdkf.tables import REGIMES, BoolArray, CodeArray, FloatArray

CONSTANT_VELOCITY = 0.3
"""Largest |s'| that still counts as constant velocity [m/s2]: over a gap of 2 s it moves an
object by 0.6 m."""

CONSTANT_ACCELERATION = 0.5
"""Largest |s''| that still counts as constant acceleration [m/s3]: over a gap of 2 s it moves an
object by 0.67 m."""

TURNING = 0.05
"""Smallest |yaw rate| that counts as turning [rad/s]: at 10 m/s a lateral 0.5 m/s2."""


def regimes(v: FloatArray, a: FloatArray, j: FloatArray) -> CodeArray:
    """Codes of `mdkf.REGIMES` (n,) from velocity, acceleration and jerk (n, 2)."""
    speed = np.hypot(v[:, 0], v[:, 1])
    # Standstill is exact: six equal control points make every derivative zero.
    stationary = speed == 0.0
    safe = np.where(stationary, 1.0, speed)
    along = (a * v).sum(axis=1) / safe
    change = ((j * v).sum(axis=1) + (a * a).sum(axis=1) - along**2) / safe
    cases = [
        stationary,
        (np.abs(along) < CONSTANT_VELOCITY) & (np.abs(change) < CONSTANT_ACCELERATION),
        np.abs(change) < CONSTANT_ACCELERATION,
    ]
    codes = [REGIMES.index(n) for n in ("stationary", "constant_velocity", "constant_acceleration")]
    other = REGIMES.index("changing_acceleration")
    return np.select(cases, codes, other).astype(np.uint8)


def turning(yaw_rate: FloatArray) -> BoolArray:
    """Whether each row turns (n,), from the yaw rate (n,) [rad/s]."""
    flags: BoolArray = np.abs(yaw_rate) > TURNING
    return flags
