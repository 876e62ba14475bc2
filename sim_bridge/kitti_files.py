"""KITTI tracking files into arrays, checked: labels, detections, calibration, poses, sequences.

Nothing is transformed here but the calibration, which becomes camera -> LiDAR. Boxes stay in
rectified camera axes (x right, y down, z forward) of their own frame. Every error is one line that
names the file and, where there is one, its line.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np

from mdkf.tables import BoolArray, FloatArray, IntArray

SEQUENCES = "evaluate_tracking.seqmap."
"""Begin of the names of the files that list sequences: `SSSS empty 000000 NNNNNN`, N frames."""

OBJECTS = ("Car", "Van")
"""KITTI's types that become objects."""

OTHERS = ("Truck", "Pedestrian", "Person", "Person_sitting", "Cyclist", "Tram", "Misc", "DontCare")
"""KITTI's other types; their rows are passed over."""

_BOX = ("h", "w", "l", "x", "y", "z", "ry")
_IMAGE = ("alpha", "x1", "y1", "x2", "y2")
_LABEL = ("frame", "track_id", "type", "truncated", "occluded", *_IMAGE, *_BOX)
_DETECTION = ("frame", "type", "truncated", "occluded", *_IMAGE, *_BOX, "score")
_POSE = ("frame", *(name for k in "123" for name in (f"r{k}1", f"r{k}2", f"r{k}3", f"t{k}")))
_SEQUENCE = ("sequence", "filler", "first", "frames")

_LARGEST = 10**9
"""Largest number that a file may hold, of whatever unit."""

_PLAIN = b"\t\n\r" + bytes(range(ord(" "), 0x7F))
"""What the files may hold: ASCII without control characters. Python takes more than that for
spaces, digits and ends of lines, so that rows and numbers could be others than they seem."""

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)

_ROTATION_TOLERANCE = 1e-3
"""How far R R^T may be from the identity: the files round to six decimals."""


class KittiError(ValueError):
    """Recorded data that cannot be used; the message is one line and names file and line."""


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
    frames = table.whole("frames", 1, _LARGEST).tolist()
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
    ids = objects.whole("track_id", 0, _LARGEST)
    keys = objects.column("frame").astype(np.int64) * (_LARGEST + 1) + ids
    first = np.unique(keys, return_index=True)[1]
    repeated = np.ones(len(keys), dtype=np.bool_)
    repeated[first] = False
    objects.refuse(repeated, "track_id", "at most once in a frame")
    return objects.boxes("track_id")


def read_unlabelled(path: Path, n_frames: int) -> tuple[IntArray, FloatArray]:
    """Frames (n,) and places (n, 4) in the picture, left, top, right, bottom [px], of the areas in
    which nothing is labelled whatever is there (`DontCare`)."""
    table = _Table.read(path, _LABEL, words=("type",))
    table.sorted_frames(n_frames)
    areas = np.array([name == "DontCare" for name in table.words["type"]], dtype=np.bool_)
    return table.column("frame")[areas].astype(np.int64), table.image()[areas]


def read_detections(path: Path, n_frames: int) -> CameraBoxes:
    """The detected cars and vans of a sequence; an empty file holds none."""
    table = _Table.read(path, _DETECTION, words=("type",))
    table.sorted_frames(n_frames)
    return table.objects().boxes("score")


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


def read_bytes(path: Path) -> bytes:
    """A file's content; `KittiError` where it is missing or unreadable."""
    try:
        return path.read_bytes()
    except FileNotFoundError:
        missing = next((p for p in (*path.parents[::-1], path) if not p.exists()), path)
        kind = "file" if missing == path else "folder"
        raise KittiError(f"{missing}: no such {kind}") from None
    except OSError as error:
        raise KittiError(f"{path}: cannot be read: {error.strerror}") from None


def _lines(path: Path) -> list[str]:
    """The lines of a file of plain text; `KittiError` at the first that is none."""
    content = read_bytes(path)
    if content.translate(None, _PLAIN):
        try:
            content.decode("utf-8")
        except UnicodeDecodeError:
            raise KittiError(f"{path}: is not UTF-8 text") from None
        for k, line in enumerate(content.splitlines()):
            if strange := line.translate(None, _PLAIN):
                raise KittiError(
                    f"{path}: line {k + 1}: holds {strange.decode()[0]!a},"
                    " expected ASCII without control characters"
                )
    return content.decode("ascii").splitlines()


@dataclass(frozen=True, eq=False)
class _Table:
    """A file of equally long rows: words by column, and all columns as numbers (0 for words)."""

    path: Path
    names: tuple[str, ...]
    line: IntArray
    words: dict[str, list[str]]
    numbers: FloatArray

    @staticmethod
    def read(path: Path, names: tuple[str, ...], words: tuple[str, ...] = ()) -> "_Table":
        rows = [line.split() for line in _lines(path)]
        for k, row in enumerate(rows):
            if len(row) != len(names):
                raise KittiError(
                    f"{path}: line {k + 1}: {len(row)} columns, expected {len(names)}:"
                    f" {' '.join(names)}"
                )
        found = {}
        for name in words:
            column = names.index(name)
            found[name] = [row[column] for row in rows]
            for row in rows:
                row[column] = "0"
        numbers = _numbers(path, names, rows)
        return _Table(path, names, np.arange(1, len(rows) + 1), found, numbers)

    def column(self, name: str) -> FloatArray:
        return self.numbers[:, self.names.index(name)]

    def refuse(self, bad: BoolArray, name: str, expected: str) -> None:
        """Raise at the first bad row."""
        if bad.any():
            row = int(np.argmax(bad))
            value = self.column(name)[row]
            raise KittiError(
                f"{self.path}: line {self.line[row]}: {name} is {value:g}, expected {expected}"
            )

    def whole(self, name: str, low: int, high: int) -> IntArray:
        """A column of whole numbers from low to high."""
        values = self.column(name)
        bad = (values < low) | (values > high) | (values % 1.0 != 0.0)
        expected = str(low) if low == high else f"a whole number from {low} to {high}"
        self.refuse(bad, name, expected)
        return values.astype(np.int64)

    def sorted_frames(self, n_frames: int) -> None:
        frames = self.whole("frame", 0, n_frames - 1)
        falls = np.zeros(len(frames), dtype=np.bool_)
        falls[1:] = np.diff(frames) < 0
        self.refuse(falls, "frame", "frames in ascending order")

    def objects(self) -> "_Table":
        """The rows of `OBJECTS`."""
        types = self.words["type"]
        for line, name in zip(self.line, types, strict=True):
            if name not in OBJECTS and name not in OTHERS:
                known = ", ".join((*OBJECTS, *OTHERS))
                raise KittiError(
                    f"{self.path}: line {line}: type is {name[:40]!r}, expected one of {known}"
                )
        kept = np.array([name in OBJECTS for name in types], dtype=np.bool_)
        words = {"type": [name for name in types if name in OBJECTS]}
        return _Table(self.path, self.names, self.line[kept], words, self.numbers[kept])

    def image(self) -> FloatArray:
        """Left, top, right, bottom (n, 4) in the picture [px]."""
        return np.column_stack([self.column(name) for name in ("x1", "y1", "x2", "y2")])

    def boxes(self, last: str) -> CameraBoxes:
        for name in "hwl":
            self.refuse(self.column(name) <= 0.0, name, "a size above 0 m")
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


def _numbers(path: Path, names: Sequence[str], rows: list[list[str]]) -> FloatArray:
    """Rows of words as numbers (rows, columns)."""
    words = list(chain.from_iterable(rows))
    try:
        numbers = np.fromiter(map(float, words), np.float64, len(words))
    except ValueError:
        numbers = np.full(len(words), np.nan)
    # Python takes 1_000 for a number, too.
    if not (np.abs(numbers) <= _LARGEST).all() or "_" in "".join(words):
        for k, row in enumerate(rows):
            for name, word in zip(names, row, strict=True):
                if not _is_number(word):
                    raise KittiError(
                        f"{path}: line {k + 1}: {name} is {word[:40]!r}, expected a number"
                    )
    return numbers.reshape(len(rows), len(names))


def _is_number(word: str) -> bool:
    return _NUMBER.fullmatch(word) is not None and abs(float(word)) <= _LARGEST


def _matrix(path: Path, key: str, columns: int, rotates: bool = True) -> FloatArray:
    """The (3, columns) matrix of a calibration file's line `KEY: numbers`; R in front of one that
    rotates."""
    lines = [line.partition(":") for line in _lines(path)]
    found = [k for k, (name, _, _) in enumerate(lines) if name.strip() == key]
    if not found:
        raise KittiError(f"{path}: no line {key}:")
    if len(found) > 1:
        raise KittiError(f"{path}: line {found[1] + 1}: {key} is there twice, expected once")
    words = lines[found[0]][2].split()
    where = f"{path}: line {found[0] + 1}: {key}"
    if len(words) != 3 * columns:
        raise KittiError(f"{where} has {len(words)} numbers, expected {3 * columns}")
    for word in words:
        if not _is_number(word):
            raise KittiError(f"{where} holds {word[:40]!r}, expected numbers")
    matrix = np.array([float(word) for word in words]).reshape(3, columns)
    if rotates and not _is_rotation(matrix[None, :, :3])[0]:
        raise KittiError(f"{where} is no rotation matrix")
    return matrix


def _is_rotation(matrices: FloatArray) -> BoolArray:
    """Whether each of the matrices (n, 3, 3) is a proper rotation, to rounding."""
    product = matrices @ matrices.transpose(0, 2, 1)
    off = np.abs(product - np.eye(3)).max(axis=(1, 2))
    first, second, third = matrices.transpose(1, 0, 2)
    # Not numpy's determinant: it divides by pivots, which may be next to nothing.
    determinant = np.sum(np.cross(first, second) * third, axis=1)
    proper: BoolArray = (off <= _ROTATION_TOLERANCE) & np.greater(determinant, 0.0)
    return proper
