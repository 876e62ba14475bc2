"""Rows of truth and tracks into a `Sequence`: what the metrics see of one sequence.

Objects and tracks get dense indices, frames become slices of flat arrays, and the pairs of objects
and tracks that are similar at all are listed: made from their boxes, or given as matrices.
"""

from __future__ import annotations

from collections.abc import Sequence as ListLike
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from experiments.metrics.boxes import (
    CENTRE_SCALE,
    Floats,
    Ints,
    Pairs,
    Similarity,
    as_boxes,
    similar_pairs,
)

_SIMILARITY_ROUNDING = 1e-9
"""An intersection over union of equal boxes may exceed 1 by rounding, not by more than this."""


def ratio(numerator: float, denominator: float) -> float:
    """`numerator / denominator`, or NaN ("no value") if there is nothing to divide by."""
    return float(numerator) / float(denominator) if denominator else float("nan")


@dataclass(frozen=True, eq=False)
class Sequence:
    """Truth and tracks of one sequence as the metrics see them; checked when made.

    Attributes:
        truth_start: (n_frames + 1,) offsets; frame k has rows truth_start[k]:truth_start[k + 1].
        truth: (n_truth_rows,) object index, 0..n_objects-1, each used, once per frame at most.
        track_start: (n_frames + 1,) offsets of the frames into `track`.
        track: (n_track_rows,) track index, 0..n_tracks-1, each used, once per frame at most.
        pairs: track rows similar to each truth row of their frame, by more than 0 and up to 1.
        n_objects: number of different objects.
        n_tracks: number of different tracks.

    Raises:
        ValueError: if the arrays do not fit each other (see `validate`).
    """

    truth_start: Ints
    truth: Ints
    track_start: Ints
    track: Ints
    pairs: Pairs
    n_objects: int
    n_tracks: int

    def __post_init__(self) -> None:
        # The kernels do not check bounds, so a Sequence that does not fit must never exist.
        self.validate()

    @property
    def n_frames(self) -> int:
        """Number of frames, empty ones included."""
        return len(self.truth_start) - 1

    @cached_property
    def truth_frame(self) -> Ints:
        """(n_truth_rows,) frame of each truth row."""
        return np.repeat(np.arange(self.n_frames), np.diff(self.truth_start))

    @cached_property
    def object_start(self) -> Ints:
        """(n_objects + 1,) offsets of the objects into `object_rows`."""
        counts = np.bincount(self.truth, minlength=self.n_objects)
        return np.concatenate((np.zeros(1, np.int64), np.cumsum(counts)))

    @cached_property
    def object_rows(self) -> Ints:
        """(n_truth_rows,) the truth rows object by object, each object's in time order."""
        return np.argsort(self.truth, kind="stable")

    @cached_property
    def track_count(self) -> Ints:
        """(n_tracks,) number of rows of each track."""
        return np.bincount(self.track, minlength=self.n_tracks).astype(np.int64)

    @cached_property
    def every_pair(self) -> Pairs:
        """All pairs of rows that share a frame, those of similarity 0 too."""
        n_tracks = np.diff(self.track_start)[self.truth_frame]
        start = np.concatenate((np.zeros(1, np.int64), np.cumsum(n_tracks)))
        shift = self.track_start[self.truth_frame] - start[:-1]
        similarity = np.zeros(start[-1])
        truth_row = np.repeat(np.arange(len(self.truth)), np.diff(self.pairs.start))
        similarity[self.pairs.row - shift[truth_row]] = self.pairs.similarity
        return Pairs(start, np.arange(start[-1]) + np.repeat(shift, n_tracks), similarity)

    def frame_similarity(self, k: int) -> Floats:
        """Similarities (objects in frame, tracks in frame) of frame `k`.

        Raises:
            IndexError: if there is no frame `k`.
        """
        if not 0 <= k < self.n_frames:
            raise IndexError(f"frame {k} is outside 0..{self.n_frames - 1}")
        first, last = self.truth_start[k : k + 2]
        matrix = np.zeros((last - first, self.track_start[k + 1] - self.track_start[k]))
        own = slice(self.pairs.start[first], self.pairs.start[last])
        i = np.repeat(np.arange(last - first), np.diff(self.pairs.start[first : last + 1]))
        matrix[i, self.pairs.row[own] - self.track_start[k]] = self.pairs.similarity[own]
        return matrix

    def validate(self) -> None:
        """Check that the arrays fit each other.

        Raises:
            ValueError: naming the array, what was found and what was expected.
        """
        for name in ("truth_start", "truth", "track_start", "track"):
            _check_array(name, getattr(self, name), np.dtype(np.int64))
        if len(self.truth_start) != len(self.track_start):
            raise ValueError(
                f"truth_start has {len(self.truth_start)} offsets and track_start "
                f"{len(self.track_start)}: expected n_frames + 1 in both"
            )
        _check_rows("truth", self.truth_start, self.truth, self.n_objects)
        _check_rows("track", self.track_start, self.track, self.n_tracks)
        _check_array("pairs.start", self.pairs.start, np.dtype(np.int64))
        _check_array("pairs.row", self.pairs.row, np.dtype(np.int64))
        _check_array("pairs.similarity", self.pairs.similarity, np.dtype(np.float64))
        _check_pairs(self.pairs, self.track_start, self.truth_frame)


def sequence_from_rows(
    truth_frame: ArrayLike,
    truth_id: ArrayLike,
    truth_boxes: ArrayLike,
    track_frame: ArrayLike,
    track_id: ArrayLike,
    track_boxes: ArrayLike,
    n_frames: int,
    similarity: Similarity = "centre",
    scale: float = CENTRE_SCALE,
) -> Sequence:
    """Build a `Sequence` from boxes, of which `similarity` tells what they hold and compares.

    Rows may come in any order; they are sorted by (frame, id), so that the scores depend on
    nothing else.

    Args:
        truth_frame: (n_truth_rows,) frame of each truth row, 0..n_frames-1.
        truth_id: (n_truth_rows,) any int64, once per frame at most.
        truth_boxes: (n_truth_rows, len(COLUMNS[similarity])) its columns; centre: x, y [m].
        track_frame: (n_track_rows,) as `truth_frame`.
        track_id: (n_track_rows,) as `truth_id`.
        track_boxes: (n_track_rows, len(COLUMNS[similarity])) as `truth_boxes`.
        n_frames: number of frames, empty ones included.
        similarity: centre, bird, box or image; see `experiments.metrics.boxes`.
        scale: of centre alone: distance [m] from which the similarity is 0.

    Raises:
        ValueError: unequal lengths, a frame outside the sequence, a box that is not finite or has
            a negative size, an id twice in one frame (naming frame and id), an unknown similarity,
            or a scale that is not positive.
    """
    if not (np.isfinite(scale) and scale > 0.0):
        raise ValueError(f"scale must be a positive distance in metres, not {scale}")
    if n_frames < 0:
        raise ValueError(f"n_frames must not be negative, not {n_frames}")
    truth_start, truth, truth_rows, n_objects = _sorted_rows(
        "truth", truth_frame, truth_id, truth_boxes, n_frames, similarity
    )
    track_start, track, track_rows, n_tracks = _sorted_rows(
        "track", track_frame, track_id, track_boxes, n_frames, similarity
    )
    pairs = similar_pairs(similarity, truth_start, truth_rows, track_start, track_rows, scale)
    return Sequence(truth_start, truth, track_start, track, pairs, n_objects, n_tracks)


def sequence_from_matrices(
    truth_id: ListLike[ArrayLike], track_id: ListLike[ArrayLike], similarity: ListLike[ArrayLike]
) -> Sequence:
    """Build a `Sequence` from similarities that are there already, one entry per frame.

    Rows keep their order in the frame, which decides between equally good matches.

    Args:
        truth_id: of each frame (n_objects_in_frame,) any int64, once per frame at most.
        track_id: of each frame (n_tracks_in_frame,) likewise.
        similarity: of each frame (n_objects_in_frame, n_tracks_in_frame), 0 to 1.

    Raises:
        ValueError: unequal numbers of frames, a matrix that does not fit its ids (naming the
            frame), or what `Sequence` refuses.
    """
    if not len(truth_id) == len(track_id) == len(similarity):
        raise ValueError(
            f"{len(truth_id)} frames of truth, {len(track_id)} of tracks and {len(similarity)} of "
            "similarities: expected as many of each"
        )
    truth_start, truth, n_objects = _dense_indices("truth_id", truth_id)
    track_start, track, n_tracks = _dense_indices("track_id", track_id)
    counts, rows, values = [np.zeros(1, np.int64)], [np.zeros(0, np.int64)], [np.zeros(0)]
    shapes = zip(np.diff(truth_start).tolist(), np.diff(track_start).tolist(), strict=True)
    for k, (given, expected) in enumerate(zip(similarity, shapes, strict=True)):
        matrix = np.asarray(given, dtype=np.float64)
        if matrix.shape != expected:
            raise ValueError(
                f"similarity of frame {k} has shape {matrix.shape}, expected {expected}"
            )
        # Not > 0, so that what is wrong is refused: below 0, or not a number.
        i, j = np.nonzero(matrix)
        counts.append(np.bincount(i, minlength=len(matrix)))
        rows.append(track_start[k] + j)
        values.append(matrix[i, j])
    pairs = Pairs(
        np.cumsum(np.concatenate(counts), dtype=np.int64),
        np.concatenate(rows),
        np.concatenate(values),
    )
    return Sequence(truth_start, truth, track_start, track, pairs, n_objects, n_tracks)


def _dense_indices(name: str, ids: ListLike[ArrayLike]) -> tuple[Ints, Ints, int]:
    """Offsets of the frames, indices of the ids and their number."""
    frames = [_as_int64(f"{name} of frame {k}", frame) for k, frame in enumerate(ids)]
    start = np.cumsum([0, *map(len, frames)], dtype=np.int64)
    known, index = np.unique(np.concatenate([np.zeros(0, np.int64), *frames]), return_inverse=True)
    return start, index.astype(np.int64), len(known)


def _sorted_rows(
    name: str,
    frame: ArrayLike,
    identity: ArrayLike,
    boxes: ArrayLike,
    n_frames: int,
    similarity: Similarity,
) -> tuple[Ints, Ints, Floats, int]:
    """Offsets, dense indices, boxes and number of ids of one table, sorted by (frame, id)."""
    frames = _as_int64(f"{name}_frame", frame)
    ids = _as_int64(f"{name}_id", identity)
    if not len(frames) == len(ids) == len(np.asarray(boxes)):
        raise ValueError(
            f"{name}: {len(frames)} frames, {len(ids)} ids and boxes of shape "
            f"{np.shape(boxes)}: expected as many of each"
        )
    rows = as_boxes(name, boxes, similarity, lambda row: f"id {ids[row]} in frame {frames[row]}")
    if len(frames) and not (frames.min() >= 0 and frames.max() < n_frames):
        bad = frames[(frames < 0) | (frames >= n_frames)][0]
        raise ValueError(f"{name}: frame {bad} is outside 0..{n_frames - 1}")
    step = np.diff(frames)
    if not ((step > 0) | ((step == 0) & (np.diff(ids) > 0))).all():
        order = np.lexsort((ids, frames))
        frames, ids, rows = frames[order], ids[order], rows[order]
    twice = np.flatnonzero((np.diff(frames) == 0) & (np.diff(ids) == 0))
    if len(twice):
        raise ValueError(f"{name}: id {ids[twice[0]]} occurs twice in frame {frames[twice[0]]}")
    known, index = np.unique(ids, return_inverse=True)
    start = np.searchsorted(frames, np.arange(n_frames + 1)).astype(np.int64)
    return start, index.astype(np.int64), rows, len(known)


def _as_int64(name: str, values: ArrayLike) -> Ints:
    array = np.asarray(values)
    if array.ndim != 1 or (array.size and not np.can_cast(array.dtype, np.int64, "safe")):
        raise ValueError(
            f"{name} must be one-dimensional int64, not {array.dtype} of shape {array.shape}"
        )
    return array.astype(np.int64)


def _check_array(name: str, array: NDArray[Any], dtype: np.dtype[Any]) -> None:
    if array.dtype != dtype or array.ndim != 1 or not array.flags.c_contiguous:
        raise ValueError(
            f"{name} must be a contiguous one-dimensional {dtype} array, "
            f"not {array.dtype} of shape {array.shape}"
        )


def _check_rows(name: str, start: Ints, index: Ints, n: int) -> None:
    if not len(start) or start[0] != 0 or start[-1] != len(index) or (np.diff(start) < 0).any():
        raise ValueError(f"{name}_start must rise from 0 to the number of rows, {len(index)}")
    if len(index) and not (index.min() >= 0 and index.max() < n):
        raise ValueError(
            f"{name} must be between 0 and {n - 1}: found {index.min()}..{index.max()}"
        )
    unused = np.flatnonzero(np.bincount(index, minlength=n) == 0)
    if len(unused):
        raise ValueError(f"{name} index {unused[0]} has no row: expected all of 0..{n - 1}")
    row = _first_repeated_row(start, index, n)
    if row >= 0:
        frame = np.searchsorted(start, row, side="right") - 1
        raise ValueError(f"{name} index {index[row]} occurs twice in frame {frame}")


def _check_pairs(pairs: Pairs, track_start: Ints, truth_frame: Ints) -> None:
    start, row, similarity = pairs
    rises = len(start) == len(truth_frame) + 1 and start[0] == 0 and (np.diff(start) >= 0).all()
    if not (rises and start[-1] == len(row) == len(similarity)):
        raise ValueError(
            f"pairs.start must have {len(truth_frame) + 1} offsets and rise from 0 to the number "
            f"of pairs; there are {len(start)} offsets, {len(row)} rows and {len(similarity)} "
            "similarities"
        )
    truth_row = np.repeat(np.arange(len(truth_frame)), np.diff(start))
    frame = truth_frame[truth_row]
    outside = (row < track_start[frame]) | (row >= track_start[frame + 1])
    if outside.any():
        at = np.flatnonzero(outside)[0]
        raise ValueError(
            f"pairs.row {row[at]} of truth row {truth_row[at]} is not a track row of its frame, "
            f"expected {track_start[frame[at]]}..{track_start[frame[at] + 1] - 1}"
        )
    falls = np.flatnonzero((np.diff(row) <= 0) & (np.diff(truth_row) == 0))
    if len(falls):
        raise ValueError(f"pairs.row must rise within truth row {truth_row[falls[0]]}")
    # Written so that NaN fails too.
    wrong = ~((similarity > 0.0) & (similarity <= 1.0 + _SIMILARITY_ROUNDING))
    if wrong.any():
        at = np.flatnonzero(wrong)[0]
        raise ValueError(
            f"similarity must be between 0 and 1, and of a listed pair above 0: truth row "
            f"{truth_row[at]} and track row {row[at]} have {similarity[at]}"
        )


@njit(cache=True)
def _first_repeated_row(start: Ints, index: Ints, n: int) -> int:
    last_frame = np.full(n, -1, np.int64)
    for frame in range(len(start) - 1):
        for row in range(start[frame], start[frame + 1]):
            if last_frame[index[row]] == frame:
                return row
            last_frame[index[row]] = frame
    return -1
