"""A `Sequence` holds the rows it was given, in one order, or says which row does not fit."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from experiments.metrics import Sequence, clear, hota, identity, sequence_from_rows


def rows(n_frames: int, n_ids: int, seed: int) -> tuple[Any, Any, Any]:
    rng = np.random.default_rng(seed)
    frame, index = np.divmod(np.arange(n_frames * n_ids), n_ids)
    return frame, index, rng.uniform(0.0, 8.0, (n_frames * n_ids, 2))


def shuffled(table: tuple[Any, Any, Any]) -> tuple[Any, Any, Any]:
    order = np.random.default_rng(3).permutation(len(table[0]))
    return table[0][order], table[1][order], table[2][order]


def small(**changes: Any) -> Sequence:
    """Two frames: two objects and one track, then one object and two tracks."""
    sequence = Sequence(
        truth_start=np.array([0, 2, 3]),
        truth=np.array([0, 1, 1]),
        track_start=np.array([0, 1, 3]),
        track=np.array([0, 0, 1]),
        similarity=np.array([0.1, 0.2, 0.3, 0.4]),
        n_objects=2,
        n_tracks=2,
    )
    return replace(sequence, **changes)


def test_similarity_falls_from_one_to_zero_over_the_scale() -> None:
    """Centres 0, 1, 2 and 5 m apart at a scale of 2 m, and 1 m apart at 4 m."""
    distances = np.array([0.0, 1.0, 2.0, 5.0])
    track_boxes = np.stack((0.6 * distances, 0.8 * distances), axis=1)
    frames, ids = np.arange(4), np.zeros(4, int)
    built = sequence_from_rows(frames, ids, np.zeros((4, 2)), frames, ids, track_boxes, 4)
    np.testing.assert_allclose(built.similarity, [1.0, 0.5, 0.0, 0.0], atol=1e-15)
    wide = sequence_from_rows([0], [0], [[0.0, 0.0]], [0], [0], [[0.0, 1.0]], 1, scale=4.0)
    np.testing.assert_array_equal(wide.similarity, [0.75])


def test_frames_are_matrices_of_objects_by_tracks() -> None:
    """Each frame's slice of the flat similarities, with its own shape."""
    np.testing.assert_array_equal(small().frame_similarity(0), [[0.1], [0.2]])
    np.testing.assert_array_equal(small().frame_similarity(1), [[0.3, 0.4]])
    with pytest.raises(IndexError, match=r"frame 2 is outside 0\.\.1"):
        small().frame_similarity(2)


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
    assert built.similarity.tobytes() == again.similarity.tobytes()
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
        ({"similarity": np.zeros(5)}, r"similarity has 5 entries: .* need 4"),
        ({"similarity": np.array([0.1, np.nan, 0, 0])}, r"similarity must be between 0 and 1"),
        ({"similarity": np.array([0.1, 1.1, 0, 0])}, r"similarity must be between 0 and 1"),
        ({"similarity": np.zeros(4, np.float32)}, r"similarity must be .* float64 array, not fl"),
        ({"truth": np.array([0, 1, 1], np.int32)}, r"truth must be .* int64 array, not int32"),
    ],
)
def test_a_sequence_that_does_not_fit_cannot_be_made(change: dict[str, Any], message: str) -> None:
    """The kernels index without checking, so nothing wrong may reach them."""
    with pytest.raises(ValueError, match=message):
        small(**change)
