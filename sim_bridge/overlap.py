"""Do any two boxes overlap? Truth in which vehicles drive through each other is no truth."""

import numpy as np
from numba import njit

from mdkf.tables import BoolArray, FloatArray, IntArray


@njit(cache=True)
def first_overlap(frame_start: IntArray, boxes: FloatArray) -> tuple[int, int]:
    """The first two rows of one frame whose boxes overlap on the ground, (-1, -1) if none do.

    frame_start (n_frames + 1,), boxes (rows, 5): x, y [m], yaw [rad], length, width [m].
    Separating axes (Gottschalk et al., 1996); boxes that touch do not overlap.
    """
    reach = np.hypot(boxes[:, 3], boxes[:, 4]) / 2
    for k in range(len(frame_start) - 1):
        for a in range(frame_start[k], frame_start[k + 1]):
            for b in range(a + 1, frame_start[k + 1]):
                if _near(boxes, reach, a, b) and _overlap(boxes[a], boxes[b]):
                    return a, b
    return -1, -1


@njit(cache=True)
def disjoint(
    frame_start: IntArray, boxes: FloatArray, owner: IntArray, precedence: IntArray
) -> BoolArray:
    """Which owners to keep, (owners,), so that no boxes overlap but those of highest precedence.

    frame_start and boxes as for `first_overlap`; owner (rows,): whose box it is; precedence
    (owners,): of two that overlap in any frame the lesser goes, of equals the later.
    """
    kept = np.ones(len(precedence), dtype=np.bool_)
    highest = precedence.max() if len(precedence) else 0
    reach = np.hypot(boxes[:, 3], boxes[:, 4]) / 2
    for k in range(len(frame_start) - 1):
        for a in range(frame_start[k], frame_start[k + 1]):
            for b in range(a + 1, frame_start[k + 1]):
                first, second = min(owner[a], owner[b]), max(owner[a], owner[b])
                goes = first if precedence[first] < precedence[second] else second
                if not (kept[first] and kept[second]) or precedence[goes] == highest:
                    continue
                if _near(boxes, reach, a, b) and _overlap(boxes[a], boxes[b]):
                    kept[goes] = False
    return kept


@njit(cache=True)
def meets_any(
    frame: IntArray, boxes: FloatArray, others_frame: IntArray, others: FloatArray
) -> BoolArray:
    """Which boxes (n, 5), each in its frame (n,), overlap one of the others (m, 5) of that frame;
    boxes as for `first_overlap`."""
    meets = np.zeros(len(boxes), dtype=np.bool_)
    for a in range(len(boxes)):
        for b in range(len(others)):
            if frame[a] == others_frame[b] and _overlap(boxes[a], others[b]):
                meets[a] = True
                break
    return meets


@njit(cache=True)
def _near(boxes: FloatArray, reach: FloatArray, a: int, b: int) -> bool:
    dx, dy = boxes[b, 0] - boxes[a, 0], boxes[b, 1] - boxes[a, 1]
    return bool(dx * dx + dy * dy < (reach[a] + reach[b]) ** 2)


@njit(cache=True)
def _overlap(a: FloatArray, b: FloatArray) -> bool:
    dx, dy = b[0] - a[0], b[1] - a[1]
    for box in (a, b):
        c, s = np.cos(box[2]), np.sin(box[2])
        for ux, uy in ((c, s), (-s, c)):
            extent = _extent(a, ux, uy) + _extent(b, ux, uy)
            if abs(dx * ux + dy * uy) >= extent:
                return False
    return True


@njit(cache=True)
def _extent(box: FloatArray, ux: float, uy: float) -> float:
    """Half the length of a box's shadow on the axis (ux, uy)."""
    c, s = np.cos(box[2]), np.sin(box[2])
    return float(0.5 * (box[3] * abs(c * ux + s * uy) + box[4] * abs(c * uy - s * ux)))
