"""KITTI tracking files into arrays, checked: labels, detections, results of trackers, calibration,
poses, sequences.

Nothing is transformed here but the calibration, which becomes camera -> LiDAR. Boxes stay in
rectified camera axes (x right, y down, z forward) of their own frame. Every error is one line that
names the file and, where there is one, its line.
"""

from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mdkf.tables import BoolArray, FloatArray, IntArray
from sim_bridge.text_table import LARGEST, KittiError, TextTable, is_number, lines, read_bytes

__all__ = [
    "OBJECTS",
    "OTHERS",
    "SEQUENCES",
    "CameraBoxes",
    "KittiError",
    "read_bytes",
    "read_calibration",
    "read_detections",
    "read_labels",
    "read_picture_size",
    "read_poses",
    "read_projection",
    "read_results",
    "read_sequences",
    "read_unlabelled",
]

SEQUENCES = "evaluate_tracking.seqmap."
"""Begin of the names of the files that list sequences: `SSSS empty 000000 NNNNNN`, N frames."""

OBJECTS = ("Car", "Van")
"""KITTI's types that become objects."""

UNLABELLED = "DontCare"
"""Type of an area in which nothing is labelled, whatever is there."""

UNKNOWN_ROTATION = -10.0
"""KITTI's ry of what has no known direction [rad]."""

OTHERS = ("Truck", "Pedestrian", "Person", "Person_sitting", "Cyclist", "Tram", "Misc", UNLABELLED)
"""KITTI's other types; their rows are passed over."""

_BOX = ("h", "w", "l", "x", "y", "z", "ry")
_IMAGE = ("alpha", "x1", "y1", "x2", "y2")
_LABEL = ("frame", "track_id", "type", "truncated", "occluded", *_IMAGE, *_BOX)
_RESULT = (*_LABEL, "score")
_DETECTION = ("frame", "type", "truncated", "occluded", *_IMAGE, *_BOX, "score")
_POSE = ("frame", *(name for k in "123" for name in (f"r{k}1", f"r{k}2", f"r{k}3", f"t{k}")))
_SEQUENCE = ("sequence", "filler", "first", "frames")

_ROTATION_TOLERANCE = 1e-3
"""How far R R^T may be from the identity: the files round to six decimals."""


@dataclass(frozen=True, eq=False)
class CameraBoxes:
    """Boxes of `OBJECTS` in rectified camera axes, one row each, in the file's order.

    line: row in the file, from 1; frame; name: KITTI's type; bottom (n, 3): x, y, z of the middle
    of the bottom face [m]; length, width, height [m]; ry: rotation about the camera's y axis [rad],
    0 where the length points along x; image (n, 4): left, top, right, bottom in the picture [px];
    truncated: 0 within the picture, 1 partly, 2 largely beyond
    its edge; occluded: 0 in full view, 1 partly, 2 largely hidden, 3 unknown; both -1 in
    detections; last: track id of a label, raw score of a detection.
    """

    line: IntArray
    frame: IntArray
    name: list[str]
    bottom: FloatArray
    length: FloatArray
    width: FloatArray
    height: FloatArray
    ry: FloatArray
    image: FloatArray
    truncated: IntArray
    occluded: IntArray
    last: FloatArray


def read_sequences(root: Path, split: str = "training") -> dict[str, int]:
    """Number of frames by the name of each sequence of a split."""
    path = root / f"{SEQUENCES}{split}"
    table = _Table.read(path, _SEQUENCE, words=("sequence", "filler"))
    table.whole("first", 0, 0)
    frames = table.whole("frames", 1, LARGEST).tolist()
    sequences: dict[str, int] = {}
    for line, name, count in zip(table.line, table.words["sequence"], frames, strict=True):
        if name in sequences:
            raise KittiError(
                f"{path}: line {line}: sequence is {name[:40]!r}, expected at most once"
            )
        sequences[name] = count
    return sequences


def read_labels(path: Path, n_frames: int) -> CameraBoxes:
    """The labelled cars and vans of a sequence, at most one row per frame and track id."""
    table = _Table.read(path, _LABEL, words=("type",))
    table.sorted_frames(n_frames)
    objects = table.objects()
    objects.refuse_repeated("track_id")
    objects.refuse_sizes()
    return objects.boxes("track_id")


def read_unlabelled(path: Path, n_frames: int) -> tuple[IntArray, FloatArray]:
    """Frames (n,) and places (n, 4) in the picture, left, top, right, bottom [px], of the areas in
    which nothing is labelled whatever is there (`DontCare`)."""
    table = _Table.read(path, _LABEL, words=("type",))
    table.sorted_frames(n_frames)
    areas = np.array([name == UNLABELLED for name in table.words["type"]], dtype=np.bool_)
    return table.column("frame")[areas].astype(np.int64), table.image()[areas]


def read_detections(path: Path, n_frames: int) -> CameraBoxes:
    """The detected cars and vans of a sequence; an empty file holds none."""
    table = _Table.read(path, _DETECTION, words=("type",))
    table.sorted_frames(n_frames)
    objects = table.objects()
    objects.refuse_sizes()
    return objects.boxes("score")


def read_results(path: Path, n_frames: int) -> tuple[IntArray, CameraBoxes, BoolArray]:
    """Track ids (n,) and boxes of a tracker's results, of all types but `DontCare`, in any order of
    frames, and which boxes (n,) are known; an empty file holds none.

    Of a row whose ry is `UNKNOWN_ROTATION` only the place is known, whatever stands in its other
    columns: RobMOT writes such rows. Its sizes are 0.
    """
    table = _Table.read(path, _RESULT, words=("type",))
    table.whole("frame", 0, n_frames - 1)
    objects = table.objects({*OBJECTS, *OTHERS} - {UNLABELLED})
    known = objects.column("ry") != UNKNOWN_ROTATION
    objects.take(known).refuse_sizes()
    boxes = objects.boxes("score")
    height, width, length = (
        np.where(known, size, 0.0) for size in (boxes.height, boxes.width, boxes.length)
    )
    boxes = replace(boxes, height=height, width=width, length=length)
    return objects.refuse_repeated("track_id"), boxes, known


def read_poses(path: Path, n_frames: int) -> tuple[FloatArray, FloatArray]:
    """Rotations (n_frames, 3, 3) and translations (n_frames, 3) [m], LiDAR -> world."""
    table = _Table.read(path, _POSE)
    table.sorted_frames(n_frames)
    if len(table.line) != n_frames:
        raise KittiError(f"{path}: {len(table.line)} poses, expected {n_frames}, one per frame")
    order = table.column("frame") != np.arange(n_frames)
    table.refuse(order, "frame", "every frame once")
    poses = table.numbers[:, 1:].reshape(n_frames, 3, 4)
    table.refuse(~_is_rotation(poses[:, :, :3]), "r11", "part of a rotation matrix")
    return poses[:, :, :3], poses[:, :, 3]


def read_calibration(path: Path) -> FloatArray:
    """(4, 4): rectified camera -> LiDAR, the inverse of R0_rect Tr_velo_to_cam."""
    rectification, mounting = np.eye(4), np.eye(4)
    rectification[:3, :3] = _matrix(path, "R0_rect", 3)
    mounting[:3] = _matrix(path, "Tr_velo_to_cam", 4)
    return np.linalg.inv(rectification @ mounting).astype(np.float64, copy=False)


def read_projection(path: Path) -> FloatArray:
    """(3, 4): P2, rectified camera [m] -> pixels of image_02 [px] times the depth [m]."""
    return _matrix(path, "P2", 4, rotates=False)


def read_picture_size(path: Path) -> tuple[float, float] | None:
    """Width and height [px] of image_02, as a calibration file's line `S_rect_02` tells them:
    KITTI's raw recordings have it, its tracking data do not."""
    found = _entry(path, "S_rect_02", 2)
    if found is None:
        return None
    where, (width, height) = found
    if not (width > 1.0 and height > 1.0):
        raise KittiError(f"{where} is {width:g} x {height:g}, expected a width and a height [px]")
    return float(width), float(height)


@dataclass(frozen=True, eq=False)
class _Table(TextTable):
    """Rows of KITTI's files."""

    def objects(self, chosen: Collection[str] = OBJECTS) -> "_Table":
        """The rows of some types."""
        types = self.words["type"]
        for line, name in zip(self.line, types, strict=True):
            if name not in OBJECTS and name not in OTHERS:
                known = ", ".join((*OBJECTS, *OTHERS))
                raise KittiError(
                    f"{self.path}: line {line}: type is {name[:40]!r}, expected one of {known}"
                )
        return self.take(np.array([name in chosen for name in types], dtype=np.bool_))

    def image(self) -> FloatArray:
        """Left, top, right, bottom (n, 4) in the picture [px]."""
        return np.column_stack([self.column(name) for name in ("x1", "y1", "x2", "y2")])

    def refuse_sizes(self) -> None:
        """Refuse a box without a size."""
        for name in "hwl":
            self.refuse(self.column(name) <= 0.0, name, "a size above 0 m")

    def boxes(self, last: str) -> CameraBoxes:
        """The rows' boxes; last: the column that becomes the boxes' `last`."""
        return CameraBoxes(
            line=self.line,
            frame=self.column("frame").astype(np.int64),
            name=self.words["type"],
            bottom=np.column_stack([self.column(name) for name in "xyz"]),
            length=self.column("l"),
            width=self.column("w"),
            height=self.column("h"),
            ry=self.column("ry"),
            image=self.image(),
            truncated=self.whole("truncated", -1, 2),
            occluded=self.whole("occluded", -1, 3),
            last=self.column(last),
        )


def _matrix(path: Path, key: str, columns: int, rotates: bool = True) -> FloatArray:
    """The (3, columns) matrix of a calibration file's line `KEY: numbers`; R in front of one that
    rotates."""
    found = _entry(path, key, 3 * columns)
    if found is None:
        raise KittiError(f"{path}: no line {key}:")
    where, values = found
    matrix = values.reshape(3, columns)
    if rotates and not _is_rotation(matrix[None, :, :3])[0]:
        raise KittiError(f"{where} is no rotation matrix")
    return matrix


def _entry(path: Path, key: str, count: int) -> tuple[str, FloatArray] | None:
    """Where a calibration file's line `KEY: numbers` is, and its numbers (count,); None where
    there is no such line."""
    parts = [line.partition(":") for line in lines(path)]
    found = [k for k, (name, _, _) in enumerate(parts) if name.strip() == key]
    if not found:
        return None
    if len(found) > 1:
        raise KittiError(f"{path}: line {found[1] + 1}: {key} is there twice, expected once")
    words = parts[found[0]][2].split()
    where = f"{path}: line {found[0] + 1}: {key}"
    if len(words) != count:
        raise KittiError(f"{where} has {len(words)} numbers, expected {count}")
    for word in words:
        if not is_number(word):
            raise KittiError(f"{where} holds {word[:40]!r}, expected numbers")
    return where, np.array([float(word) for word in words])


def _is_rotation(matrices: FloatArray) -> BoolArray:
    """Whether each of the matrices (n, 3, 3) is a proper rotation, to rounding."""
    product = matrices @ matrices.transpose(0, 2, 1)
    off = np.abs(product - np.eye(3)).max(axis=(1, 2))
    first, second, third = matrices.transpose(1, 0, 2)
    # Not numpy's determinant: it divides by pivots, which may be next to nothing.
    determinant = np.sum(np.cross(first, second) * third, axis=1)
    proper: BoolArray = (off <= _ROTATION_TOLERANCE) & np.greater(determinant, 0.0)
    return proper
