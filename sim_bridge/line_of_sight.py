"""Turns a sensor position and the boxes of a frame into the exact visible fraction of each box.

Along azimuth theta the line of a wall lies at 1/r(theta) = A cos(theta) + B sin(theta). A ray
enters a box at the last line of the walls that face the sensor (near edge) and leaves it at the
first of the others (far edge). Behind it, a box of top H hides all heights up to its shadow line:

    g(theta) = s + m(theta) r_target(theta),   m = (H - s) / r_near if H >= s, else (H - s) / r_far

A target's silhouette is its near edge from bottom b to top t; the roof does not count, and the
space under a box is closed. With s the sensor's height and M the largest m in front,

    visible = integral of (t - clamp(s + M r_target, b, t)) / (t - b) over theta / angular width

The corners of all boxes cut the circle into cells. Inside the cell between unit directions p1 and
p2 every edge is one linear form, so along p(w) = (1 - w) p1 + w p2 each 1/r and each m is linear
in w: lines of sight compare, cross and meet tops and bottoms like straight lines. Between those
crossings, with f = a cos + b sin, n = c cos + d sin and angles counted from p1,

    integral of f / n = ((ac + bd) theta + (ad - bc) log n) / (c^2 + d^2)
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from sim_bridge.frames import checked_boxes, checked_frames

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Pair = tuple[float, float]
Triple = tuple[float, float, float]

CONTACT = 1e-9  # [m] a sensor this close to a footprint has no silhouette to look at
MIN_OFFSET = 1e-12  # [m] least distance of a wall's line from the sensor: keeps 1/r finite
RESOLUTION = 1e-12  # [rad] narrower cells are all rounding: 1 um at 1000 km

_INNER, _FIRST, _LAST = 0, 1, 2  # what a corner is to its box, counter-clockwise

# Divisions by zero are excluded by construction; checking each of them, and calling the small
# functions of the innermost loop, costs as much as the arithmetic.
_kernel = njit(cache=True, error_model="numpy")
_inlined = njit(cache=True, error_model="numpy", inline="always")


def visible_fraction(sensor: ArrayLike, boxes: ArrayLike) -> Floats:
    """Exact fraction of each box's silhouette that the sensor sees.

    Args:
        sensor: `(3,)` position x, y, z [m].
        boxes: `(n, 7)` x, y, z of the centre [m], yaw [rad], length, width, height [m]. Boxes
            stand upright and should not overlap; where they do, the box with the nearer near
            edge hides the other, and the fractions stay within [0, 1].

    Returns:
        `(n,)` fractions in [0, 1]: 1 in full view, 0 hidden. A box too far away to have any
        angular width counts as hidden.

    Raises:
        ValueError: a wrong shape, or, naming the row: a value that is not finite, a size that is
            not positive, a sensor inside the box's footprint (or touching it).
    """
    position = np.ascontiguousarray(sensor, dtype=np.float64)
    if position.shape != (3,):
        raise ValueError(f"sensor: expected shape (3,), got {position.shape}")
    table = checked_boxes(boxes)
    return visible_fractions(position[None], [0, len(table)], table)


def visible_fractions(sensor: ArrayLike, frame_start: ArrayLike, boxes: ArrayLike) -> Floats:
    """`visible_fraction` for every frame of a trace in one call.

    Args:
        sensor: `(n_frames, 3)` x, y, z of the sensor in each frame [m].
        frame_start: `(n_frames + 1,)` offsets: frame k is `boxes[frame_start[k]:frame_start[k+1]]`.
        boxes: `(rows, 7)` as in `visible_fraction`.

    Returns:
        `(rows,)` fractions in [0, 1].

    Raises:
        ValueError: as `visible_fraction`, or offsets that do not cover the rows in order.
    """
    return _swept(*checked_frames(sensor, frame_start, boxes), sides=False)[0]


def visible_sides(sensor: ArrayLike, frame_start: ArrayLike, boxes: ArrayLike) -> Floats:
    """How far to one side the visible part of each box is, as seen by the sensor.

    Arguments and errors are those of `visible_fractions`.

    Returns:
        `(rows,)` azimuth of the middle of what is visible less that of the middle of the whole
        silhouette [rad], positive to the left; 0 for a box in full view or hidden. Exact where
        boxes hide one another from the ground up; where they are seen one above the other, each
        stretch between two corners counts with its middle.
    """
    return _swept(*checked_frames(sensor, frame_start, boxes), sides=True)[1]


def _swept(positions: Floats, offsets: Ints, table: Floats, sides: bool) -> tuple[Floats, Floats]:
    fractions, offset = np.empty(len(table)), np.zeros(len(table) if sides else 0)
    row = int(_sweep_frames(positions, offsets, table, fractions, offset))
    if row >= 0:
        raise ValueError(
            f"boxes: row {row} has the sensor inside or touching its footprint, so it has no "
            f"silhouette: {table[row].tolist()}"
        )
    return fractions, offset


@_kernel
def _sweep_frames(
    positions: Floats, offsets: Ints, boxes: Floats, fractions: Floats, sides: Floats
) -> int:
    """Fill `fractions`, and `sides` if there is room in it; return the first row that contains
    the sensor, or -1."""
    for frame in range(positions.shape[0]):
        first, last = offsets[frame], offsets[frame + 1]
        bad = _sweep(positions[frame], boxes[first:last], fractions[first:last], sides[first:last])
        if bad >= 0:
            return int(first + bad)
    return -1


@_kernel
def _sweep(sensor: Floats, boxes: Floats, fractions: Floats, sides: Floats) -> int:
    n = boxes.shape[0]
    n_sides = sides.shape[0]
    start = np.empty(n_sides)  # azimuth of a box's first corner [rad]
    corners = np.empty((4 * n, 3))  # azimuth [rad], its cosine and sine
    role = np.empty(4 * n, dtype=np.int64)
    walls = np.empty((n, 5, 2))  # A, B of two facing walls, then of three averted ones
    bounds = np.empty((n, 2))  # least and greatest 1/r of the footprint
    top = np.empty(n)  # above the sensor
    active = np.empty(n, dtype=np.int64)  # the boxes in the current cell, nearest first
    n_active = 0
    for i in range(n):
        top[i] = boxes[i, 2] + 0.5 * boxes[i, 6] - sensor[2]
        heading = (math.cos(boxes[i, 3]), math.sin(boxes[i, 3]))
        if not _place_walls(sensor, boxes, i, heading, walls, bounds):
            return i
        if _place_corners(sensor, boxes, i, heading, corners, role):
            active[n_active] = i
            n_active += 1
        for at in range(4 * i, 4 * i + 4):
            if n_sides > 0 and role[at] == _FIRST:
                start[i] = corners[at, 0]
    order = np.argsort(corners[:, 0])

    seen, width = np.zeros(n), np.zeros(n)  # [rad]
    turned = np.ones(n, dtype=np.bool_)  # passed a corner: other edges may be in view now
    edges = np.empty((n, 4))  # A, B of the near edge and of the far edge
    near = np.empty((n, 2))  # 1/r of the near edge at both ends of the cell
    ridge = np.empty((n, 2))  # m, the slope of the line of sight over the box, there as well
    front = np.empty(n, dtype=np.int64)  # which box hides most in front of each rank
    for k in range(4 * n):
        here, there = order[k], order[(k + 1) % (4 * n)]
        box = here // 4
        turned[box] = True
        if role[here] == _FIRST:
            active[n_active] = box
            n_active += 1
        elif role[here] == _LAST:
            n_active = _remove(active, n_active, box)
        span = corners[there, 0] - corners[here, 0] + (math.tau if k + 1 == 4 * n else 0.0)
        if n_active == 0 or span < RESOLUTION:
            continue
        x1, y1 = corners[here, 1], corners[here, 2]
        x2, y2 = corners[there, 1], corners[there, 2]
        cell = (span, x1 * x2 + y1 * y2, x1 * y2 - y1 * x2)  # its angle, cosine and sine
        for rank in range(n_active):
            i = active[rank]
            width[i] += span
            if turned[i]:
                _choose_edges(walls, i, x1 + x2, y1 + y2, edges)
                turned[i] = False
            near[i, 0] = _inverse_range(edges, bounds, i, 0, x1, y1)
            near[i, 1] = _inverse_range(edges, bounds, i, 0, x2, y2)
            _insert_by_depth(active, rank, near)
            edge = 2 if top[i] < 0.0 else 0  # seen from above, the far edge hides most
            ridge[i, 0] = top[i] * _inverse_range(edges, bounds, i, edge, x1, y1)
            ridge[i, 1] = top[i] * _inverse_range(edges, bounds, i, edge, x2, y2)
        left = 0.0
        while left < 1.0:
            right = _rank_shadows(active, n_active, ridge, left, front)
            begin, end = _angle(left, cell), _angle(right, cell)
            for rank in range(n_active):
                i, j = active[rank], front[rank]
                share = end - begin
                if rank > 0:
                    shadow, ends = (ridge[j, 0], ridge[j, 1]), (near[i, 0], near[i, 1])
                    share = _seen_angle(shadow, ends, top[i], boxes[i, 6], left, right, cell)
                seen[i] += share
                if n_sides > 0:
                    since = corners[here, 0] - start[i]
                    since += math.tau if since < 0.0 else 0.0
                    sides[i] += share * (since + 0.5 * (begin + end))
            left = right
    for i in range(n_sides):
        sides[i] = sides[i] / seen[i] - 0.5 * width[i] if seen[i] > 0.0 else 0.0
    for i in range(n):
        fractions[i] = min(max(seen[i] / width[i], 0.0), 1.0) if width[i] > 0.0 else 0.0
    return -1


@_kernel
def _place_walls(
    sensor: Floats, boxes: Floats, i: int, heading: Pair, walls: Floats, bounds: Floats
) -> bool:
    """Linear forms of the walls as seen from the sensor; False if it stands in the footprint."""
    cosine, sine = heading
    dx, dy = sensor[0] - boxes[i, 0], sensor[1] - boxes[i, 1]
    u, v = cosine * dx + sine * dy, cosine * dy - sine * dx
    half_u, half_v = 0.5 * boxes[i, 4], 0.5 * boxes[i, 5]
    nearest = math.hypot(max(abs(u) - half_u, 0.0), max(abs(v) - half_v, 0.0))
    if nearest <= CONTACT:
        return False
    farthest = math.hypot(abs(u) + half_u, abs(v) + half_v)
    bounds[i, 0], bounds[i, 1] = 1.0 / farthest, 1.0 / nearest
    facing, averted = 0, 2
    for offset, half, ex, ey in (
        (u, half_u, cosine, sine),
        (-u, half_u, -cosine, -sine),
        (v, half_v, -sine, cosine),
        (-v, half_v, sine, -cosine),
    ):
        away = half - offset  # from the sensor outwards to the wall's line
        if away < 0.0:
            slot, away = facing, min(away, -MIN_OFFSET)
            facing += 1
        else:
            slot, away = averted, max(away, MIN_OFFSET)
            averted += 1
        walls[i, slot, 0], walls[i, slot, 1] = ex / away, ey / away
    # Either two walls face the sensor and two do not, or one and three: repeat the missing one.
    missing, given = (1, 0) if facing == 1 else (4, 3)
    walls[i, missing] = walls[i, given]
    return True


@_kernel
def _place_corners(
    sensor: Floats, boxes: Floats, i: int, heading: Pair, corners: Floats, role: Ints
) -> bool:
    """Azimuth, direction and role of the corners of box i; True if it spans the cut at +-pi."""
    cosine, sine = heading
    dx, dy = boxes[i, 0] - sensor[0], boxes[i, 1] - sensor[1]
    half_u, half_v = 0.5 * boxes[i, 4], 0.5 * boxes[i, 5]
    first = last = 4 * i
    for k in range(4):
        along = half_u if k % 2 == 0 else -half_u
        across = half_v if k < 2 else -half_v
        x = dx + cosine * along - sine * across
        y = dy + sine * along + cosine * across
        distance = math.hypot(x, y)
        x, y = x / distance, y / distance
        at = 4 * i + k
        corners[at, 0], corners[at, 1], corners[at, 2] = math.atan2(y, x), x, y
        role[at] = _INNER
        # A box spans less than pi, so the sign of the cross product orders its corners.
        if corners[first, 1] * y - corners[first, 2] * x < 0.0:
            first = at
        if corners[last, 1] * y - corners[last, 2] * x > 0.0:
            last = at
    spans_cut = bool(corners[first, 0] - corners[last, 0] > math.pi)
    if spans_cut or corners[first, 0] < corners[last, 0]:  # else rounding has left no width
        role[first], role[last] = _FIRST, _LAST
    return spans_cut


@_kernel
def _remove(active: Ints, n_active: int, box: int) -> int:
    kept = 0
    for k in range(n_active):
        if active[k] != box:
            active[kept] = active[k]
            kept += 1
    return kept


@_inlined
def _choose_edges(walls: Floats, i: int, x: float, y: float, edges: Floats) -> None:
    """The walls through which the direction x, y enters and leaves box i."""
    enter, leave = 0, 2
    if walls[i, 1, 0] * x + walls[i, 1, 1] * y < walls[i, 0, 0] * x + walls[i, 0, 1] * y:
        enter = 1
    best = walls[i, 2, 0] * x + walls[i, 2, 1] * y
    for k in range(3, 5):
        value = walls[i, k, 0] * x + walls[i, k, 1] * y
        if value > best:
            leave, best = k, value
    edges[i, 0], edges[i, 1] = walls[i, enter, 0], walls[i, enter, 1]
    edges[i, 2], edges[i, 3] = walls[i, leave, 0], walls[i, leave, 1]


@_inlined
def _inverse_range(edges: Floats, bounds: Floats, i: int, at: int, x: float, y: float) -> float:
    """1/r of an edge; the bounds take out what rounding does to walls in line with the sensor."""
    return float(min(max(edges[i, at] * x + edges[i, at + 1] * y, bounds[i, 0]), bounds[i, 1]))


@_inlined
def _insert_by_depth(active: Ints, rank: int, near: Floats) -> None:
    """Move `active[rank]` forward to its place among the nearer ones, by 1/r in mid-cell."""
    box = active[rank]
    key = near[box, 0] + near[box, 1]
    while rank > 0 and near[active[rank - 1], 0] + near[active[rank - 1], 1] < key:
        active[rank] = active[rank - 1]
        rank -= 1
    active[rank] = box


@_inlined
def _rank_shadows(active: Ints, n_active: int, ridge: Floats, left: float, front: Ints) -> float:
    """Fill `front`; return how far beyond w = left it holds, for at a crossing it changes."""
    right = 1.0
    best = active[0]
    for rank in range(n_active):
        i = active[rank]
        front[rank] = best
        gap1, gap2 = ridge[i, 0] - ridge[best, 0], ridge[i, 1] - ridge[best, 1]
        gap_left = (1.0 - left) * gap1 + left * gap2
        gap_right = (1.0 - right) * gap1 + right * gap2
        if gap_left * gap_right < 0.0:
            cross = left + (right - left) * gap_left / (gap_left - gap_right)
            if left + RESOLUTION < cross < right:
                right, gap_right = cross, 0.0
        if gap_left + gap_right > 0.0:
            best = i
    return right


@_inlined
def _seen_angle(
    shadow: Pair, near: Pair, top: float, height: float, left: float, right: float, cell: Triple
) -> float:
    """Integral of a target's visible share over [left, right] [rad], heights from the sensor."""
    bottom = top - height
    over1, over2 = shadow[0] - top * near[0], shadow[1] - top * near[1]
    if over1 >= 0.0 and over2 >= 0.0:
        return 0.0
    under1, under2 = shadow[0] - bottom * near[0], shadow[1] - bottom * near[1]
    cut1, cut2 = _root(over1, over2, left, right), _root(under1, under2, left, right)
    if cut1 > cut2:
        cut1, cut2 = cut2, cut1
    seen = 0.0
    for a, b in ((left, cut1), (cut1, cut2), (cut2, right)):
        middle = 0.5 * (a + b)
        if b <= a or (1.0 - middle) * over1 + middle * over2 >= 0.0:
            continue
        share = _angle(b, cell) - _angle(a, cell)
        if (1.0 - middle) * under1 + middle * under2 > 0.0:
            dark = _ratio_integral(shadow, near, a, b, share, cell)
            share = min(max((top * share - dark) / height, 0.0), share)
        seen += share
    return seen


@_kernel
def _root(end1: float, end2: float, a: float, b: float) -> float:
    """Where the line from end1 at 0 to end2 at 1 changes sign within [a, b]; a if nowhere."""
    if (end1 < 0.0) == (end2 < 0.0):
        return a
    return min(max(end1 / (end1 - end2), a), b)


@_kernel
def _angle(w: float, cell: Triple) -> float:
    """Angle of (1 - w) p1 + w p2 from p1 [rad]."""
    span, cosine, sine = cell
    if w == 0.0 or w == 1.0:
        return w * span
    return math.atan2(w * sine, 1.0 - w + w * cosine)


@_kernel
def _ratio_integral(
    shadow: Pair, near: Pair, left: float, right: float, share: float, cell: Triple
) -> float:
    """Integral of f / n over the angle `share` from w = left to right, f and n by their ends."""
    (f1, f2), (n1, n2) = shadow, near
    _, cosine, sine = cell
    a, q = f1 / n1, n2 / n1  # n is scaled to c = 1
    b = (f2 / n1 - a * cosine) / sine
    d = (q - cosine) / sine
    ratio = q
    if left > 0.0 or right < 1.0:
        shrink = 2.0 * (1.0 - cosine)  # |p(w)|^2 = 1 - w (1 - w) shrink
        norms = (1.0 - left * (1.0 - left) * shrink) / (1.0 - right * (1.0 - right) * shrink)
        ratio = (1.0 + (q - 1.0) * right) / (1.0 + (q - 1.0) * left) * math.sqrt(norms)
    return ((a + b * d) * share + (a * d - b) * math.log(ratio)) / (1.0 + d * d)
