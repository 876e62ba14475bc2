"""Noise that hangs together in time, drawn for many objects at once, each from its own stream."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.random import Generator
from scipy.special import ndtr, stdtrit

from mdkf.compiled import kernel
from mdkf.tables import BoolArray, FloatArray, IntArray
from sim_bridge.profile import Correlation

FARTHEST = 8.0
"""Beyond it a standard normal number is taken as this: one in 10^15."""
NODES = 1 << 14
"""Stretches between them."""


def correlated(
    streams: Sequence[Generator], counts: IntArray, laws: Sequence[Correlation], dt: float
) -> FloatArray:
    """Standard normal noise (laws, rows): white, drifting and fixed parts by each law's shares.

    Object k has `counts[k]` consecutive rows, dt [s] apart, drawn from `streams[k]`: what another
    object draws changes nothing of its own.
    """
    ends = np.cumsum(counts)
    shape = (len(laws), int(ends[-1]) if len(ends) else 0)
    noise, drive, fixed = np.empty(shape), np.empty(shape), np.empty(shape)
    for rng, end, n in zip(streams, ends, counts, strict=True):
        rows = slice(end - n, end)
        noise[:, rows], drive[:, rows] = rng.standard_normal((2, len(laws), n))
        fixed[:, rows] = rng.standard_normal((len(laws), 1))
    first = np.zeros(shape[1], dtype=np.bool_)
    first[(ends - counts)[counts > 0]] = True
    for k, law in enumerate(laws):
        _drift(drive[k], first, float(np.exp(-dt / law.drift_time)))
        noise[k] *= np.sqrt(max(1.0 - law.drift_share - law.fixed_share, 0.0))
        noise[k] += np.sqrt(law.drift_share) * drive[k]
        noise[k] += np.sqrt(law.fixed_share) * fixed[k]
    return noise


@kernel
def _drift(values: FloatArray, first: BoolArray, keep: float) -> None:
    """White noise into a first-order Markov process, stationary from an object's first row on."""
    fresh = np.sqrt(1.0 - keep * keep)
    for k in range(values.shape[0]):
        if not first[k]:
            values[k] = keep * values[k - 1] + fresh * values[k]


def heavy_tailed(normal: FloatArray, tail: float) -> FloatArray:
    """Standard normal numbers as numbers of Student's distribution with `tail` degrees of freedom.

    Each becomes the quantile of its own probability, so what hangs together still does. Between
    16 385 exact quantiles it is interpolated (relative error below 1e-5).
    """
    quantiles, steps = _quantiles(tail)
    # The nodes are evenly apart: no search as in np.interp, which takes ten times as long.
    place = (np.clip(normal, -FARTHEST, FARTHEST) + FARTHEST) * (NODES / (2.0 * FARTHEST))
    node = np.minimum(place.astype(np.int64), NODES - 1)
    numbers: FloatArray = quantiles[node] + (place - node) * steps[node]
    return numbers


@lru_cache(maxsize=64)
def _quantiles(tail: float) -> tuple[FloatArray, FloatArray]:
    """Quantiles at evenly spaced normal numbers, and the steps from each to the next."""
    positive = np.linspace(0.0, FARTHEST, NODES // 2 + 1)
    # The upper probability 1 - p loses its digits for large quantiles; the lower one keeps them.
    upper = -stdtrit(tail, ndtr(-positive))
    upper[0] = 0.0
    quantiles = np.concatenate([-upper[:0:-1], upper])
    steps = np.diff(quantiles)
    for array in (quantiles, steps):
        array.flags.writeable = False
    return quantiles, steps


def drifting(rng: Generator, n: int, dt: float, time: float) -> FloatArray:
    """Standard normal noise (n,) that forgets with time constant `time` [s]."""
    law = Correlation(drift_share=1.0, drift_time=time, fixed_share=0.0)
    noise: FloatArray = correlated([rng], np.array([n]), [law], dt)[0]
    return noise
