"""KITTI's rules of what counts for class car: tracks and labels into a `Sequence` to be scored.

As TrackEval 1.3.0 (`Kitti2DBox.get_preprocessed_seq_data`) has them, frame by frame:

1. tracks are assigned to cars and vans by most overlap (intersection over union in the picture of
   at least 0.5); a track that belongs to a van, or to a car that is largely hidden by unknown
   things or cut by the picture's edge, is ignored,
2. a track that belongs to nothing is ignored where it is at most 25 pixels high, or lies with more
   than half of its area in a `DontCare` area,
3. of the labels, cars that are neither count.

Which rows count depends on the picture alone. What is left can then be compared by distance, too.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.optimize import linear_sum_assignment

from experiments.metrics import (
    Sequence,
    centre_similarity,
    image_coverage,
    image_iou,
    sequence_from_matrices,
)
from mdkf.tables import BoolArray, FloatArray, IntArray
from sim_bridge.kitti_files import CameraBoxes, read_labels, read_unlabelled
from sim_bridge.kitti_image import PictureBoxes
from sim_bridge.kitti_rig import file_of

Likeness = Literal["image", "ground"]
"""What makes a track alike to a car: overlap in the picture, or nearness seen from above."""

MATCHED = 0.5
"""Overlap from which a track belongs to a label."""

MAX_OCCLUDED = 2
MAX_TRUNCATED = 0
MIN_HEIGHT = 25.0
"""Height in the picture up to which a track of nothing is ignored [px]."""

MAX_COVERED = 0.5
"""Share of its area in one `DontCare` area up to which a track of nothing counts."""

_EPSILON = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False)
class Labels:
    """The labels of a sequence, cars and vans in the file's order, and the areas without labels:
    frame (m,) and area (m, 4) [px]. counted: which labels are cars that count."""

    n_frames: int
    boxes: CameraBoxes
    counted: BoolArray
    area_frame: IntArray
    area: FloatArray

    @staticmethod
    def read(root: Path, sequence: str, n_frames: int) -> "Labels":
        """Of a recorded sequence; `KittiError` for a bad file."""
        path = file_of(root, "label_02", sequence)
        boxes = read_labels(path, n_frames)
        car = np.array([name == "Car" for name in boxes.name], dtype=np.bool_)
        whole = (boxes.occluded <= MAX_OCCLUDED) & (boxes.truncated <= MAX_TRUNCATED)
        return Labels(n_frames, boxes, car & whole, *read_unlabelled(path, n_frames))


@dataclass(frozen=True, eq=False)
class Judged:
    """A sequence's tracks as the rules judge them, of which `sequence` makes what is scored.

    tracks: rows by frame, as they stand in the file that the official scorer reads; track_id
    (rows,). overlap: of each frame (labels, tracks). counts (rows,): which rows are not ignored;
    belongs (rows,): which belong to a label.
    """

    labels: Labels
    tracks: PictureBoxes
    track_id: IntArray
    overlap: list[FloatArray]
    counts: BoolArray
    belongs: BoolArray

    @staticmethod
    def of(labels: Labels, tracks: PictureBoxes, track_id: IntArray) -> "Judged":
        """Apply the rules."""
        counts = tracks.image[:, 3] - tracks.image[:, 1] > MIN_HEIGHT + _EPSILON
        belongs = np.zeros(len(track_id), dtype=np.bool_)
        areas = _slices(labels.area_frame, labels.n_frames)
        overlap = []
        for (truth, mine), areas_here in zip(_frames(labels, tracks), areas, strict=True):
            found = image_iou(labels.boxes.image[truth], tracks.image[mine])
            covered = image_coverage(tracks.image[mine], labels.area[areas_here])
            counts[mine] &= ~(covered > MAX_COVERED + _EPSILON).any(axis=1)
            enough = np.where(found < MATCHED - _EPSILON, 0.0, found)
            label, track = linear_sum_assignment(enough, maximize=True)
            matched = enough[label, track] > _EPSILON
            label, track = label[matched], mine.start + track[matched]
            counts[track] = labels.counted[truth][label]
            belongs[track] = True
            overlap.append(found)
        return Judged(labels, tracks, track_id, overlap, counts, belongs)

    def sequence(self, likeness: Likeness = "image", spared: BoolArray | None = None) -> Sequence:
        """What the metrics see.

        likeness: of the rows that count, `image` is the intersection over union in the picture,
        `ground` max(0, 1 - d / 2 m) of the distance of the boxes' middles in the camera's x-z
        plane, both in rows' order. spared (rows,): rows that are ignored where they belong to
        nothing, which KITTI does not know.
        """
        counts = self.counts if spared is None else self.counts & (self.belongs | ~spared)
        labels, tracks = self.labels, self.tracks
        ids = labels.boxes.last.astype(np.int64)
        truth_ids, track_ids, similarities = [], [], []
        for (truth, mine), similarity in zip(_frames(labels, tracks), self.overlap, strict=True):
            if likeness == "ground":
                # x and z: the camera's y axis points down.
                middles = labels.boxes.bottom[truth, ::2], tracks.bottom[mine, ::2]
                similarity = centre_similarity(*middles)
            truth_ids.append(ids[truth][labels.counted[truth]])
            track_ids.append(self.track_id[mine][counts[mine]])
            similarities.append(similarity[labels.counted[truth]][:, counts[mine]])
        return sequence_from_matrices(truth_ids, track_ids, similarities)


def _frames(labels: Labels, tracks: PictureBoxes) -> Iterator[tuple[slice, slice]]:
    """Each frame's labels and tracks."""
    n_frames = labels.n_frames
    return zip(_slices(labels.boxes.frame, n_frames), _slices(tracks.frame, n_frames), strict=True)


def _slices(frame: IntArray, n_frames: int) -> list[slice]:
    """Each frame's rows, by their ascending frames (rows,)."""
    start = np.searchsorted(frame, np.arange(n_frames + 1)).tolist()
    return [slice(*pair) for pair in pairwise(start)]
