"""Claim: filters are said to differ alike only where both differences are beyond chance."""

import numpy as np
import polars as pl
import pytest
from scipy import stats

from experiments.kitti.compare import SCORES
from experiments.kitti.ranks import (
    AGREE,
    CONTRADICT,
    OPEN,
    against_first,
    most_influential,
)
from experiments.kitti.run import Results, Row

RULES = "robmot"


def results(**by_filter: list[float]) -> Results:
    """Every score of a filter is the mean of its values of the sequences."""

    def row(name: str, values: list[float]) -> Row:
        scores = dict.fromkeys(SCORES, float(np.mean(values)) if values else None)
        return {"rules": RULES, "filter": name, **scores}

    rows = [row(name, values) for name, values in by_filter.items()]
    left_out = {
        (RULES, name): {
            f"{k:04}": row(name, values[:k] + values[k + 1 :]) for k in range(len(values))
        }
        for name, values in by_filter.items()
    }
    return Results(rows, left_out, pl.DataFrame())


@pytest.mark.parametrize(
    ("recorded", "simulated", "verdict"),
    [
        ([1.0, 1.1, 0.9, 1.0], [2.0, 2.1, 1.9, 2.0], AGREE),
        ([-1.0, -1.1, -0.9, -1.0], [-2.0, -2.1, -1.9, -2.0], AGREE),
        ([1.0, 1.1, 0.9, 1.0], [-2.0, -2.1, -1.9, -2.0], CONTRADICT),
        ([1.0, 1.1, 0.9, 1.0], [2.0, -2.1, 1.9, -2.0], OPEN),
        ([1.0, -1.1, 0.9, -0.7], [2.0, 2.1, 1.9, 2.0], OPEN),
        ([0.0, 0.0, 0.0, 0.0], [2.0, 2.1, 1.9, 2.0], OPEN),
        ([1.0], [2.0], OPEN),
    ],
)
def test_a_verdict_needs_both_differences(
    recorded: list[float], simulated: list[float], verdict: str
) -> None:
    """Differences to the first filter, by sequence; what all filters have in common is nothing."""
    base = [70.0, 90.0, 40.0, 60.0][: len(recorded)]
    real = results(ca=base, md=[b + d for b, d in zip(base, recorded, strict=True)])
    made = [
        results(
            ca=[b + seed for b in base],
            md=[b + seed + d for b, d in zip(base, simulated, strict=True)],
        )
        for seed in (0, 5)
    ]
    first, other = against_first(real, made, RULES)
    assert {first[f"{name}_verdict"] for name in SCORES} == {None}
    for name in SCORES:
        assert other[f"{name}_recorded_against"] == pytest.approx(np.mean(recorded))
        assert other[f"{name}_simulated_against"] == pytest.approx(np.mean(simulated))
        assert other[f"{name}_verdict"] == verdict


def test_seeds_scatter_widens_the_interval() -> None:
    """Of two seeds that differ in one sequence the mean's difference is half as large there."""
    real = results(ca=[0.0] * 4, md=[1.0] * 4)
    made = [results(ca=[0.0] * 4, md=[1.0, 1.0, 1.0, last]) for last in (1.0, 9.0)]
    _, row = against_first(real, made, RULES)
    wanted = stats.t.interval(0.95, 3, loc=2.0, scale=stats.sem([1.0, 1.0, 1.0, 5.0]))
    got = row["hota_simulated_against_low"], row["hota_simulated_against_high"]
    assert got == pytest.approx(wanted, rel=1e-9, abs=1e-9)


def test_no_value_is_none() -> None:
    """Of a filter without a score there is no difference, and nothing is separable."""
    real = results(ca=[], md=[])
    _, row = against_first(real, [real], RULES)
    assert row["hota_recorded_against"] is None
    assert row["hota_verdict"] == OPEN


def test_the_sequence_that_changes_most_is_named() -> None:
    """Three of four sequences score alike recorded and simulated, one 8 points less: 2 in the mean,
    none without it. Of one sequence alone nothing is told."""
    real, made = results(ca=[70.0, 70.0, 62.0, 70.0]), results(ca=[70.0] * 4)
    (row,) = most_influential(real, [made, made], RULES)
    assert row["mota_influential"] == "0002"
    assert row["mota_difference_without"] == pytest.approx(0.0)
    alone = results(ca=[70.0])
    (row,) = most_influential(alone, [alone], RULES)
    assert row["mota_influential"] is row["mota_difference_without"] is None
