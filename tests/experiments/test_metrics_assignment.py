"""Assignments and sums are scipy's and numpy's to the choice between equals and the last bit.

TrackEval takes both from there; where objects or tracks are interchangeable, scores depend on them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.optimize import linear_sum_assignment

from experiments.metrics import sequence_from_matrices
from experiments.metrics.assignment import assign
from experiments.metrics.hota import similarity_sums


def as_assigned(cost: Any) -> Any:
    """`assign` of a dense matrix: the column of each row, -1 for a cost of 0 or none."""
    row, column = np.nonzero(cost)
    start = np.searchsorted(row, np.arange(len(cost) + 1))
    entry = assign(*cost.shape, start, column, cost[row, column])
    return np.where(entry >= 0, column[entry], -1) if len(column) else entry


def as_scipy(cost: Any) -> Any:
    row, column = linear_sum_assignment(cost)
    result = np.full(len(cost), -1)
    rewarded = cost[row, column] < 0.0
    result[row[rewarded]] = column[rewarded]
    return result


def integers(rng: np.random.Generator, shape: Any) -> Any:
    return rng.integers(0, rng.choice([2, 4, 10]), shape).astype(float)


KINDS = {
    "all different": lambda rng, shape: rng.random(shape),
    "integers": integers,
    "tenths": lambda rng, shape: integers(rng, shape) / 10,
    "equal but for rounding": lambda rng, shape: integers(rng, shape) / 7
    * (1.0 + rng.integers(-1, 2, shape) * np.finfo(float).eps),
    "some continued": lambda rng, shape: integers(rng, shape) / 10
    + 1000.0 * (rng.random(shape) < 0.1),
    "tiny": lambda rng, shape: rng.random(shape) * 10.0 ** rng.integers(-18, 1, shape),
    "row plus column": lambda rng, shape: rng.random((shape[0], 1)) + rng.random(shape[1]),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("share", [0.1, 0.4, 1.0])
def test_the_assignment_is_scipys(kind: str, share: float) -> None:
    """600 matrices of each kind, wide and tall, of which a share of the entries is not 0."""
    rng = np.random.default_rng([len(kind), int(10 * share)])
    for _ in range(600):
        shape = tuple(rng.integers(1, rng.choice([4, 10, 30]), 2))
        cost = -(KINDS[kind](rng, shape) * (rng.random(shape) < share))
        assert_array_equal(as_assigned(cost), as_scipy(cost), err_msg=repr(cost))


@pytest.mark.parametrize("shape", [(200, 180), (180, 200), (200, 200)])
@pytest.mark.parametrize("kind", KINDS)
def test_a_crowd_is_assigned_as_by_scipy(kind: str, shape: tuple[int, int]) -> None:
    """200 objects, each near a few of 180 or 200 tracks."""
    rng = np.random.default_rng(len(kind))
    near = rng.random(shape) < 0.015
    np.fill_diagonal(near, True)
    cost = -(KINDS[kind](rng, shape) * near)
    assert_array_equal(as_assigned(cost), as_scipy(cost))


@pytest.mark.parametrize("share", [0.02, 0.3, 1.0])
def test_sums_are_rounded_as_numpys(share: float) -> None:
    """Rows and columns of frames of many shapes, one row or one column among them."""
    rng = np.random.default_rng(int(100 * share))
    some = (0, 1, 2, 3, 7, 8, 9, 16, 31, 127, 128, 129, 137, 256, 300)
    shapes = [(n, m) for n in some for m in some]
    matrices = [rng.random(shape) * (rng.random(shape) < share) for shape in shapes]
    truth, track = ([np.arange(shape[axis]) for shape in shapes] for axis in (0, 1))
    sequence = sequence_from_matrices(truth, track, matrices)
    sums = similarity_sums(sequence.truth_start, sequence.track_start, sequence.pairs)
    for axis, ours in zip((1, 0), sums, strict=True):
        assert_array_equal(ours, np.concatenate([matrix.sum(axis) for matrix in matrices]))
