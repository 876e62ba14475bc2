"""Rows of results into estimates: means over scenarios and seeds, with bootstrap intervals.

Every scenario counts alike: an estimate is the mean over scenarios of the mean over their seeds.
Its 95 % interval is the percentile interval of a bootstrap over clusters in two stages, first
scenarios, then the seeds of each drawn one (Davison & Hinkley, 1997, section 3.8), so that it
speaks of other scenarios of this kind, not of these alone; with a single scenario it is over seeds.
Differences are paired: both filters had the same detections of the same seed.

Recorded values are of all sequences together, their interval by jackknife over sequences.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl
from scipy import stats

from experiments.statistics import CONFIDENCE, jackknife
from mdkf.tables import FloatArray, IntArray

RESAMPLES = 1999
"""Of the bootstrap behind an interval."""

AT_A_TIME = 256
"""Drawn scenarios whose seeds are drawn together: they fit a core's cache."""

RECORDED = "recorded"
"""Study of the recorded sequences: scenario `val` is all of them, `val-SSSS` all but SSSS."""

Where = Mapping[str, str]
"""Which rows: columns of `experiments.jobs.ROWS` and the value that each must have."""


@dataclass(frozen=True)
class Estimate:
    """A mean with its 95 % interval: NaN without a value, or with one alone.

    n: seeds (or sequences) with a value; scenarios: they are of.
    """

    value: float
    low: float
    high: float
    n: int
    scenarios: int


def chosen(rows: pl.DataFrame, where: Where) -> pl.DataFrame:
    """scenario, seed and value of the rows asked for that have a value."""
    own = rows.filter(*(pl.col(column) == value for column, value in where.items()))
    return own.filter(pl.col("value").is_not_null()).select("scenario", "seed", "value")


def paired(rows: pl.DataFrame, where: Where, against: Where) -> pl.DataFrame:
    """scenario, seed and value: of the rows asked for less that of their partners, which are those
    with some columns replaced."""
    first, second = chosen(rows, where), chosen(rows, {**where, **against})
    both = first.join(second, on=["scenario", "seed"], suffix="_against", nulls_equal=True)
    return both.select("scenario", "seed", pl.col("value") - pl.col("value_against"))


def estimate(
    rows: pl.DataFrame,
    where: Where,
    against: Where | None = None,
    resamples: int = RESAMPLES,
) -> Estimate:
    """The estimate of the rows asked for, or of their paired differences from others."""
    values = chosen(rows, where) if against is None else paired(rows, where, against)
    if where.get("study") == RECORDED:
        return of_recordings(values)
    return cluster_bootstrap(values, resamples)


def cluster_bootstrap(values: pl.DataFrame, resamples: int = RESAMPLES) -> Estimate:
    """The estimate of values by scenario and seed; the same values give the same bits."""
    own = by_scenario(values)
    n, scenarios = sum(map(len, own)), len(own)
    if n == 0:
        return Estimate(np.nan, np.nan, np.nan, 0, 0)
    mean = float(np.mean([group.mean() for group in own]))
    if n == 1:
        return Estimate(mean, np.nan, np.nan, 1, 1)
    found = drawn(own, mean_of, resamples)
    low, high = found.confidence_interval
    return Estimate(mean, float(low), float(high), n, scenarios)


def mean_of(clusters: FloatArray, axis: int) -> FloatArray:
    """The statistic of an estimate: the mean of clusters (..., n) along an axis."""
    means: FloatArray = clusters.mean(axis=axis)
    return means


def by_scenario(values: pl.DataFrame) -> list[FloatArray]:
    """The values of each scenario (seeds,), in the order of scenarios and seeds."""
    groups = values.sort("scenario", "seed").group_by("scenario", maintain_order=True)
    return [group["value"].to_numpy() for _, group in groups]


def drawn(
    own: Sequence[FloatArray], statistic: Callable[[FloatArray, int], FloatArray], resamples: int
) -> Any:
    """scipy's bootstrap of a statistic of clusters: the means of scenarios that are drawn, each
    over its seeds drawn anew; with a single scenario its seeds are the clusters.

    own: two values at least. statistic: of clusters (..., n) along an axis.
    """
    sample, clusters = (own[0], _themselves) if len(own) == 1 else _two_stages(own)
    return stats.bootstrap(
        (sample,),
        lambda chosen, axis: statistic(clusters(chosen), axis),
        n_resamples=resamples,
        batch=250,
        vectorized=True,
        confidence_level=CONFIDENCE,
        method="percentile",
        rng=np.random.default_rng(1),
    )


def _themselves(values: FloatArray) -> FloatArray:
    return values


def _two_stages(own: Sequence[FloatArray]) -> tuple[IntArray, Callable[[IntArray], FloatArray]]:
    """What is drawn first, the scenarios by number, and the means of drawn ones, for which the
    seeds of each are drawn anew."""
    sizes = np.array(list(map(len, own)))
    longest = int(sizes.max())
    values = np.zeros((len(own), longest))
    for place, of_scenario in enumerate(own):
        values[place, : len(of_scenario)] = of_scenario
    random = np.random.default_rng(0)
    # Room that is used again and again: arrays of all that is drawn are slower to get than to fill.
    uniform, value = np.empty((2, AT_A_TIME, longest))
    seed = np.empty((AT_A_TIME, longest), dtype=np.int64)

    def means(scenario: IntArray) -> FloatArray:
        every = scenario.ravel()
        totals = np.empty(len(every))
        for first in range(0, len(every), AT_A_TIME):
            some = every[first : first + AT_A_TIME, None]
            n, size = len(some), sizes[some]
            random.random(out=uniform[:n])
            np.multiply(uniform[:n], size, out=uniform[:n])
            seed[:n] = uniform[:n]
            np.take(values.ravel(), some * longest + seed[:n], out=value[:n], mode="clip")
            value[:n][np.arange(longest) >= size] = 0.0
            value[:n].sum(axis=-1, out=totals[first : first + n])
        found: FloatArray = (totals / sizes[every]).reshape(scenario.shape)
        return found

    return np.arange(len(own)), means


def of_recordings(values: pl.DataFrame) -> Estimate:
    """All sequences together, with the jackknife interval."""
    whole = pl.col("scenario").str.contains("-").not_()
    overall = values.filter(whole)["value"]
    if overall.is_empty():
        return Estimate(np.nan, np.nan, np.nan, 0, 0)
    without = values.filter(~whole)["value"].to_numpy()
    found = jackknife(overall.item(), without)
    return Estimate(found.mean, found.low, found.high, found.n, 1)
