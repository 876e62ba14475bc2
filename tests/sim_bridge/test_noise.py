"""Claim: noise hangs together in time by its shares, each object's own, with the tails asked for.

Expected values are closed forms and scipy.stats.
"""

from functools import cache

import numpy as np
import pytest
from scipy import stats

from mdkf.tables import FloatArray
from sim_bridge.noise import correlated, drifting, heavy_tailed
from sim_bridge.profile import Correlation

DT = 0.1  # s
N_OBJECTS, N_ROWS = 4000, 60
SHARES = ((0.0, 0.0), (0.5, 0.3), (1.0, 0.0), (0.0, 1.0), (0.25, 0.75))  # drift, fixed
LAWS = tuple(
    Correlation(drift_share=drift, drift_time=0.4 + 0.3 * k, fixed_share=fixed)
    for k, (drift, fixed) in enumerate(SHARES)
)
every_law = pytest.mark.parametrize("k", range(len(LAWS)), ids=[str(s) for s in SHARES])


def streams(*seeds: int) -> list[np.random.Generator]:
    return [np.random.default_rng([20, seed]) for seed in seeds]


@cache
def noise() -> FloatArray:
    """(laws, objects, rows)"""
    drawn = correlated(streams(*range(N_OBJECTS)), np.full(N_OBJECTS, N_ROWS), LAWS, DT)
    return drawn.reshape(len(LAWS), N_OBJECTS, N_ROWS)


# --- correlated -----------------------------------------------------------------------------


@every_law
@pytest.mark.parametrize("row", [0, 1, N_ROWS - 1])
def test_every_row_is_standard_normal(k: int, row: int) -> None:
    """Also an object's first: the process is stationary from there on."""
    assert stats.kstest(noise()[k, :, row], stats.norm.cdf).pvalue > 1e-3


@every_law
@pytest.mark.parametrize("lag", [1, 2, 5, 20])
@pytest.mark.parametrize("row", [0, N_ROWS // 2])
def test_autocorrelation_is_the_laws(k: int, lag: int, row: int) -> None:
    """drift_share exp(-t / drift_time) + fixed_share after a time t, from the first row on; the
    mean product of 4000 independent pairs is within 4 of its standard deviations of it."""
    (drift, fixed), time = SHARES[k], 0.4 + 0.3 * k
    expected = drift * np.exp(-lag * DT / time) + fixed
    products = noise()[k, :, row] * noise()[k, :, row + lag]
    # Normal numbers: var(a b) = 1 + rho^2.
    bound = 4.0 * np.sqrt((1.0 + expected**2) / N_OBJECTS)
    assert products.mean() == pytest.approx(expected, abs=bound)


def test_the_time_between_rows_counts() -> None:
    """At dt and after one row as at dt / 2 after two."""
    law = [Correlation(drift_share=1.0, drift_time=0.5, fixed_share=0.0)]
    for dt, lag in ((0.3, 1), (0.15, 2), (0.03, 10)):
        rows = correlated(streams(*range(N_OBJECTS)), np.full(N_OBJECTS, lag + 1), law, dt)
        first, last = rows.reshape(N_OBJECTS, lag + 1)[:, [0, lag]].T
        bound = 4.0 * np.sqrt((1.0 + np.exp(-1.2)) / N_OBJECTS)
        assert (first * last).mean() == pytest.approx(np.exp(-0.6), abs=bound)


def test_laws_and_objects_are_independent() -> None:
    """No correlation of one law's noise with another's, nor of an object's with its neighbour's,
    in a row or in the mean over rows."""
    for numbers in (noise()[:, :, 0], noise()[:, :, -1], noise().mean(axis=2)):
        np.testing.assert_allclose(
            np.corrcoef(numbers), np.eye(len(LAWS)), atol=4.5 / np.sqrt(N_OBJECTS)
        )
        for law in numbers:
            neighbours = np.corrcoef(law[1:], law[:-1])[0, 1]
            assert abs(neighbours) < 4.5 / np.sqrt(N_OBJECTS)


def test_a_fixed_part_is_the_same_in_all_rows() -> None:
    """With all of the variance fixed, an object's rows are one number, another's another."""
    rows = noise()[SHARES.index((0.0, 1.0))]
    np.testing.assert_array_equal(rows, np.broadcast_to(rows[:, :1], rows.shape))
    assert len(np.unique(rows[:, 0])) == N_OBJECTS


def test_an_objects_rows_depend_on_no_other_object() -> None:
    """Alone, in another place and among others with other numbers of rows: the same bytes."""
    counts = np.array([7, 1, 0, 30, 2, 12])
    together = correlated(streams(0, 1, 2, 3, 4, 5), counts, LAWS, DT)
    assert together.shape == (len(LAWS), counts.sum())
    parts = np.split(together, np.cumsum(counts)[:-1], axis=1)
    for k, n in enumerate(counts):
        (own,) = streams(k)
        np.testing.assert_array_equal(parts[k], correlated([own], counts[k : k + 1], LAWS, DT))
        assert parts[k].shape == (len(LAWS), n)
    backwards = correlated(streams(5, 4, 3, 2, 1, 0), counts[::-1], LAWS, DT)
    np.testing.assert_array_equal(np.hstack(parts[::-1]), backwards)


def test_no_objects_and_no_rows_give_no_noise() -> None:
    """Empty tables of the right shape."""
    none = np.array([], dtype=np.int64)
    assert correlated([], none, LAWS, DT).shape == (len(LAWS), 0)
    assert correlated(streams(1, 2), np.array([0, 0]), LAWS, DT).shape == (len(LAWS), 0)


# --- heavy_tailed ---------------------------------------------------------------------------

every_tail = pytest.mark.parametrize("tail", [2.001, 2.5, 4.0, 30.0, 1000.0])


@every_tail
def test_normal_numbers_become_student_numbers(tail: float) -> None:
    """Quantile by quantile, to 1e-5 of the number itself within 6 standard deviations."""
    # Lower quantiles only: the upper ones lose their digits in 1 - p. The upper half mirrors them.
    normal = -np.random.default_rng(21).uniform(0.0, 6.0, 20_000)
    expected = stats.t.ppf(stats.norm.cdf(normal), tail)
    np.testing.assert_allclose(heavy_tailed(normal, tail), expected, rtol=1e-5)


@every_tail
def test_tails_are_as_heavy_as_asked(tail: float) -> None:
    """The other way round: Student's probability of the result is the normal one of the input."""
    normal = np.linspace(-6.0, -0.01, 5000)
    probability = stats.t.cdf(heavy_tailed(normal, tail), tail)
    np.testing.assert_allclose(probability, stats.norm.cdf(normal), rtol=1e-4)


@every_tail
def test_positive_and_negative_numbers_mirror_each_other(tail: float) -> None:
    """Odd, up to rounding, and zero stays zero."""
    normal = np.random.default_rng(22).uniform(0.0, 10.0, 5000)
    mirrored = -heavy_tailed(-normal, tail)
    np.testing.assert_allclose(mirrored, heavy_tailed(normal, tail), rtol=1e-12, atol=1e-15)
    assert heavy_tailed(np.zeros(1), tail)[0] == 0.0


@every_tail
def test_larger_numbers_stay_larger(tail: float) -> None:
    """Strictly within 8 standard deviations, finite beyond."""
    numbers = heavy_tailed(np.linspace(-8.0, 8.0, 300_001), tail)
    assert (np.diff(numbers) > 0.0).all()
    farthest = heavy_tailed(np.array([8.0, 9.0, 40.0]), tail)
    assert np.isfinite(farthest).all()
    assert (np.diff(farthest) >= 0.0).all()


# --- drifting -------------------------------------------------------------------------------


def test_drifting_noise_forgets_with_its_time_constant() -> None:
    """Standard normal from the first row on, autocorrelation exp(-t / time), no fixed part."""
    time = 0.7
    drawn = np.array([drifting(rng, N_ROWS, DT, time) for rng in streams(*range(N_OBJECTS))])
    for row in (0, N_ROWS - 1):
        assert stats.kstest(drawn[:, row], stats.norm.cdf).pvalue > 1e-3
    for lag in (1, 7, 50):
        expected = np.exp(-lag * DT / time)
        bound = 4.0 * np.sqrt((1.0 + expected**2) / N_OBJECTS)
        assert (drawn[:, 0] * drawn[:, lag]).mean() == pytest.approx(expected, abs=bound)
    assert drifting(np.random.default_rng(0), 0, DT, time).shape == (0,)
