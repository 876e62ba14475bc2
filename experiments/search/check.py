"""Trials into verdicts: the worst few, each from a region of its own, on seeds that no search saw.

The largest of many noisy means is large by luck, however many seeds are in each. So the search only
proposes: effects, intervals and p-values are of fresh seeds alone, by Student's t over seeds, and
corrected by Holm for the number of candidates.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from experiments.jobs import Store
from experiments.search.optimise import Done, Trial, Values, values_of
from experiments.search.plan import Plan
from experiments.search.space import Space
from experiments.statistics import SIGNIFICANCE, Interval, holm, mean_interval
from mdkf.tables import FloatArray

APART = 0.1
"""Of an axis' width: candidates differ by at least this along one axis."""

CONFIRMED = "confirmed"
NOISE = "not confirmed: noise"
REVERSED = "not confirmed: the reverse"
TOO_FEW = "not confirmed: most fresh seeds have no value"


@dataclass(frozen=True)
class Check:
    """A trial on fresh seeds. effect: of the pairs of each seed, filter against opponent, or
    candidate against control."""

    name: str
    trial: Trial
    values: Values
    effect: Interval
    p: float
    p_holm: float
    verdict: str


@dataclass(frozen=True)
class Checks:
    """The candidates, worst of the search first, and the control: the defaults on the same
    seeds."""

    candidates: tuple[Check, ...]
    control: Values

    @property
    def confirmed(self) -> tuple[Check, ...]:
        """Those that stood."""
        return tuple(one for one in self.candidates if one.verdict == CONFIRMED)


def candidates(trials: Sequence[Trial], space: Space, count: int) -> list[Trial]:
    """The worst trials for the filter, each `APART` from those before; none in which it is not
    the worse at all."""
    chosen: list[Trial] = []
    worst_first = sorted(
        (one for one in trials if one.value > 0), key=lambda one: (-one.value, one.number)
    )
    for one in worst_first:
        apart = (space.distance(one.point, other.point) >= APART for other in chosen)
        if len(chosen) < count and all(apart):
            chosen.append(one)
    return chosen


def check(plan: Plan, chosen: Sequence[Trial], store: Store, do: Done) -> Checks:
    """Evaluate the chosen trials and the control on fresh seeds."""
    places = [plan.space.defaults, *(plan.space.at(one.point) for one in chosen)]
    worlds = [plan.worlds(place, plan.fresh_seeds) for place in places]
    do([world for own in worlds for world in own])
    control, *values = (values_of(plan, store, own) for own in worlds)
    # Without an opponent a filter is never free of errors: worse than at the defaults is the claim.
    reference = 0.0 if plan.goal.against else control.goal
    pairs = [one.goal - reference for one in values]
    p = [p_value(own) for own in pairs]
    corrected = holm(p)
    found = [
        Check(
            f"worst-{k + 1}",
            trial,
            values[k],
            mean_interval(pairs[k]),
            p[k],
            corrected[k],
            verdict(pairs[k], corrected[k]),
        )
        for k, trial in enumerate(chosen)
    ]
    return Checks(tuple(found), control)


def p_value(pairs: FloatArray) -> float:
    """Two-sided, that the mean of the pairs (n,) is 0; 1 where nothing can be told.

    At least 2^(1-n), what the signs of n pairs can tell at most: counts may all be the same, and
    have no variance, however few they are.
    """
    kept = pairs[np.isfinite(pairs)]
    if len(kept) < 2 or not np.any(kept):
        return 1.0
    p = 0.0 if np.ptp(kept) == 0 else float(stats.ttest_1samp(kept, 0.0).pvalue)
    return max(p, math.pow(2.0, 1 - len(kept)))


def verdict(pairs: FloatArray, corrected: float) -> str:
    """By the corrected p-value of the pairs (n,)."""
    if 2 * np.isfinite(pairs).sum() < len(pairs):
        return TOO_FEW
    if corrected > SIGNIFICANCE:
        return NOISE
    return CONFIRMED if np.nanmean(pairs) > 0 else REVERSED
