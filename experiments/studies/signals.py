"""A filter's states into signals of motion, and signals into how well they tell regimes apart.

A signal is a number for each track and frame that is large where the filter believes in motion.
Units and scales differ, so signals are compared by ranks: the probability that one frame's value
exceeds another's, which is the area under the receiver operating characteristic.
"""

import numpy as np

from mdkf import Estimator
from mdkf.imm import ImmState
from mdkf.kalman import KalmanState
from mdkf.tables import FloatArray

CHANCE, CERTAIN = 0.5, 1.0
"""Separations of a signal that tells nothing and of one that is never wrong."""


def signals(estimator: Estimator, state: KalmanState | ImmState) -> dict[str, FloatArray]:
    """Signals of n tracks by name, each (n,).

    `speed` [m/s] and `acceleration` [m/s2] (from order 2 on): norms of the estimates;
    `not cv`: IMM's probability of the models beyond constant velocity;
    `w_v`, `w_a`, `w_j`: MD's weights, the larger one of both axes.
    """
    told = estimator.diagnostics(state)
    found = {
        f"w_{derivative}": np.maximum(told[f"weight_{derivative}x"], told[f"weight_{derivative}y"])
        for derivative in "vaj"
        if f"weight_{derivative}x" in told
    }
    if "probability_cv" in told:
        found["not cv"] = 1.0 - told["probability_cv"]
    mean = state.mean
    if isinstance(state, ImmState):
        mean = np.einsum("nk,nki->ni", state.probability, mean)
    per_axis = mean.reshape(len(mean), 2, -1)
    for name, derivative in (("speed", 1), ("acceleration", 2)):
        if derivative < per_axis.shape[2]:
            found[name] = np.hypot(per_axis[:, 0, derivative], per_axis[:, 1, derivative])
    return found


def separation(values: FloatArray, null: FloatArray) -> FloatArray:
    """How well values (..., n) stand out from those of the null regime (m,): the probability that
    one exceeds one of these, ties counted half; NaN without any of either, shape (...)."""
    n, m = values.shape[-1], len(null)
    if n == 0 or m == 0:
        return np.full(values.shape[:-1], np.nan)
    ordered = np.sort(null)
    below = np.searchsorted(ordered, values, "left")
    upto = np.searchsorted(ordered, values, "right")
    area: FloatArray = (below + upto).sum(axis=-1) / (2.0 * n * m)
    return area


def onset(curve: FloatArray, held: int = 1) -> float:
    """Frames until a separation (T,) rises from chance to certain: the step between the two that
    is nearest to it in least squares. NaN if no step that leaves the last `held` frames on the new
    level is nearer than none.

    A curve that only rises takes its step where it passes half-way, which is as near to the one as
    to the other; noise around that place is averaged, not counted as a response.
    """
    before = np.concatenate([[0.0], np.cumsum((curve - CHANCE) ** 2)])
    after = np.concatenate([[0.0], np.cumsum((curve - CERTAIN) ** 2)])
    misfit = before + (after[-1] - after)
    step = int(np.argmin(misfit[: len(curve) - held + 1]))
    return float(step) if misfit[step] < misfit[-1] else np.nan


def release(before: FloatArray, curve: FloatArray, held: int = 1) -> float:
    """Frames until a separation (T,) falls from certain back to chance, likewise; NaN if it does
    not, or if the frames `before` (k,) are nearer to chance, so that there is nothing to fall
    from."""
    if before.mean() <= (CHANCE + CERTAIN) / 2:
        return np.nan
    return onset(CHANCE + CERTAIN - curve, held)
