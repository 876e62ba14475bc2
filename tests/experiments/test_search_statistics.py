"""Claim: what a search calls confirmed is worse on fresh seeds, and noise is called so."""

import math

import numpy as np
import pytest
from scipy import stats

from experiments.search.check import CONFIRMED, NOISE, REVERSED, TOO_FEW, p_value, verdict
from experiments.search.goal import Goal
from experiments.statistics import holm


@pytest.mark.parametrize(
    ("goal", "measured", "value"),
    [
        (Goal("drift", "a", "b"), {"a": 3.0, "b": 1.0}, 2.0),
        (Goal("hota", "a", "b"), {"a": 60.0, "b": 75.0}, 15.0),
        (Goal("nees", "a"), {"a": 4.0}, math.log(2)),
        (Goal("nees", "a"), {"a": 1.0}, math.log(2)),
        (Goal("nees", "a", "b"), {"a": 2.0, "b": 1.0}, -math.log(2)),
        (Goal("lost", "a"), {"a": 25.0}, 25.0),
        (Goal("drift", "a", "b"), {"a": math.nan, "b": 1.0}, math.nan),
        (Goal("drift", "a", "b"), {"a": 1.0}, math.nan),
    ],
)
def test_more_is_worse_for_the_filter(goal: Goal, measured: dict[str, float], value: float) -> None:
    """Errors by how much they are larger, scores by how much they are smaller, consistency by how
    far it is off, above as below; of what has no value there is none."""
    assert goal.value(measured) == pytest.approx(value, nan_ok=True)


def test_p_values_are_students_and_never_surer_than_the_signs_allow() -> None:
    """By scipy's paired test; equal pairs, which have no variance, by the sign test."""
    rng = np.random.default_rng(5)
    a, b = rng.normal(0.2, 1, 12), rng.normal(0, 1, 12)
    assert p_value(a - b) == pytest.approx(stats.ttest_rel(a, b).pvalue, rel=1e-12)
    assert p_value(np.full(5, 100.0)) == stats.binomtest(5, 5).pvalue
    assert p_value(np.zeros(9)) == 1.0
    assert p_value(np.array([1.0, np.nan])) == 1.0


def test_fresh_seeds_that_are_noise_are_confirmed_as_rarely_as_they_should() -> None:
    """Three candidates of 20 seeds without any effect: at least one is called worse in 2.5 % of
    searches, and the other way round in as many (one standard deviation: 0.6 %)."""
    rng = np.random.default_rng(1)
    worse = better = 0
    for _ in range(600):
        pairs = rng.normal(0, 1, (3, 20))
        corrected = holm([p_value(own) for own in pairs])
        verdicts = [verdict(own, p) for own, p in zip(pairs, corrected, strict=True)]
        worse += CONFIRMED in verdicts
        better += REVERSED in verdicts
    assert 600 * 0.005 < worse < 600 * 0.05
    assert 600 * 0.005 < better < 600 * 0.05


def test_most_fresh_seeds_without_a_value_confirm_nothing() -> None:
    """However sure the rest is."""
    sure = np.linspace(5.0, 5.1, 8)
    few = np.append(sure, [np.nan] * 9)
    assert p_value(few) < 0.01
    assert verdict(few, p_value(few)) == TOO_FEW
    assert verdict(few[:16], p_value(few)) == CONFIRMED
    assert verdict(sure[:3], p_value(sure[:3])) == NOISE
