"""Samples into a value, its count, and the interval in which a consistent filter's would be.

The average of n normalised squared errors of d numbers (NEES, NIS) is chi-squared with n d degrees
of freedom, divided by n, if the covariances are true and the samples independent (Bar-Shalom, Li
and Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 5.4).
Samples along one track are not: a filter's error lasts for several frames. The interval is then too
narrow, and a verdict close to its edge says nothing; it is a reading aid, not an exact test.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import stats

from mdkf.tables import FloatArray

CONFIDENCE = 0.95

Verdict = Literal["optimistic", "consistent", "pessimistic"]


@dataclass(frozen=True)
class Value:
    """A score of n samples, NaN if there are none.

    low, high: where 95 % of the values of a consistent filter would be, had it n independent
    samples; NaN for scores that know no consistency.
    """

    value: float
    n: int
    low: float = float("nan")
    high: float = float("nan")

    @property
    def verdict(self) -> Verdict | None:
        """`optimistic` where errors are larger than the covariances tell, `pessimistic` where
        they are smaller; None without an interval."""
        if np.isnan(self.low):
            return None
        if self.value > self.high:
            return "optimistic"
        return "pessimistic" if self.value < self.low else "consistent"


NO_VALUE = Value(float("nan"), 0)


def mean(samples: FloatArray) -> Value:
    """Mean of the samples that have a value."""
    kept = samples[~np.isnan(samples)]
    return Value(float(kept.mean()), len(kept)) if len(kept) else NO_VALUE


def root_mean_square(samples: FloatArray) -> Value:
    """Root of the mean of the squares of the samples that have a value."""
    squares = mean(np.square(samples))
    return Value(float(np.sqrt(squares.value)), squares.n)


def consistency(samples: FloatArray, degrees: int) -> Value:
    """Average of normalised squares of errors of `degrees` numbers; expected: `degrees`."""
    average = mean(samples)
    if not average.n:
        return average
    low, high = (
        float(stats.chi2.ppf(0.5 + side * CONFIDENCE / 2, degrees * average.n)) / average.n
        for side in (-1, 1)
    )
    return Value(average.value, average.n, low, high)
