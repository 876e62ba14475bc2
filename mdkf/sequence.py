"""Whole sequences of measurements into estimates, association given.

What a Monte Carlo experiment needs: n tracks at once, all frames in one compiled pass.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mdkf.estimator import Estimator, check_finite, check_step
from mdkf.tables import FloatArray


@dataclass(frozen=True, eq=False)
class Estimates:
    """Estimates of n tracks over T frames.

    position (T, n, 2) [m], velocity (T, n, 2) [m/s], covariance of the position (T, n, 2, 2) [m2].
    """

    position: FloatArray
    velocity: FloatArray
    covariance: FloatArray


def filter_sequence(
    estimator: Estimator, positions: ArrayLike, noise: ArrayLike, dt: float | ArrayLike
) -> Estimates:
    """Estimates of n tracks from all their measurements, association given.

    positions (T, n, 2) [m], a row of NaN where a track was not measured, except in the first
    frame, where every track starts; noise (2, 2), (n, 2, 2) or (T, n, 2, 2) [m2]; dt, the time
    between frames [s], or (T - 1,) times. The built-in estimators run it as one compiled pass
    when dt is one number; the numbers are the same to the bit.
    """
    z = np.ascontiguousarray(positions, dtype=np.float64)
    if z.ndim != 3 or z.shape[2] != 2 or len(z) == 0:
        raise ValueError(f"positions have shape {z.shape}, expected (T, n, 2) with T at least 1")
    T, n, _ = z.shape
    R = np.asarray(noise, dtype=np.float64)
    R = np.ascontiguousarray(np.broadcast_to(R, (T if R.ndim == 4 else 1, n, 2, 2)))
    steps = np.broadcast_to(np.asarray(dt, dtype=np.float64), (T - 1,))
    state = estimator.start(z[0], R[0])
    out = Estimates(np.empty((T, n, 2)), np.empty((T, n, 2)), np.empty((T, n, 2, 2)))
    compiled = getattr(estimator, "filter", None)
    if compiled is not None and np.ndim(dt) == 0:
        check_step(float(np.asarray(dt)))
        check_finite(z.reshape(-1, 2), R.reshape(-1, 2, 2))
        compiled(state, z, R, float(np.asarray(dt)), out)
        return out
    for t in range(T):
        if t > 0:
            state = estimator.update(estimator.predict(state, steps[t - 1]), z[t], R[t % len(R)])
        out.position[t] = estimator.position(state)
        out.velocity[t] = estimator.velocity(state)
        out.covariance[t] = estimator.covariance(state)
    return out
