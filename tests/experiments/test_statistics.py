"""Claim: a mean of seeds comes with Student's 95 % interval; missing values are left out."""

import math

import numpy as np
import pytest
from scipy import stats

from experiments.statistics import clustered_interval, holm, jackknife, mean_interval


@pytest.mark.parametrize("n", [2, 3, 6, 20, 200])
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_the_interval_is_scipys(n: int, scale: float) -> None:
    """`scipy.stats.t.interval` of the values' mean and standard error."""
    values = np.random.default_rng(n).normal(3.0, scale, n)
    interval = mean_interval(values)
    low, high = stats.t.interval(0.95, n - 1, loc=np.mean(values), scale=stats.sem(values))
    np.testing.assert_allclose((interval.low, interval.high), (low, high), rtol=1e-12)
    assert interval.mean == pytest.approx(np.mean(values), rel=1e-14)
    assert interval.n == n


def test_the_interval_by_hand() -> None:
    """Of 1, 2, 3: deviation 1, error 1/sqrt(3), t with two degrees of freedom 4.3027 (tables)."""
    interval = mean_interval([1.0, 2.0, 3.0])
    assert interval.mean == 2.0
    assert interval.high - 2.0 == pytest.approx(4.302653 / math.sqrt(3), abs=1e-6)
    assert 2.0 - interval.low == pytest.approx(4.302653 / math.sqrt(3), abs=1e-6)


def test_the_interval_covers_the_mean_in_95_percent_of_experiments() -> None:
    """4000 experiments of five normal values; three standard deviations of a count either way."""
    values = np.random.default_rng(0).normal(7.0, 2.0, (4000, 5))
    intervals = [mean_interval(row) for row in values]
    covered = np.mean([interval.low <= 7.0 <= interval.high for interval in intervals])
    assert abs(covered - 0.95) < 3 * math.sqrt(0.95 * 0.05 / 4000)


def test_missing_values_are_left_out() -> None:
    """NaN changes neither the mean nor the interval, and is not counted."""
    nan = float("nan")
    assert mean_interval([nan, 1.0, 2.0, nan, 4.0]) == mean_interval([1.0, 2.0, 4.0])
    assert mean_interval([nan, 1.0, 2.0, nan, 4.0]).n == 3


@pytest.mark.parametrize("values", [[], [float("nan")] * 3])
def test_no_values_give_no_mean(values: list[float]) -> None:
    """All three numbers are NaN, without a warning."""
    interval = mean_interval(values)
    assert interval.n == 0
    assert all(math.isnan(v) for v in (interval.mean, interval.low, interval.high))


@pytest.mark.parametrize("values", [[2.5], [float("nan"), 2.5]])
def test_one_value_gives_a_mean_without_an_interval(values: list[float]) -> None:
    """One seed says nothing of the spread."""
    interval = mean_interval(values)
    assert (interval.mean, interval.n) == (2.5, 1)
    assert math.isnan(interval.low)
    assert math.isnan(interval.high)


def test_equal_values_give_an_interval_of_no_width() -> None:
    """Deterministic scores are certain."""
    interval = mean_interval([3.0] * 4)
    assert (interval.low, interval.mean, interval.high) == (3.0, 3.0, 3.0)


def test_clusters_weigh_as_many_values_as_they_have() -> None:
    """The mean is that of all values; clusters without any are left out; one cluster or none has
    no interval."""
    interval = clustered_interval([2.0, 30.0, 0.0], [2, 10, 0])
    assert interval.mean == pytest.approx(32 / 12)
    assert interval.n == 2
    assert 1.0 <= interval.low <= interval.mean <= interval.high <= 3.0
    alone = clustered_interval([8.0], [4])
    assert (alone.mean, alone.n) == (2.0, 1)
    assert np.isnan([alone.low, alone.high, clustered_interval([], []).mean]).all()


def test_the_bootstrap_covers_the_mean_of_unequal_clusters() -> None:
    """Of 300 samples of 40 clusters whose values depend on each other, about 95 % of the intervals
    hold the true mean, which intervals over single values would not."""
    rng = np.random.default_rng(8)
    held = naive = 0
    for _ in range(300):
        sizes = rng.integers(1, 20, 40)
        values = [2.0 + rng.normal() + 0.1 * rng.normal(size=size) for size in sizes]
        interval = clustered_interval([v.sum() for v in values], sizes)
        held += interval.low <= 2.0 <= interval.high
        single = mean_interval(np.concatenate(values))
        naive += single.low <= 2.0 <= single.high
    assert 0.89 < held / 300 < 0.98
    assert naive / 300 < 0.6


def test_the_jackknife_of_a_mean_is_students_interval() -> None:
    """The interval of a mean of independent values, which has a closed form."""
    values = np.random.default_rng(4).normal(3.0, 2.0, 11)
    without = np.array([np.delete(values, k).mean() for k in range(11)])
    found = jackknife(values.mean(), without)
    wanted = stats.t.interval(0.95, 10, loc=values.mean(), scale=stats.sem(values))
    assert (found.low, found.high) == pytest.approx(wanted, rel=1e-12)
    assert (found.mean, found.n) == (pytest.approx(values.mean()), 11)
    assert np.isnan(jackknife(1.0, np.array([1.0])).low)


def test_p_values_are_corrected_for_their_number_by_holm() -> None:
    """The worked example of R's `p.adjust`."""
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.6, 0.7]) == [1.0, 1.0]
    assert holm([]) == []
