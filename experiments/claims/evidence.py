"""Paired values of scenarios and seeds into evidence: is the effect above a limit, or below it?

An effect is the mean over scenarios of the mean over their seeds, as in
`experiments.estimates`, and what is drawn is the same. Two tests must agree: the p-value is
the larger of theirs, and the interval has both in it:

- the studentised bootstrap (Davison & Hinkley, 1997, section 5.2.1), t* = (mean* - mean) / error*,
  error the standard error of the scenarios' means;
- Student's t of the scenarios' means.

Corrected p-values come from far out in the tails, where percentiles of so few clusters as there are
scenarios are too short: in simulation without an effect (18 scenarios of 24 seeds, normal) a p of
1/600 came several times too often with them. The bootstrap alone finds effects that are not there
where few scenarios differ at all, Student's t alone where their effects are skewed. Drawing
scenarios and then their seeds counts the seeds' scatter twice; error* grows with it, t* does not.

Recorded values: Student's t of the jackknife over sequences.
"""

from dataclasses import dataclass

import numpy as np
import polars as pl
from scipy import stats

from experiments.estimates import by_scenario, drawn, of_recordings
from experiments.statistics import CONFIDENCE
from mdkf.tables import FloatArray

RESAMPLES = 19_999
"""Of a test: the smallest p-value is their number's, and it is corrected for that of the tests."""


@dataclass(frozen=True)
class Evidence:
    """An effect with its 95 % interval, infinite on a side where too few scenarios bound it.

    above, below: one-sided p-values of "the effect is at most the limit", and of "at least"; NaN,
    as are low and high, with fewer than two values. n: seeds (or sequences); scenarios: they are
    of.
    """

    effect: float
    low: float
    high: float
    above: float
    below: float
    n: int
    scenarios: int


def evidence(values: pl.DataFrame, limit: float = 0.0, resamples: int = RESAMPLES) -> Evidence:
    """Of values by scenario and seed; the same values give the same p-values.

    Values that are all the limit are no evidence: both p-values are 1.
    """
    own = [group - limit for group in by_scenario(values)]
    n = sum(map(len, own))
    means = own[0] if len(own) == 1 else np.array([group.mean() for group in own])
    if n < 2:
        effect = float(means[0]) + limit if n else np.nan
        return Evidence(effect, np.nan, np.nan, np.nan, np.nan, n, len(own))
    excess, error = _mean_and_error(means, 0)
    mean, spread = drawn(own, _mean_and_error, resamples).bootstrap_distribution
    t = _ratio(mean - excess, spread)
    measured = _ratio(excess, error)
    freedom, tail = len(means) - 1, 0.5 - CONFIDENCE / 2
    beyond = 1 + np.array([np.sum(t >= measured), np.sum(t <= measured)])
    by_student = [stats.t.sf(measured, freedom), stats.t.cdf(measured, freedom)]
    above, below = np.maximum(beyond / (resamples + 1), by_student).tolist()
    # No interpolation: some t* are infinite.
    lowest, highest = np.quantile(t, [tail, 1 - tail], method="inverted_cdf")
    students = float(stats.t.ppf(1 - tail, freedom))
    effect = float(excess) + limit
    if error == 0:
        return Evidence(effect, effect, effect, above, below, n, len(own))
    low = effect - max(float(highest), students) * float(error)
    high = effect - min(float(lowest), -students) * float(error)
    return Evidence(effect, low, high, above, below, n, len(own))


def evidence_of_recordings(values: pl.DataFrame, limit: float = 0.0) -> Evidence:
    """Of the value of all sequences together and those without one of them each."""
    found = of_recordings(values)
    if np.isnan(found.low):
        return Evidence(found.value, np.nan, np.nan, np.nan, np.nan, found.n, found.scenarios)
    freedom = found.n - 1
    error = (found.high - found.value) / stats.t.ppf(0.5 + CONFIDENCE / 2, freedom)
    t = _ratio(np.asarray(found.value - limit), np.asarray(error))
    above, below = float(stats.t.sf(t, freedom)), float(stats.t.cdf(t, freedom))
    if error == 0 and t == 0:  # nothing that varies and nothing to find, not a coin's toss
        above = below = 1.0
    return Evidence(found.value, found.low, found.high, above, below, found.n, found.scenarios)


def _mean_and_error(clusters: FloatArray, axis: int) -> FloatArray:
    """Mean and its standard error of clusters (..., n) along an axis: (2, ...); of equal ones
    exactly they and 0, not what rounding leaves."""
    first, equal = clusters.take(0, axis=axis), np.ptp(clusters, axis=axis) == 0
    mean = np.where(equal, first, clusters.mean(axis=axis))
    error = np.where(equal, 0.0, clusters.std(axis=axis, ddof=1) / np.sqrt(clusters.shape[axis]))
    return np.stack([mean, error])


def _ratio(numerator: FloatArray, error: FloatArray) -> FloatArray:
    """Their ratio; without an error 0 for 0, and else infinite."""
    infinite = np.where(numerator == 0, 0.0, np.copysign(np.inf, numerator))
    return np.divide(numerator, error, out=infinite, where=error > 0)
