"""Values of several seeds, clusters or parts into a mean and its 95 % interval; p-values of several
tests into what they are together."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from mdkf.tables import FloatArray

CONFIDENCE = 0.95
SIGNIFICANCE = 1 - CONFIDENCE
"""Corrected p-value up to which an effect is told from none."""
RESAMPLES = 2000


@dataclass(frozen=True)
class Interval:
    """A mean with its 95 % interval and the number of values behind it.

    low and high are NaN with fewer than two values, all three with none.
    """

    mean: float
    low: float
    high: float
    n: int


def mean_interval(values: ArrayLike) -> Interval:
    """Mean of independent values with Student's t interval; NaN ("no value") is left out."""
    given = np.asarray(values, dtype=np.float64)
    kept = given[np.isfinite(given)]
    n = len(kept)
    if n == 0:
        return Interval(float("nan"), float("nan"), float("nan"), 0)
    mean = float(kept.mean())
    if n == 1:
        return Interval(mean, float("nan"), float("nan"), 1)
    half = float(stats.t.ppf(0.5 + CONFIDENCE / 2, n - 1) * stats.sem(kept))
    return Interval(mean, mean - half, mean + half, n)


def clustered_interval(sums: ArrayLike, counts: ArrayLike) -> Interval:
    """Mean of values in clusters of values that depend on each other, such as the frames of one
    object, with the percentile interval of a bootstrap over clusters.

    sums, counts (clusters,): of the values of each. n is the number of clusters with a value.
    """
    total = np.asarray(sums, dtype=np.float64)
    weight = np.asarray(counts, dtype=np.float64)
    total, weight = total[weight > 0], weight[weight > 0]
    n = len(weight)
    if n == 0:
        return Interval(float("nan"), float("nan"), float("nan"), 0)
    mean = float(total.sum() / weight.sum())
    if n == 1:
        return Interval(mean, float("nan"), float("nan"), 1)
    # Always the same draws: two calls give the same interval, paired ones are of the same clusters.
    drawn = np.random.default_rng(0).integers(0, n, (RESAMPLES, n))
    means = total[drawn].sum(axis=1) / weight[drawn].sum(axis=1)
    low, high = np.quantile(means, [0.5 - CONFIDENCE / 2, 0.5 + CONFIDENCE / 2])
    return Interval(mean, float(low), float(high), n)


def jackknife(overall: float, without: FloatArray) -> Interval:
    """A value with its 95 % interval, of its values (n,) without one of n parts each."""
    n = len(without)
    if n < 2:
        return Interval(overall, float("nan"), float("nan"), n)
    error = np.sqrt((n - 1) / n * np.sum((without - without.mean()) ** 2))
    half = float(stats.t.ppf(0.5 + CONFIDENCE / 2, n - 1) * error)
    return Interval(overall, overall - half, overall + half, n)


def mean_intervals(values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Means, lows and highs (...) of the values (n, ...) along their first axis, each as
    `mean_interval` has them; many at once, no value missing."""
    n = len(values)
    mean = values.mean(axis=0)
    if n < 2:
        return mean, np.full_like(mean, np.nan), np.full_like(mean, np.nan)
    half = stats.t.ppf(0.5 + CONFIDENCE / 2, n - 1) * values.std(axis=0, ddof=1) / np.sqrt(n)
    return mean, mean - half, mean + half


def holm(p: Sequence[float]) -> list[float]:
    """p-values corrected for their number (Holm, 1979): in ascending order the k-th, from 0, times
    how many are left, n - k, and none smaller than the one before."""
    ascending = np.argsort(p, kind="stable")
    left = len(p) - np.arange(len(p))
    corrected = np.empty(len(p))
    corrected[ascending] = np.maximum.accumulate(np.asarray(p)[ascending] * left)
    return [float(value) for value in np.minimum(corrected, 1.0)]


def told(value: float) -> float | None:
    """A value as documents and tables hold it: None for NaN, "no value"."""
    return None if np.isnan(value) else value
