"""Whole sequences of measurements into estimates, association given.

What a Monte Carlo experiment needs: n tracks at once, all frames in one compiled pass.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mdkf.batch import filter_all, is_batched
from mdkf.estimator import Estimator, arrays, check_step, first_bad, refusal
from mdkf.tables import FloatArray


@dataclass(frozen=True, eq=False)
class Estimates:
    """Estimates of n tracks over T frames.

    position (T, n, 2) [m], velocity (T, n, 2) [m/s], covariance of the position (T, n, 2, 2) [m2].
    predicted (T, n, 2, 2): that covariance before each frame's measurement, in the first frame that
    of the start; (0, n, 2, 2) unless asked for.
    """

    position: FloatArray
    velocity: FloatArray
    covariance: FloatArray
    predicted: FloatArray


def filter_sequence(
    estimator: Estimator,
    positions: ArrayLike,
    noise: ArrayLike,
    dt: float | ArrayLike,
    *,
    predicted: bool = False,
) -> Estimates:
    """Estimates of n tracks from all their measurements, association given.

    positions (T, n, 2) [m], a row of NaN where a track was not measured, except in the first
    frame, where every track starts; noise (2, 2), (n, 2, 2) or (T, n, 2, 2) [m2]; dt, the time
    between frames [s], or (T - 1,) times. predicted: whether `Estimates.predicted` is asked for.
    The built-in estimators run it as one compiled pass when dt is one number; the numbers are the
    same to the bit.
    """
    z = np.ascontiguousarray(positions, dtype=np.float64)
    if z.ndim != 3 or z.shape[2] != 2 or len(z) == 0:
        raise ValueError(f"positions have shape {z.shape}, expected (T, n, 2) with T at least 1")
    R = _noise(np.asarray(noise, dtype=np.float64), z)
    steps = _steps(np.asarray(dt, dtype=np.float64), len(z))
    row = first_bad(z.reshape(-1, 2), R.reshape(-1, 2, 2))
    if row >= 0:
        frame, track = divmod(row, z.shape[1])
        where = f"of frame {frame}, track {track}"
        raise ValueError(refusal(z[frame, track], R[frame % len(R), track], where))
    state = estimator.start(z[0], R[0])
    T, n, _ = z.shape
    before = np.empty((T if predicted else 0, n, 2, 2))
    if predicted:
        before[0] = estimator.covariance(state)
    out = Estimates(np.empty((T, n, 2)), np.empty((T, n, 2)), np.empty((T, n, 2, 2)), before)
    if is_batched(estimator) and np.ndim(dt) == 0:
        built_in: Any = estimator
        filter_all(built_in.batch(state, float(np.asarray(dt))), z, R, *arrays(out))
        return out
    for t in range(T):
        if t > 0:
            state = estimator.predict(state, steps[t - 1])
            if predicted:
                before[t] = estimator.covariance(state)
            state = estimator.update(state, z[t], R[t % len(R)])
        out.position[t] = estimator.position(state)
        out.velocity[t] = estimator.velocity(state)
        out.covariance[t] = estimator.covariance(state)
    return out


def _noise(R: FloatArray, z: FloatArray) -> FloatArray:
    """Noise of every track, (1, n, 2, 2) where it is the same in all frames, else (T, n, 2, 2)."""
    T, n, _ = z.shape
    if R.shape not in ((2, 2), (n, 2, 2), (T, n, 2, 2)):
        raise ValueError(
            f"noise has shape {R.shape}, expected (2, 2), {(n, 2, 2)} or {(T, n, 2, 2)}"
        )
    return np.ascontiguousarray(np.broadcast_to(R, (T if R.ndim == 4 else 1, n, 2, 2)))


def _steps(dt: FloatArray, T: int) -> FloatArray:
    """Times (T - 1,) between the frames [s]."""
    if dt.shape not in ((), (T - 1,)):
        raise ValueError(f"dt has shape {dt.shape}, expected one number or {T - 1}")
    for step in np.unique(dt):
        check_step(float(step))
    return np.broadcast_to(dt, (T - 1,))
