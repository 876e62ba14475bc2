"""Claim: an estimate is the mean over scenarios of their seeds' means, its interval a bootstrap
over scenarios and seeds; differences are paired; recorded values have the jackknife's interval."""

import numpy as np
import polars as pl
import pytest
from scipy import stats

from experiments.estimates import (
    RECORDED,
    by_scenario,
    cluster_bootstrap,
    drawn,
    estimate,
    mean_of,
)
from experiments.jobs import as_rows
from mdkf.tables import FloatArray


def values(table: FloatArray) -> pl.DataFrame:
    """Values of scenarios (rows) and seeds (columns), NaN where there is none."""
    scenario, seed = np.nonzero(np.isfinite(table))
    columns = {"scenario": [f"s{k:02d}" for k in scenario], "seed": seed}
    return pl.DataFrame({**columns, "value": table[scenario, seed]})


def test_every_scenario_counts_alike() -> None:
    """However many of its seeds have a value."""
    table = np.array([[1.0, 2.0, 3.0], [10.0, np.nan, np.nan]])
    found = cluster_bootstrap(values(table))
    assert found.value == pytest.approx((2.0 + 10.0) / 2)
    assert (found.n, found.scenarios) == (4, 2)


def test_the_interval_of_two_stages_is_that_of_drawing_scenarios_then_seeds() -> None:
    """Against the same bootstrap, written as a loop."""
    rng = np.random.default_rng(5)
    table = rng.normal(size=(6, 1)) + rng.normal(size=(6, 9))
    table[2, 5:] = np.nan
    draws = []
    for _ in range(4000):
        means = []
        for s in rng.integers(0, 6, 6):
            own = table[s][np.isfinite(table[s])]
            means.append(own[rng.integers(0, len(own), len(own))].mean())
        draws.append(np.mean(means))
    found = cluster_bootstrap(values(table), 4000)
    wanted = np.quantile(draws, [0.025, 0.975])
    spread = np.std(draws)
    np.testing.assert_allclose([found.low, found.high], wanted, atol=0.12 * spread)
    means = drawn(by_scenario(values(table)), mean_of, 4000).bootstrap_distribution
    assert np.std(means) == pytest.approx(spread, rel=0.06)


def test_a_single_scenario_is_scipys_bootstrap_over_its_seeds() -> None:
    """Without a first stage."""
    own = np.random.default_rng(1).exponential(size=40)
    found = cluster_bootstrap(values(own[None]), 4000)
    wanted = stats.bootstrap((own,), np.mean, n_resamples=4000, method="percentile", rng=3)
    low, high = wanted.confidence_interval
    np.testing.assert_allclose([found.low, found.high], [low, high], atol=0.02)
    assert (found.n, found.scenarios) == (40, 1)


def test_scenarios_that_differ_widen_the_interval() -> None:
    """It speaks of other scenarios too: many seeds of few scenarios leave it wide."""
    noise = np.random.default_rng(2).normal(size=(8, 30))
    alike = cluster_bootstrap(values(noise))
    apart = cluster_bootstrap(values(noise + np.linspace(-3, 3, 8)[:, None]))
    assert apart.high - apart.low > 4 * (alike.high - alike.low)


@pytest.mark.parametrize(("table", "n"), [(np.full((1, 1), np.nan), 0), (np.array([[3.0]]), 1)])
def test_too_few_values_have_no_interval(table: FloatArray, n: int) -> None:
    """None has no mean either."""
    found = cluster_bootstrap(values(table))
    assert (found.n, np.isnan(found.value)) == (n, n == 0)
    assert np.isnan([found.low, found.high]).all()


def test_the_same_values_in_any_order_give_the_same_bits() -> None:
    """Twice, and shuffled."""
    table = values(np.random.default_rng(3).normal(size=(4, 5)))
    one, other = cluster_bootstrap(table), cluster_bootstrap(table.sample(fraction=1, shuffle=True))
    assert (one.value, one.low, one.high) == (other.value, other.low, other.high)


def rows_of(name: str, table: FloatArray) -> pl.DataFrame:
    """Rows of a filter's values by scenario and seed."""
    measured = values(table).with_columns(metric=pl.lit("error"), filter=pl.lit(name))
    return as_rows(measured.to_dicts(), study="worlds")


def test_differences_are_paired_by_scenario_and_seed() -> None:
    """What both filters suffer drops out; seeds that one of them has no value for do too."""
    rng = np.random.default_rng(4)
    hard = 100 * rng.normal(size=(5, 8))
    gain = rng.normal(0.5, 0.01, size=(5, 8))
    gone = hard.copy()
    gone[0, 0] = np.nan
    rows = pl.concat([rows_of("a", gone + gain), rows_of("b", hard)]).sample(
        fraction=1, shuffle=True, seed=1
    )
    where = {"study": "worlds", "metric": "error", "filter": "a"}
    found = estimate(rows, where, {"filter": "b"})
    assert found.n == 39
    assert found.value == pytest.approx(0.5, abs=0.01)
    assert found.high - found.low < 0.05
    same = estimate(rows, where, {"filter": "a"})
    assert (same.value, same.low, same.high) == (0, 0, 0)


def test_recorded_values_are_of_all_sequences_with_the_jackknifes_interval() -> None:
    """Of a mean, whose jackknife is Student's interval; differences are paired by what is left
    out."""
    rng = np.random.default_rng(6)
    first, second = rng.normal(size=(2, 11))

    def rows(name: str, own: FloatArray) -> pl.DataFrame:
        whole = [{"scenario": "val", "value": own.mean()}]
        without = [
            {"scenario": f"val-{k:04d}", "value": np.delete(own, k).mean()} for k in range(11)
        ]
        return as_rows(whole + without, study=RECORDED, metric="hota", filter=name)

    both = pl.concat([rows("a", first), rows("b", second)])
    where = {"study": RECORDED, "metric": "hota", "filter": "a"}
    for found, own in (
        (estimate(both, where), first),
        (estimate(both, where, {"filter": "b"}), first - second),
    ):
        wanted = stats.t.interval(0.95, 10, loc=own.mean(), scale=stats.sem(own))
        assert (found.low, found.high) == pytest.approx(wanted, rel=1e-9)
        assert found.n == 11
