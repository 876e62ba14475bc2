"""How noise hangs together in time: correlations by lag, and the profile's law that fits them.

The law is that of `sim_bridge.profile.Correlation`: at a time t apart two values of an object have
correlation drift_share exp(-t / drift_time) + fixed_share.
"""

from collections.abc import Callable

import numpy as np
import polars as pl
from scipy.optimize import minimize_scalar, nnls
from scipy.special import ndtr, ndtri

from mdkf.tables import FloatArray, IntArray

LAGS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48)
"""In frames."""
FEWEST = 200
"""Pairs that a lag needs to count."""
TIMES = np.geomspace(0.1, 4.0, 60)
"""Drift times tried [s]: what drifts more slowly cannot be told from what is fixed."""


def pairs(cars: pl.DataFrame, lag: int) -> tuple[IntArray, IntArray]:
    """Rows (before, after) of the same object `lag` frames apart."""
    key = ["sequence", "object_id", "frame"]
    rows = cars.select(key).with_row_index("row")
    later = rows.with_columns(pl.col("frame") - lag).rename({"row": "later"})
    both = rows.join(later, on=key, how="inner").sort("row")
    return both["row"].to_numpy().astype(np.int64), both["later"].to_numpy().astype(np.int64)


def of_noise(cars: pl.DataFrame, noise: FloatArray, dt: float) -> dict[str, float]:
    """The law of standard normal noise (rows,), NaN where there is none."""
    noise = (noise - np.nanmean(noise)) / np.nanstd(noise)

    def correlation(before: IntArray, after: IntArray) -> float:
        return float(np.mean(noise[before] * noise[after]))

    return _law(cars, ~np.isnan(noise), correlation, dt)


def of_events(
    cars: pl.DataFrame, happened: FloatArray, probability: FloatArray, dt: float
) -> dict[str, float]:
    """The law of the noise z behind events that happen where Phi(z) < probability, both (rows,).

    happened is 1 or 0, NaN where nothing is known. The correlation at each lag has the greatest
    likelihood of the pairs' outcomes.
    """
    threshold = ndtri(np.clip(probability, 1e-9, 1.0 - 1e-9))

    def correlation(before: IntArray, after: IntArray) -> float:
        def loss(value: float) -> float:
            chance = _both(threshold[before], threshold[after], value)
            first, second = probability[before], probability[after]
            a, b = happened[before] == 1, happened[after] == 1
            outcome = np.select(
                [a & b, a & ~b, ~a & b],
                [chance, first - chance, second - chance],
                1.0 - first - second + chance,
            )
            return -float(np.mean(np.log(np.maximum(outcome, 1e-12))))

        return float(minimize_scalar(loss, bounds=(0.0, 0.995), method="bounded").x)

    return _law(cars, ~np.isnan(happened), correlation, dt)


def _both(a: FloatArray, b: FloatArray, correlation: float) -> FloatArray:
    """P(z1 < a and z2 < b) of standard normal z1, z2 with a correlation of at least 0: given the
    part that they share, they are independent."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(24)
    shared, own = np.sqrt(correlation), np.sqrt(1.0 - correlation)
    chance = np.zeros(len(a))
    for node, weight in zip(nodes, weights / weights.sum(), strict=True):
        chance += weight * ndtr((a - shared * node) / own) * ndtr((b - shared * node) / own)
    return chance


def _law(
    cars: pl.DataFrame,
    known: np.ndarray[tuple[int], np.dtype[np.bool_]],
    correlation: Callable[[IntArray, IntArray], float],
    dt: float,
) -> dict[str, float]:
    times, values, weights = [], [], []
    for lag in LAGS:
        before, after = pairs(cars, lag)
        both = known[before] & known[after]
        if both.sum() >= FEWEST:
            times.append(lag * dt)
            values.append(correlation(before[both], after[both]))
            weights.append(np.sqrt(both.sum()))
    return fit_law(np.array(times), np.array(values), np.array(weights))


def fit_law(time: FloatArray, correlation: FloatArray, weight: FloatArray) -> dict[str, float]:
    """drift_share, drift_time [s] and fixed_share of the closest law, by weighted least squares.

    Without data all noise is white.
    """
    best, law = float("inf"), {"drift_share": 0.0, "drift_time": 1.0, "fixed_share": 0.0}
    if not len(time):
        return law
    for drift_time in TIMES:
        parts = np.column_stack([np.exp(-time / drift_time), np.ones(len(time))])
        shares, _ = nnls(parts * weight[:, None], correlation * weight)
        shares = shares / max(1.0, shares.sum())
        left = weight * (parts @ shares - correlation)
        loss = float(left @ left)
        if loss < best:
            best = loss
            law = {
                "drift_share": float(shares[0]),
                "drift_time": float(drift_time),
                "fixed_share": float(shares[1]),
            }
    return law
