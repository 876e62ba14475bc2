"""Boxes into similarities: of every box of a set with every box of another, frame by frame.

    centre  max(0, 1 - d / scale) of the bird's-eye distance d
    bird    intersection over union of rotated rectangles, seen from above
    box     intersection over union of upright rotated boxes, in space
    image   intersection over union of axis-aligned rectangles in an image

The area that rectangles a and b share is an integral along the edges of b (Green's theorem): in the
frame of a, which is |x| <= A, |y| <= B,

    |a and b| = - integral of clip(y, -B, B) dx over the part |x| <= A of b's boundary

counter-clockwise. No corner of the intersection is ever computed, so parallel edges are no special
case; and coordinates are relative to a, so boxes far from the origin lose nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

Similarity = Literal["centre", "bird", "box", "image"]

COLUMNS: Mapping[Similarity, tuple[str, ...]] = MappingProxyType(
    {
        "centre": ("x", "y"),
        "bird": ("x", "y", "yaw", "length", "width"),
        "box": ("x", "y", "z", "yaw", "length", "width", "height"),
        "image": ("left", "top", "right", "bottom"),
    }
)
"""What a row holds for each similarity: [m], yaw [rad], of the box centre; in an image [px]."""

CENTRE_SCALE = 2.0
"""Distance [m] at which two centres stop being similar: 1 m apart is similarity 0.5."""


class Pairs(NamedTuple):
    """The similar ones of all pairs of rows (a, b) that share a frame.

    Row r of a is similar to the rows `row[start[r] : start[r + 1]]` of b, rising, by so much each;
    to no other.

    Attributes:
        start: (n_rows_of_a + 1,) offsets into the other two.
        row: (n_pairs,) row of b.
        similarity: (n_pairs,).
    """

    start: Ints
    row: Ints
    similarity: Floats


_SIZES = frozenset({"length", "width", "height"})
_CENTRE, _BIRD, _BOX, _IMAGE, _COVERAGE = range(5)
_CODES: Mapping[Similarity, int] = MappingProxyType(
    {"centre": _CENTRE, "bird": _BIRD, "box": _BOX, "image": _IMAGE}
)

_EPSILON = float(np.finfo(np.float64).eps)
"""An area in an image [px^2] up to which TrackEval takes a box for empty."""


def centre_similarity(a: ArrayLike, b: ArrayLike) -> Floats:
    """max(0, 1 - d / 2 m) (n, m) of the distance d of centres.

    Args:
        a: (n, 2) x, y [m] of the centre.
        b: (m, 2) likewise.

    Raises:
        ValueError: another shape, or a row that is not finite.
    """
    return _matrix(_CENTRE, as_boxes("a", a, "centre"), as_boxes("b", b, "centre"))


def bird_iou(a: ArrayLike, b: ArrayLike) -> Floats:
    """Bird's-eye intersection over union (n, m) of rotated rectangles; 0 for an empty one.

    Args:
        a: (n, 5) x, y [m] of the centre, yaw [rad], length, width [m].
        b: (m, 5) likewise.

    Raises:
        ValueError: another shape, or a row that is not finite or has a negative size.
    """
    return _matrix(_BIRD, as_boxes("a", a, "bird"), as_boxes("b", b, "bird"))


def box_iou(a: ArrayLike, b: ArrayLike) -> Floats:
    """Intersection over union (n, m) of upright rotated boxes in space; 0 for an empty one.

    Args:
        a: (n, 7) x, y, z [m] of the centre, yaw [rad], length, width, height [m].
        b: (m, 7) likewise.

    Raises:
        ValueError: another shape, or a row that is not finite or has a negative size.
    """
    return _matrix(_BOX, as_boxes("a", a, "box"), as_boxes("b", b, "box"))


def image_iou(a: ArrayLike, b: ArrayLike) -> Floats:
    """Intersection over union (n, m) in an image, to the last bit that of TrackEval.

    Args:
        a: (n, 4) left, top, right, bottom [px]; empty if right <= left or bottom <= top.
        b: (m, 4) likewise.

    Raises:
        ValueError: another shape, or a row that is not finite.
    """
    return _matrix(_IMAGE, as_boxes("a", a, "image"), as_boxes("b", b, "image"))


def image_coverage(a: ArrayLike, b: ArrayLike) -> Floats:
    """Fraction (n, m) of each box of `a` inside each box of `b`, to the last bit TrackEval's.

    Arguments and errors are those of `image_iou`; an empty box is covered by none.
    """
    return _matrix(_COVERAGE, as_boxes("a", a, "image"), as_boxes("b", b, "image"))


def as_boxes(
    name: str,
    rows: ArrayLike,
    similarity: Similarity,
    row: Callable[[int], str] = "row {}".format,
) -> Floats:
    """Rows as the contiguous float64 array (n, len(COLUMNS[similarity])) that the kernels take.

    Raises:
        ValueError: an unknown similarity, another shape, or a row that is not finite or has a
            negative size; naming `name`, the row as `row` calls it, the column, what was expected.
    """
    if similarity not in COLUMNS:
        raise ValueError(f"unknown similarity {similarity!r}: expected one of {', '.join(COLUMNS)}")
    columns = COLUMNS[similarity]
    boxes = np.ascontiguousarray(rows, dtype=np.float64)
    if boxes.shape == (0,):
        boxes = boxes.reshape(0, len(columns))
    if boxes.ndim != 2 or boxes.shape[1] != len(columns):
        raise ValueError(
            f"{name}: boxes of shape {boxes.shape}, expected (n, {len(columns)}) for similarity "
            f"{similarity}: {', '.join(columns)}"
        )
    wrong = ~np.isfinite(boxes)
    for at, column in enumerate(columns):
        if column in _SIZES:
            wrong[:, at] |= boxes[:, at] < 0.0
    if wrong.any():
        bad, at = np.argwhere(wrong)[0].tolist()
        expected = "a finite size of at least 0" if columns[at] in _SIZES else "a finite number"
        raise ValueError(
            f"{name}: {row(bad)} has {columns[at]} {boxes[bad, at]}, expected {expected}"
        )
    return boxes


def similar_pairs(
    similarity: Similarity,
    truth_start: Ints,
    truth: Floats,
    track_start: Ints,
    track: Floats,
    scale: float = CENTRE_SCALE,
) -> Pairs:
    """The pairs of truth and track rows of one frame whose similarity is above 0.

    Args:
        similarity: which one.
        truth_start: (n_frames + 1,) offsets of the frames into `truth`.
        truth: rows made by `as_boxes`.
        track_start, track: likewise.
        scale: of `centre` alone: distance [m] from which the similarity is 0.
    """
    return Pairs(*_pairs(_CODES[similarity], truth_start, truth, track_start, track, scale))


def _matrix(code: int, a: Floats, b: Floats) -> Floats:
    start, column, similarity = _pairs(
        code, np.array([0, len(a)]), a, np.array([0, len(b)]), b, CENTRE_SCALE
    )
    matrix = np.zeros((len(a), len(b)))
    matrix[np.repeat(np.arange(len(a)), np.diff(start)), column] = similarity
    return matrix


@njit(cache=True, error_model="numpy")
def _pairs(
    code: int, a_start: Ints, a: Floats, b_start: Ints, b: Floats, scale: float
) -> tuple[Ints, Ints, Floats]:
    start = np.zeros(len(a) + 1, np.int64)
    row, similarity = np.empty(0, np.int64), np.empty(0)
    in_image = code in (_IMAGE, _COVERAGE)
    radius_a, radius_b = _radius(code, a, scale), _radius(code, b, scale)
    n = 0
    for frame in range(len(a_start) - 1):
        first, last = b_start[frame], b_start[frame + 1]
        for i in range(a_start[frame], a_start[frame + 1]):
            if n + last - first > len(row):
                room = 2 * len(row) + last - first
                row, similarity = _resized(row, n, room), _resized(similarity, n, room)
            for j in range(first, last):
                if in_image:
                    near = a[i, 0] < b[j, 2] and b[j, 0] < a[i, 2]
                    near = near and a[i, 1] < b[j, 3] and b[j, 1] < a[i, 3]
                else:
                    dx, dy = b[j, 0] - a[i, 0], b[j, 1] - a[i, 1]
                    reach = radius_a[i] + radius_b[j]
                    near = dx * dx + dy * dy < reach * reach
                if near:
                    value = _similarity(code, a[i], b[j], scale)
                    if value > 0.0:
                        row[n], similarity[n] = j, value
                        n += 1
            start[i + 1] = n
    return start, _resized(row, n, n), _resized(similarity, n, n)


@njit(cache=True)
def _resized(values: NDArray[Any], n: int, room: int) -> NDArray[Any]:
    """The first `n` values in an array that has room for `room`."""
    result = np.empty(room, values.dtype)
    result[:n] = values[:n]
    return result


@njit(cache=True, error_model="numpy")
def _radius(code: int, boxes: Floats, scale: float) -> Floats:
    """(n,) rows on the ground that are not closer than their radii together have nothing in common.

    In an image none is needed: the borders tell as much.
    """
    if code == _CENTRE:
        return np.full(len(boxes), scale / 2)
    if code == _BIRD:
        return np.hypot(boxes[:, 3], boxes[:, 4]) / 2
    if code == _BOX:
        return np.hypot(boxes[:, 4], boxes[:, 5]) / 2
    return np.zeros(0)


@njit(cache=True, error_model="numpy")
def _similarity(code: int, a: Floats, b: Floats, scale: float) -> float:
    if code == _CENTRE:
        return _centre(a, b, scale)
    if code == _BIRD:
        return _bird(a, b)
    if code == _BOX:
        return _box(a, b)
    return _image(a, b) if code == _IMAGE else _image_coverage(a, b)


@njit(cache=True, error_model="numpy")
def _centre(a: Floats, b: Floats, scale: float) -> float:
    dx, dy = a[0] - b[0], a[1] - b[1]
    return max(0.0, 1.0 - math.sqrt(dx * dx + dy * dy) / scale)


@njit(cache=True, error_model="numpy")
def _bird(a: Floats, b: Floats) -> float:
    area_a, area_b = a[3] * a[4], b[3] * b[4]
    common = _common_area(b[0] - a[0], b[1] - a[1], a[2], b[2], a[3], a[4], b[3], b[4])
    return common / (area_a + area_b - common) if common > 0.0 else 0.0


@njit(cache=True, error_model="numpy")
def _box(a: Floats, b: Floats) -> float:
    dz = b[2] - a[2]
    height = min(a[6] / 2, dz + b[6] / 2) - max(-a[6] / 2, dz - b[6] / 2)
    if height <= 0.0:
        return 0.0
    common = height * _common_area(b[0] - a[0], b[1] - a[1], a[3], b[3], a[4], a[5], b[4], b[5])
    volume_a, volume_b = a[6] * (a[4] * a[5]), b[6] * (b[4] * b[5])
    common = min(common, volume_a, volume_b)
    return common / (volume_a + volume_b - common) if common > 0.0 else 0.0


@njit(cache=True, error_model="numpy")
def _image(a: Floats, b: Floats) -> float:
    area_a, area_b = (a[2] - a[0]) * (a[3] - a[1]), (b[2] - b[0]) * (b[3] - b[1])
    common = _common_area_in_image(a, b)
    union = area_a + area_b - common
    if area_a <= _EPSILON or area_b <= _EPSILON or union <= _EPSILON:
        return 0.0
    return float(common / union)


@njit(cache=True, error_model="numpy")
def _image_coverage(a: Floats, b: Floats) -> float:
    area = (a[2] - a[0]) * (a[3] - a[1])
    return float(_common_area_in_image(a, b) / area) if area > _EPSILON else 0.0


@njit(cache=True, error_model="numpy")
def _common_area_in_image(a: Floats, b: Floats) -> float:
    width = max(min(a[2], b[2]) - max(a[0], b[0]), 0.0)
    height = max(min(a[3], b[3]) - max(a[1], b[1]), 0.0)
    return float(width * height)


@njit(cache=True, error_model="numpy")
def _common_area(
    dx: float,
    dy: float,
    yaw_a: float,
    yaw_b: float,
    length_a: float,
    width_a: float,
    length_b: float,
    width_b: float,
) -> float:
    """Area that rectangle a shares with rectangle b, whose centre is (dx, dy) from that of a."""
    cos, sin = math.cos(yaw_a), math.sin(yaw_a)
    x, y = cos * dx + sin * dy, cos * dy - sin * dx
    # The difference of the yaws, not of their sines: boxes of equal yaw are exactly parallel.
    cos, sin = math.cos(yaw_b - yaw_a), math.sin(yaw_b - yaw_a)
    along_x, along_y = cos * length_b / 2, sin * length_b / 2
    across_x, across_y = -sin * width_b / 2, cos * width_b / 2
    front_right_x, front_right_y = x + along_x - across_x, y + along_y - across_y
    front_left_x, front_left_y = x + along_x + across_x, y + along_y + across_y
    rear_left_x, rear_left_y = x - along_x + across_x, y - along_y + across_y
    rear_right_x, rear_right_y = x - along_x - across_x, y - along_y - across_y
    A, B = length_a / 2, width_a / 2
    area = (
        _below(front_left_x, front_left_y, rear_left_x, rear_left_y, A, B)
        + _below(front_right_x, front_right_y, front_left_x, front_left_y, A, B)
        + _below(rear_left_x, rear_left_y, rear_right_x, rear_right_y, A, B)
        + _below(rear_right_x, rear_right_y, front_right_x, front_right_y, A, B)
    )
    return max(0.0, min(-area, length_a * width_a, length_b * width_b))


@njit(cache=True, error_model="numpy")
def _below(x0: float, y0: float, x1: float, y1: float, A: float, B: float) -> float:
    """Integral of clip(y, -B, B) dx along the edge from (x0, y0) to (x1, y1), inside |x| <= A."""
    begin, end = min(max(x0, -A), A), min(max(x1, -A), A)
    if begin == end:
        return 0.0
    y_begin = y0 + (begin - x0) / (x1 - x0) * (y1 - y0)
    y_end = y1 + (end - x1) / (x1 - x0) * (y1 - y0)
    first, last = min(max(y_begin, -B), B), min(max(y_end, -B), B)
    height = first + last  # twice the mean
    if first != last:
        # The parts outside the strip count with its border, by their share of the edge.
        height += (first - last) * (height - (y_begin + y_end)) / (y_end - y_begin)
    return 0.5 * height * (end - begin)
