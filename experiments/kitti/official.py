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

from dataclasses import dataclass
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


def official_sequence(
    labels: Labels,
    tracks: PictureBoxes,
    track_id: IntArray,
    likeness: Likeness = "image",
    spared: BoolArray | None = None,
) -> Sequence:
    """What the metrics see of one sequence under KITTI's rules.

    tracks: rows by frame, as they stand in the file that the official scorer reads; track_id
    (rows,). spared (rows,): rows that are ignored where they belong to nothing, which KITTI does
    not know. likeness: of the rows that count, `image` is the intersection over union in the
    picture, `ground` max(0, 1 - d / 2 m) of the distance of the boxes' middles in the camera's
    x-z plane, both in rows' order.
    """
    frames = range(labels.n_frames + 1)
    truth_start = np.searchsorted(labels.boxes.frame, frames)
    track_start = np.searchsorted(tracks.frame, frames)
    area_start = np.searchsorted(labels.area_frame, frames)
    spare = np.zeros(len(tracks.frame), dtype=np.bool_) if spared is None else spared
    truth_ids, track_ids, similarities = [], [], []
    for k in range(labels.n_frames):
        truth = slice(truth_start[k], truth_start[k + 1])
        mine = slice(track_start[k], track_start[k + 1])
        area = labels.area[area_start[k] : area_start[k + 1]]
        overlap = image_iou(labels.boxes.image[truth], tracks.image[mine])
        counted = labels.counted[truth]
        ignored = _ignored(overlap, counted, tracks.image[mine], area, spare[mine])
        if likeness == "ground":
            # x and z: the camera's y axis points down.
            overlap = centre_similarity(labels.boxes.bottom[truth, ::2], tracks.bottom[mine, ::2])
        truth_ids.append(labels.boxes.last[truth][counted].astype(np.int64))
        track_ids.append(track_id[mine][~ignored])
        similarities.append(overlap[counted][:, ~ignored])
    return sequence_from_matrices(truth_ids, track_ids, similarities)


def _ignored(
    overlap: FloatArray,
    counted: BoolArray,
    image: FloatArray,
    area: FloatArray,
    spare: BoolArray,
) -> BoolArray:
    """Which tracks of a frame are neither right nor wrong, (tracks,).

    overlap (labels, tracks); counted (labels,); image (tracks, 4) and area (areas, 4) [px]; spare
    (tracks,): whether a track of nothing is ignored anyway.
    """
    enough = np.where(overlap < MATCHED - _EPSILON, 0.0, overlap)
    label, track = linear_sum_assignment(enough, maximize=True)
    matched = enough[label, track] > _EPSILON
    label, track = label[matched], track[matched]
    ignored = spare | (image[:, 3] - image[:, 1] <= MIN_HEIGHT + _EPSILON)
    ignored |= (image_coverage(image, area) > MAX_COVERED + _EPSILON).any(axis=1)
    ignored[track] = ~counted[label]
    return ignored
