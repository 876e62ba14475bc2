"""Claim: tracks and detections are paired as the definitions say, however many there are."""

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist, mahalanobis

from mdkf.association import UNMATCHED, Measure, Room, find_pairs, greedy, optimal
from mdkf.ordering import sort_by
from tests.mdkf.scenes import Array, covariances

NOISE = (0.03, 0.01)
METHODS = ("greedy", "optimal")


def pairs(predicted: Array, measured: Array, measure: Measure) -> Room:
    """What may be paired of predicted (n, 2) or, with covariances, (n, 5), and measured (d, 2)."""
    n, d = len(predicted), len(measured)
    moments = np.zeros((n, 7))
    moments[:, :2] = predicted[:, :2]
    if predicted.shape[1] == 5:
        moments[:, 4:] = predicted[:, 2:]
    room = Room.of(n, d, n * d)
    find_pairs(moments, n, np.ascontiguousarray(measured), 0, d, measure, room)
    return room


def match(
    predicted: Array, measured: Array, gate: float, method: str = "greedy", by: str = "distance"
) -> list[int]:
    """The detection of each track, in the order of `measured`."""
    order = np.lexsort(measured.T[::-1])
    n, d = len(predicted), len(measured)
    room = pairs(predicted, measured[order], Measure(gate, by == "mahalanobis", NOISE))
    room.match[:], room.free[:] = UNMATCHED, True
    if method == "greedy":
        greedy(room)
    else:
        optimal(room, gate, n, d)
    taken = [UNMATCHED if j == UNMATCHED else int(order[j]) for j in room.match]
    free = np.ones(d, dtype=bool)
    free[order[room.match[room.match != UNMATCHED]]] = False
    np.testing.assert_array_equal(room.free, free[order])
    return taken


def test_the_nearest_pair_is_matched_first_and_the_gate_is_exclusive() -> None:
    """Greedy global minimum, not track by track; a distance equal to the gate does not match."""
    predicted = np.array([[0.0, 0.0], [1.0, 0.0]])
    assert match(predicted, np.array([[0.9, 0.0]]), 4.0) == [UNMATCHED, 0]
    assert match(predicted, np.array([[0.9, 0.0], [-2.0, 0.0]]), 4.0) == [1, 0]
    for method in METHODS:
        assert match(predicted[:1], np.array([[2.0, 0.0]]), 2.0, method) == [UNMATCHED]
        assert match(predicted[:1], np.array([[1.999, 0.0]]), 2.0, method) == [0]
        assert match(np.empty((0, 2)), predicted, 2.0, method) == []
        assert match(predicted, np.empty((0, 2)), 2.0, method) == [UNMATCHED, UNMATCHED]


def test_optimal_gives_up_the_nearest_pair_for_a_smaller_sum() -> None:
    """Tracks at 0 and 1, detections at 0.9 and 1.9: greedily 0.1 + 1.9, optimally 0.9 + 0.9. With
    the gate at 1.5 the greedy choice leaves a track without a detection."""
    predicted, measured = np.array([[0.0, 0], [1.0, 0]]), np.array([[0.9, 0], [1.9, 0]])
    assert match(predicted, measured, 4.0, "greedy") == [1, 0]
    assert match(predicted, measured, 4.0, "optimal") == [0, 1]
    assert match(predicted, measured, 1.5, "greedy") == [UNMATCHED, 0]


def scene(rng: np.random.Generator, n: int, shape: tuple[float, float]) -> tuple[Array, Array]:
    """Predictions and detections in a rectangle [m], some of either alone, some on a grid, where
    distances are equal."""
    predicted = rng.uniform(0, 1, (n, 2)) * shape
    measured = predicted + rng.normal(0, 1, (n, 2))
    both = predicted[rng.random(n) < 0.9], measured[rng.random(n) < 0.9]
    if rng.random() < 0.3:
        both = np.round(both[0]), np.round(both[1])
    return both


@pytest.mark.parametrize("shape", [(10.0, 10.0), (1.0, 300.0), (300.0, 1.0)])
@pytest.mark.parametrize("n", [8, 60])
def test_greedy_association_equals_its_definition(n: int, shape: tuple[float, float]) -> None:
    """Take the smallest entry of the whole matrix, strike its row and column; of equal entries the
    first track's, then the first detection's (by x, then y)."""
    rng = np.random.default_rng(0)
    for _ in range(100):
        predicted, measured = scene(rng, n, shape)
        measured = measured[np.lexsort(measured.T[::-1])]
        dx, dy = (predicted[:, None] - measured[None]).transpose(2, 0, 1)
        cost = np.sqrt(dx * dx + dy * dy)
        expected = np.full(len(predicted), UNMATCHED)
        while cost.size and cost.min() < 3.0:
            t, d = np.unravel_index(cost.argmin(), cost.shape)
            expected[t] = d
            cost[t], cost[:, d] = np.inf, np.inf
        np.testing.assert_array_equal(match(predicted, measured, 3.0), expected)


@pytest.mark.parametrize("shape", [(10.0, 10.0), (1.0, 300.0), (300.0, 1.0)])
@pytest.mark.parametrize("n", [8, 60])
def test_optimal_association_has_the_least_sum_of_all(n: int, shape: tuple[float, float]) -> None:
    """scipy's assignment on the whole matrix with no entry above the gate finds no smaller sum."""
    rng = np.random.default_rng(1)
    for _ in range(100):
        predicted, measured = scene(rng, n, shape)
        cost = cdist(predicted, measured)
        chosen = np.array(match(predicted, measured, 3.0, "optimal"))
        found = np.flatnonzero(chosen != UNMATCHED)
        assert (cost[found, chosen[found]] < 3.0).all()
        assert len(set(chosen[found])) == len(found)
        rows, columns = linear_sum_assignment(np.minimum(cost, 3.0))
        least = np.minimum(cost, 3.0)[rows, columns].sum() + 3.0 * (len(predicted) - len(rows))
        total = cost[found, chosen[found]].sum() + 3.0 * (len(predicted) - len(found))
        np.testing.assert_allclose(total, least, rtol=1e-12)


def test_mahalanobis_cost_is_scipys() -> None:
    """sqrt(y' S^-1 y) with S = P + R of every pair below the gate, and no pair too few."""
    rng = np.random.default_rng(2)
    for n, shape in ((10, (10.0, 10.0)), (70, (3.0, 200.0)), (70, (200.0, 3.0))):
        predicted, measured = scene(rng, n, shape)
        measured = measured[np.lexsort(measured.T[::-1])]
        P = covariances(rng, (len(predicted),), 0.05, 3.0)
        moments = np.column_stack([predicted, P[:, 0, 0], P[:, 0, 1], P[:, 1, 1]])
        room = pairs(moments, measured, Measure(2.5, True, NOISE))
        expected = {}
        for t, (position, covariance) in enumerate(zip(predicted, P, strict=True)):
            inverse = np.linalg.inv(covariance + np.diag(NOISE))
            for d, z in enumerate(measured):
                distance = mahalanobis(position, z, inverse)
                if distance < 2.5:
                    expected[t, d] = distance
        found = int(room.found[0])
        keys = list(zip(room.track[:found].tolist(), room.detection[:found].tolist(), strict=True))
        assert sorted(keys) == sorted(expected)
        np.testing.assert_allclose(room.cost[:found], [expected[key] for key in keys], rtol=1e-9)


def test_too_many_pairs_are_counted_all_the_same() -> None:
    """With room for one pair, the number of all of them, and the first."""
    predicted = np.zeros((3, 7))
    room = Room.of(3, 2, 1)
    find_pairs(predicted, 3, np.zeros((2, 2)), 0, 2, Measure(1.0, False, NOISE), room)
    assert room.found[0] == 6
    assert (room.track[0], room.detection[0]) == (0, 0)


@pytest.mark.parametrize("n", [0, 1, 2, 15, 16, 17, 33, 100, 1000])
def test_sorting_is_numpys_stable_sort(n: int) -> None:
    """Of keys with many repetitions, from a given order."""
    rng = np.random.default_rng(n)
    for values in (3, 10 * n + 1):
        key = rng.integers(0, values, n).astype(float)
        order = rng.permutation(n)
        expected = order[np.argsort(key[order], kind="stable")]
        sort_by(key, order, n, np.empty(n, dtype=np.int64))
        np.testing.assert_array_equal(order, expected)
