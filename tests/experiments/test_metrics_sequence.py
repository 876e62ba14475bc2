"""A `Sequence` holds the rows it was given, in one order, or says which row does not fit."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from experiments.metrics import (
    Pairs,
    Sequence,
    clear,
    hota,
    identity,
    sequence_from_matrices,
    sequence_from_rows,
)


def rows(n_frames: int, n_ids: int, seed: int) -> tuple[Any, Any, Any]:
    rng = np.random.default_rng(seed)
    frame, index = np.divmod(np.arange(n_frames * n_ids), n_ids)
    return frame, index, rng.uniform(0.0, 8.0, (n_frames * n_ids, 2))


def shuffled(table: tuple[Any, Any, Any]) -> tuple[Any, Any, Any]:
    order = np.random.default_rng(3).permutation(len(table[0]))
    return table[0][order], table[1][order], table[2][order]


def small(**changes: Any) -> Sequence:
    """Two frames: two objects and one track, then one object and two tracks; one pair is apart."""
    sequence = Sequence(
        truth_start=np.array([0, 2, 3]),
        truth=np.array([0, 1, 1]),
        track_start=np.array([0, 1, 3]),
        track=np.array([0, 0, 1]),
        pairs=PAIRS,
        n_objects=2,
        n_tracks=2,
    )
    return replace(sequence, **changes)


def similar(values: Any) -> Pairs:
    return PAIRS._replace(similarity=np.asarray(values))


PAIRS = Pairs(
    start=np.array([0, 1, 1, 3]), row=np.array([0, 1, 2]), similarity=np.array([0.1, 0.3, 0.4])
)


def test_similarity_falls_from_one_to_zero_over_the_scale() -> None:
    """Centres 0, 1, 2 and 5 m apart at a scale of 2 m, and 1 m apart at 4 m."""
    distances = np.array([0.0, 1.0, 2.0, 5.0])
    track_boxes = np.stack((0.6 * distances, 0.8 * distances), axis=1)
    frames, ids = np.arange(4), np.zeros(4, int)
    built = sequence_from_rows(frames, ids, np.zeros((4, 2)), frames, ids, track_boxes, 4)
    found = [built.frame_similarity(k)[0, 0] for k in range(4)]
    np.testing.assert_allclose(found, [1.0, 0.5, 0.0, 0.0], atol=1e-15)
    wide = sequence_from_rows([0], [0], [[0.0, 0.0]], [0], [0], [[0.0, 1.0]], 1, scale=4.0)
    np.testing.assert_array_equal(wide.frame_similarity(0), [[0.75]])


def test_frames_are_matrices_of_objects_by_tracks() -> None:
    """Each with its own shape, and 0 where no pair is listed."""
    np.testing.assert_array_equal(small().frame_similarity(0), [[0.1], [0.0]])
    np.testing.assert_array_equal(small().frame_similarity(1), [[0.3, 0.4]])
    with pytest.raises(IndexError, match=r"frame 2 is outside 0\.\.1"):
        small().frame_similarity(2)


def test_every_pair_lists_the_dissimilar_ones_too() -> None:
    """All of a frame's matrix in row-major order, the 0 included."""
    start, row, similarity = small().every_pair
    np.testing.assert_array_equal(start, [0, 1, 2, 4])
    np.testing.assert_array_equal(row, [0, 0, 1, 2])
    np.testing.assert_array_equal(similarity, [0.1, 0.0, 0.3, 0.4])


def test_a_sequence_of_matrices_is_the_one_of_rows() -> None:
    """The same ids and matrices give the same arrays; an empty frame has an empty matrix."""
    truth, tracks = rows(5, 6, seed=1), rows(4, 7, seed=2)
    built = sequence_from_rows(*truth, *tracks, 5)
    again = sequence_from_matrices(
        [truth[1][truth[0] == k] for k in range(5)],
        [tracks[1][tracks[0] == k] for k in range(5)],
        [built.frame_similarity(k) for k in range(5)],
    )
    for name in ("truth_start", "truth", "track_start", "track"):
        np.testing.assert_array_equal(getattr(again, name), getattr(built, name))
    for ours, theirs in zip(again.pairs, built.pairs, strict=True):
        assert ours.tobytes() == theirs.tobytes()
    assert (again.n_objects, again.n_tracks) == (6, 7)


def test_matrices_keep_the_order_of_their_rows() -> None:
    """Ids 9, 4 in a frame stay in that order, with indices 1, 0."""
    built = sequence_from_matrices([[9, 4]], [[-1]], [[[0.25], [0.5]]])
    np.testing.assert_array_equal(built.truth, [1, 0])
    np.testing.assert_array_equal(built.frame_similarity(0), [[0.25], [0.5]])


@pytest.mark.parametrize(
    ("truth", "track", "matrices", "message"),
    [
        ([[1]], [[1], []], [[[1.0]]], r"1 frames of truth, 2 of tracks and 1 of similarities"),
        (
            [[1]],
            [[1, 2]],
            [[[1.0]]],
            r"similarity of frame 0 has shape \(1, 1\), expected \(1, 2\)",
        ),
        ([[1]], [[1]], [[[-0.1]]], r"similarity must be between 0 and 1"),
        ([[1]], [[1]], [[[np.nan]]], r"similarity must be between 0 and 1"),
        ([[1, 1]], [[1]], [[[0.1], [0.1]]], r"truth index 0 occurs twice in frame 0"),
        ([[0.5]], [[1]], [[[0.1]]], r"truth_id of frame 0 must be .* int64, not float64"),
    ],
)
def test_matrices_that_do_not_fit_are_named(
    truth: Any, track: Any, matrices: Any, message: str
) -> None:
    """What was given, what was expected, and where."""
    with pytest.raises(ValueError, match=message):
        sequence_from_matrices(truth, track, matrices)


def test_any_int64_is_an_id_and_empty_frames_stay() -> None:
    """Negative and huge ids become 0, 1, ... in their order; frames 0 and 2 of 4 are empty."""
    ids = [2**62, -(2**62), 2**62]
    built = sequence_from_rows([1, 1, 3], ids, np.zeros((3, 2)), [], [], [], 4)
    np.testing.assert_array_equal(built.truth, [0, 1, 1])
    np.testing.assert_array_equal(built.truth_start, [0, 0, 2, 2, 3])
    np.testing.assert_array_equal(built.track_start, np.zeros(5))
    assert (built.n_objects, built.n_tracks, built.n_frames) == (2, 0, 4)


def test_the_order_of_rows_does_not_matter() -> None:
    """Shuffled rows give the same bytes, and so the same scores, twice over."""
    truth, tracks = rows(30, 6, seed=1), rows(30, 7, seed=2)
    built = sequence_from_rows(*truth, *tracks, 30)
    again = sequence_from_rows(*shuffled(truth), *shuffled(tracks), 30)
    for ours, theirs in zip(built.pairs, again.pairs, strict=True):
        assert ours.tobytes() == theirs.tobytes()
    assert hota(built).hota.tobytes() == hota(again).hota.tobytes()
    assert clear(built) == clear(again)
    assert identity(built) == identity(again)


GOOD: dict[str, Any] = {
    "truth_frame": [0, 0, 1],
    "truth_id": [7, 8, 8],
    "truth_boxes": np.zeros((3, 2)),
    "track_frame": [0],
    "track_id": [-5],
    "track_boxes": np.zeros((1, 2)),
    "n_frames": 2,
}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"truth_id": [7, 7, 8]}, r"truth: id 7 occurs twice in frame 0"),
        (
            {"track_frame": [1, 1], "track_id": [-5, -5], "track_boxes": np.zeros((2, 2))},
            r"track: id -5 occurs twice in frame 1",
        ),
        ({"truth_frame": [0, 0, 2]}, r"truth: frame 2 is outside 0\.\.1"),
        ({"track_frame": [-1]}, r"track: frame -1 is outside 0\.\.1"),
        (
            {"track_boxes": [[0.0, np.nan]]},
            r"track: id -5 in frame 0 has y nan, expected a finite number",
        ),
        ({"truth_id": [7, 8]}, r"truth: 3 frames, 2 ids and boxes of shape \(3, 2\)"),
        (
            {"truth_boxes": np.zeros((3, 3))},
            r"truth: boxes of shape \(3, 3\), expected \(n, 2\) for similarity centre: x, y",
        ),
        ({"truth_id": [7.5, 8.0, 8.0]}, r"truth_id must be one-dimensional int64, not float64"),
        ({"scale": 0.0}, r"scale must be a positive distance in metres, not 0\.0"),
        ({"n_frames": -1}, r"n_frames must not be negative, not -1"),
    ],
)
def test_rows_that_do_not_fit_are_named(change: dict[str, Any], message: str) -> None:
    """What was given, what was expected, and where."""
    with pytest.raises(ValueError, match=message):
        sequence_from_rows(**(GOOD | change))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"truth": np.array([0, 1, 2])}, r"truth must be between 0 and 1: found 0\.\.2"),
        ({"truth": np.array([0, 0, 1])}, r"truth index 0 occurs twice in frame 0"),
        ({"track": np.array([0, 1, 1])}, r"track index 1 occurs twice in frame 1"),
        ({"n_tracks": 3}, r"track index 2 has no row: expected all of 0\.\.2"),
        ({"truth_start": np.array([0, 2, 4])}, r"truth_start must rise from 0 .* rows, 3"),
        ({"truth_start": np.array([0, 4, 3])}, r"truth_start must rise"),
        ({"track_start": np.array([0, 3])}, r"truth_start has 3 offsets and track_start 2"),
        ({"pairs": PAIRS._replace(start=np.array([0, 1, 3]))}, r"pairs.start must have 4 offsets"),
        ({"pairs": PAIRS._replace(start=np.array([0, 1, 2, 5]))}, r"rise from 0 to the number"),
        ({"pairs": PAIRS._replace(start=np.array([0, 2, 1, 3]))}, r"rise from 0 to the number"),
        ({"pairs": PAIRS._replace(row=np.array([1, 1, 2]))}, r"pairs.row 1 of truth row 0 is not"),
        ({"pairs": PAIRS._replace(row=np.array([0, 1, 3]))}, r"row 2 is not .* expected 1..2"),
        ({"pairs": PAIRS._replace(row=np.array([0, 2, 1]))}, r"must rise within truth row 2"),
        ({"pairs": similar([0.1, np.nan, 1.0])}, r"similarity must be between 0 and 1"),
        ({"pairs": similar([0.1, 1.1, 1.0])}, r"similarity must be between 0 and 1"),
        ({"pairs": similar([0.1, -0.1, 1.0])}, r"similarity must be between 0 and 1"),
        ({"pairs": similar([0.1, 0.0, 1.0])}, r"of a listed pair above 0: truth row 2"),
        ({"pairs": similar([0.1, 0.2])}, r"3 rows and 2 similarities"),
        (
            {"pairs": similar(np.zeros(3, np.float32))},
            r"similarity must be .* float64 array, not f",
        ),
        ({"truth": np.array([0, 1, 1], np.int32)}, r"truth must be .* int64 array, not int32"),
    ],
)
def test_a_sequence_that_does_not_fit_cannot_be_made(change: dict[str, Any], message: str) -> None:
    """The kernels index without checking, so nothing wrong may reach them."""
    with pytest.raises(ValueError, match=message):
        small(**change)
