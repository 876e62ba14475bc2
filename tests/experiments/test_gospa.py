"""Claim: GOSPA is the metric of Rahmathullah et al. with alpha = 2, by the best of all assignments,
and its parts say what it is made of."""

from itertools import permutations
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from experiments.pairing import UNASSIGNED, assigned
from experiments.states import gospa

Places = NDArray[np.float64]

COORDINATE = st.floats(-3.0, 3.0).map(lambda value: round(value, 3))
"""Around the cutoff of 2 m: near, far and in between."""

PLACES = st.lists(st.tuples(COORDINATE, COORDINATE), max_size=5).map(
    lambda rows: np.array(rows, dtype=np.float64).reshape(-1, 2)
)

seeded = settings(deadline=None, derandomize=True)


def of_one_frame(truth: Places, tracks: Places, cutoff: float = 2.0, power: float = 2.0) -> float:
    """GOSPA of two sets of places."""
    frames = np.zeros(len(truth), dtype=np.int64), np.zeros(len(tracks), dtype=np.int64)
    scores = gospa(frames[0], truth, frames[1], tracks, 1, cutoff, power)
    return float(scores.frames()[0])


def by_definition(a: Places, b: Places, c: float, p: float) -> float:
    """Definition 1 of the paper, by trying every permutation: the smaller set is assigned in full
    with distances cut off at c, and every element left over of the larger costs c^p / 2."""
    small, large = (a, b) if len(a) <= len(b) else (b, a)
    cut = np.minimum(np.linalg.norm(small[:, None] - large, axis=2), c) ** p
    paired = min(
        sum(cut[i, j] for i, j in enumerate(chosen))
        for chosen in permutations(range(len(large)), len(small))
    )
    return float((paired + c**p / 2 * (len(large) - len(small))) ** (1 / p))


@seeded
@given(PLACES, PLACES, st.sampled_from([0.7, 2.0]), st.sampled_from([1.0, 2.0, 3.0]))
def test_it_is_its_definition(a: Places, b: Places, cutoff: float, power: float) -> None:
    """All assignments of up to five places to five are tried."""
    expected = by_definition(a, b, cutoff, power)
    assert of_one_frame(a, b, cutoff, power) == pytest.approx(expected, rel=1e-12, abs=1e-12)


@seeded
@given(PLACES, PLACES)
def test_it_is_symmetric(a: Places, b: Places) -> None:
    """What is missed becomes false and the other way round: with alpha = 2 they cost the same."""
    assert of_one_frame(a, b) == pytest.approx(of_one_frame(b, a), rel=1e-12)


@seeded
@given(PLACES, st.randoms(use_true_random=False))
def test_a_set_is_at_no_distance_from_itself(a: Places, random: Random) -> None:
    """In any order."""
    shuffled = list(range(len(a)))
    random.shuffle(shuffled)
    assert of_one_frame(a, a[shuffled]) == 0.0


@seeded
@given(PLACES, PLACES)
def test_different_sets_are_at_a_distance(a: Places, b: Places) -> None:
    """0 means the same places."""
    same = sorted(map(tuple, a)) == sorted(map(tuple, b))
    assert (of_one_frame(a, b) == 0.0) == same


@seeded
@given(PLACES, PLACES, PLACES, st.sampled_from([1.0, 2.0]))
def test_no_detour_is_shorter(a: Places, b: Places, c: Places, power: float) -> None:
    """The triangle inequality."""
    direct = of_one_frame(a, c, power=power)
    assert direct <= of_one_frame(a, b, power=power) + of_one_frame(b, c, power=power) + 1e-12


@pytest.mark.parametrize(("power", "expected"), [(1.0, np.sqrt(3.49)), (2.0, np.sqrt(1.89))])
def test_the_power_decides_between_assignments(power: float, expected: float) -> None:
    """Objects at 0 and 1 m, tracks at (1, 0) and (1.8, 0.5). Crosswise the distances are 0 and
    1.87, the other way 1 and 0.94: less in sum is the first, less in squares the second."""
    truth, tracks = np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([[1.0, 0.0], [1.8, 0.5]])
    assert of_one_frame(truth, tracks, power=power) == pytest.approx(expected)


def test_its_parts_by_hand() -> None:
    """c 2 m, p 2. Frame 0: 0.6 m off, one object missed, two tracks false: 0.36 + 2 + 4. Frame 1:
    2 m off is too far, so missed and false: 2 + 2. Frame 2: nothing, which does not count. Frame 3:
    exactly on it. In the mean over three frames 0.36 / 3, 4 / 3 and 6 / 3."""
    scores = gospa(
        np.array([0, 0, 1, 3]),
        np.array([[0.0, 0.0], [30.0, 0.0], [0.0, 0.0], [5.0, 5.0]]),
        np.array([0, 0, 0, 1, 3]),
        np.array([[0.0, 0.6], [50.0, 0.0], [-50.0, 0.0], [2.0, 0.0], [5.0, 5.0]]),
        n_frames=4,
    )
    assert scores.frames() == pytest.approx(np.sqrt([6.36, 4.0, 0.0, 0.0]))
    values = scores.values()
    assert {name: value.n for name, value in values.items()} == dict.fromkeys(values, 3)
    parts = [values[f"gospa_{part}"].value for part in ("localisation", "missed", "false")]
    assert parts == pytest.approx(np.sqrt([0.36 / 3, 4 / 3, 6 / 3]))
    assert values["gospa"].value == pytest.approx(np.sqrt(10.36 / 3))
    assert values["gospa"].value ** 2 == pytest.approx(sum(part**2 for part in parts))


def test_of_one_object_that_is_never_lost_it_is_the_root_mean_square_error() -> None:
    """200 frames, p = 2: numpy's own."""
    error = np.random.default_rng(1).normal(0.0, 0.3, (200, 2))
    frames = np.arange(200)
    scores = gospa(frames, np.zeros((200, 2)), frames, error, 200)
    expected = np.sqrt(np.mean(np.sum(error**2, axis=1)))
    assert scores.values()["gospa"].value == pytest.approx(expected, rel=1e-12)


def test_of_nothing_there_is_no_value() -> None:
    """Neither objects nor tracks: NaN of 0 frames, not a perfect 0."""
    nothing = np.empty(0, dtype=np.int64), np.empty((0, 2))
    for value in gospa(*nothing, *nothing, n_frames=5).values().values():
        assert np.isnan(value.value)
        assert value.n == 0


@pytest.mark.parametrize("power", [1.0, 2.0])
def test_frames_are_assigned_apart_and_at_best(power: float) -> None:
    """400 crowded frames at once: in each the chosen pairs have the largest sum of
    reach^p - d^p of all assignments, and none is 2 m apart or more."""
    rng = np.random.default_rng(7)
    counts = rng.integers(0, 5, (2, 400))
    frame, other = (np.repeat(np.arange(400), count) for count in counts)
    truth, tracks = rng.uniform(0, 3, (len(frame), 2)), rng.uniform(0, 3, (len(other), 2))
    row = assigned(frame, truth, other, tracks, 400, 2.0, power)
    pair = np.flatnonzero(row != UNASSIGNED)
    assert len(set(row[pair])) == len(pair) > 20
    np.testing.assert_array_equal(frame[row[pair]], other[pair])
    distance = np.linalg.norm(truth[row[pair]] - tracks[pair], axis=1)
    assert distance.max() < 2.0
    found = np.bincount(other[pair], 2.0**power - distance**power, 400)
    for k in range(400):
        a, b = truth[frame == k], tracks[other == k]
        gain = 2.0**power - np.minimum(np.linalg.norm(a[:, None] - b, axis=2), 2.0) ** power
        gain = gain if len(a) <= len(b) else gain.T
        every = permutations(range(gain.shape[1]), gain.shape[0])
        best = max(sum(gain[i, j] for i, j in enumerate(chosen)) for chosen in every)
        assert found[k] == pytest.approx(best, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"cutoff": 0.0}, "cutoff is 0.0 m, expected a distance above 0"),
        ({"cutoff": np.inf}, "cutoff is inf m"),
        ({"power": 0.5}, "power is 0.5, expected a number of at least 1"),
        ({"truth_frame": np.array([1, 0])}, r"truth_frame: expected frames of 0\.\.1, ascending"),
        ({"track_frame": np.array([0, 2])}, r"track_frame: expected frames of 0\.\.1, ascending"),
    ],
)
def test_wrong_input_is_refused(wrong: dict[str, object], message: str) -> None:
    """The error names what was given and what was expected."""
    frames, places = np.array([0, 1]), np.zeros((2, 2))
    given = {"truth_frame": frames, "track_frame": frames}
    given |= {"truth_xy": places, "track_xy": places, "n_frames": 2}
    with pytest.raises(ValueError, match=message):
        gospa(**(given | wrong))  # type: ignore[arg-type]
