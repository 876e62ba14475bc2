"""Claim: p-values and intervals of effects over scenarios and seeds are what they say: they cover
the truth as often as they should, agree with Student's where theory says so, and find nothing where
there is nothing."""

import numpy as np
import polars as pl
import pytest
from scipy import stats

from experiments.claims.evidence import evidence, evidence_of_recordings
from experiments.estimates import by_scenario, cluster_bootstrap, drawn, mean_of
from mdkf.tables import FloatArray


def values_of(values: FloatArray) -> pl.DataFrame:
    """Values (scenarios, seeds) as rows; NaN ones are left out."""
    scenarios, seeds = values.shape
    rows = pl.DataFrame(
        {
            "scenario": np.repeat([f"scenario {k:02}" for k in range(scenarios)], seeds),
            "seed": np.tile(np.arange(seeds), scenarios),
            "value": values.ravel(),
        }
    )
    return rows.filter(pl.col("value").is_not_nan())


@pytest.mark.parametrize(("scenarios", "seeds"), [(18, 6), (18, 2), (1, 24)])
def test_intervals_cover_the_truth(scenarios: int, seeds: int) -> None:
    """Effects of scenarios drawn around a known one, seeds around theirs: about 95 of 100 of both
    bootstraps' intervals cover it, and a p-value below 0.05 comes about 5 times in 100."""
    random = np.random.default_rng(scenarios + seeds)
    worlds, truth = 200, 0.3
    studentised, percentile, refuted = 0, 0, 0
    for _ in range(worlds):
        own = truth + (random.normal(0, 1, (scenarios, 1)) if scenarios > 1 else 0)
        values = values_of(own + random.normal(0, 1, (scenarios, seeds)))
        found, other = evidence(values, truth, 999), cluster_bootstrap(values, 999)
        studentised += found.low <= truth <= found.high
        percentile += other.low <= truth <= other.high
        refuted += 2 * min(found.above, found.below) < 0.05
    assert 0.90 <= studentised / worlds <= 0.985
    assert 0.90 <= percentile / worlds <= 0.985
    assert 0.015 <= refuted / worlds <= 0.10


def test_few_scenarios_are_not_taken_for_many() -> None:
    """Of six without an effect: p-values below 1/100 come in about one world of a hundred, those
    of the percentiles in about six (Student's t of five degrees beyond 2.576 sqrt(5/6))."""
    random = np.random.default_rng(7)
    worlds, level, resamples = 400, 0.01, 1999
    studentised, percentile = 0, 0
    for _ in range(worlds):
        values = values_of(random.normal(0, 1, (6, 1)))
        found = evidence(values, 0.0, resamples)
        draws = drawn(by_scenario(values), mean_of, resamples).bootstrap_distribution
        sides = 1 + np.sum(draws <= 0), 1 + np.sum(draws >= 0)
        studentised += 2 * min(found.above, found.below) <= level
        percentile += 2 * min(sides) / (resamples + 1) <= level
    assert studentised <= 10  # of 4; eleven or more come in one of four hundred such tests
    assert percentile >= 13  # of 26


@pytest.mark.parametrize("kind", ["few differ", "heavy tails", "skewed"])
def test_effects_need_not_be_normal(kind: str) -> None:
    """Of 18 scenarios without an effect on average, of which a third differ at all, or with
    Student's t of two degrees, or exponential: p-values below 0.05 come in about five worlds of a
    hundred (a bootstrap alone has 16 and 9, Student's t alone 8 of the skewed ones), and those
    below 1/600 next to never."""
    random = np.random.default_rng(17)
    worlds, found, far = 300, 0, 0
    for _ in range(worlds):
        effects = {
            "few differ": random.normal(0, 1, (18, 1)) * (random.random((18, 1)) < 0.3),
            "heavy tails": random.standard_t(2, (18, 1)),
            "skewed": random.exponential(1, (18, 1)) - 1,
        }
        one = evidence(values_of(effects[kind]), 0.0, 1999)
        p = 2 * min(one.above, one.below)
        found, far = found + (p <= 0.05), far + (p <= 1 / 600)
    assert found <= 26  # of 15; twenty-seven or more come in one of three hundred such tests
    assert far <= 3  # of 0.5


def test_many_seeds_of_one_scenario_are_students() -> None:
    """Of normal values: the one-sided p-values and the interval of Student's t."""
    sample = np.random.default_rng(3).normal(0.12, 1.0, 400)
    found = evidence(values_of(sample[None]), 0.05)
    above = stats.ttest_1samp(sample, 0.05, alternative="greater").pvalue
    low, high = stats.t.interval(0.95, 399, loc=sample.mean(), scale=stats.sem(sample))
    assert (found.above, found.below) == pytest.approx((above, 1 - above), abs=0.01)
    assert (found.low, found.high) == pytest.approx((low, high), abs=0.01)
    assert (found.n, found.scenarios) == (400, 1)


def test_every_scenario_counts_alike_however_many_seeds_it_has() -> None:
    """By hand: means 2, 10 and 3 of three, one and two seeds; missing values are left out."""
    ragged = np.array([[1.0, 2.0, 3.0], [10.0, np.nan, np.nan], [np.nan, 2.0, 4.0]])
    found = evidence(values_of(ragged), 0.0, 999)
    assert found.effect == pytest.approx(5.0)
    assert (found.n, found.scenarios) == (6, 3)
    assert found.low < 5.0 < found.high


def test_nothing_is_no_evidence() -> None:
    """Differences that are all zero, or all the limit: p = 1 on both sides, an interval of a
    point."""
    for limit in (0.0, 0.07):
        found = evidence(values_of(np.full((18, 2), limit)), limit, 999)
        assert (found.above, found.below) == (1.0, 1.0)
        assert found.effect == found.low == found.high == limit


def test_values_that_are_all_alike_have_no_error() -> None:
    """An effect that never varies is as sure as draws can tell; draws of one seed alone, three
    times, bound nothing, rather than by what rounding leaves of them."""
    found = evidence(values_of(np.full((18, 2), 0.1)), 0.0, 999)
    assert (found.above, found.below) == (1 / 1000, 1.0)
    assert found.low == found.high == found.effect
    three = evidence(values_of(np.array([[0.1, 0.3, 0.7]])), 0.0, 999)
    assert (three.low, three.high) == (-np.inf, np.inf)


def test_one_scenario_that_differs_is_not_enough() -> None:
    """Seventeen that do not: many draws have none but those, and nothing bounds the effect."""
    values = np.zeros((18, 4))
    values[7] = 1.0
    found = evidence(values_of(values), 0.0, 1999)
    assert found.effect == pytest.approx(1 / 18)
    assert found.high == np.inf
    assert found.above > 0.025


def test_a_value_alone_is_no_evidence() -> None:
    """Nor is none."""
    for values in (np.array([[3.0]]), np.empty((1, 0))):
        found = evidence(values_of(values))
        assert np.isnan([found.low, found.high, found.above, found.below]).all()
        assert found.n == values.size


def test_the_same_values_give_the_same_p() -> None:
    """In any order of the rows."""
    values = values_of(np.random.default_rng(0).normal(0.2, 1.0, (6, 5)))
    assert evidence(values) == evidence(values.sample(fraction=1.0, shuffle=True, seed=1))


def test_recorded_values_have_the_jackknifes_t() -> None:
    """Of a mean, the jackknife is Student's t of the sequences' own values."""
    own = np.random.default_rng(5).normal(0.4, 1.0, 11)
    without = [np.delete(own, k).mean() for k in range(len(own))]
    rows = pl.DataFrame(
        {
            "scenario": ["val", *(f"val-{k:04}" for k in range(len(own)))],
            "seed": [None] * 12,
            "value": [own.mean(), *without],
        },
        schema_overrides={"seed": pl.Int64},
    )
    found = evidence_of_recordings(rows, 0.1)
    oracle = stats.ttest_1samp(own, 0.1, alternative="greater")
    low, high = stats.t.interval(0.95, 10, loc=own.mean(), scale=stats.sem(own))
    assert found.above == pytest.approx(oracle.pvalue, rel=1e-9)
    assert found.below == pytest.approx(1 - oracle.pvalue, rel=1e-9)
    assert (found.low, found.high) == pytest.approx((low, high), rel=1e-9)
    equal = rows.with_columns(value=pl.lit(0.1))
    assert evidence_of_recordings(equal, 0.1).above == 1.0
