"""Turns a sensor position and the boxes of a frame into each box's number of LiDAR returns.

A spinning LiDAR sends `beams` beams along each of `rays` azimuths, and a beam returns from the
first box it meets. Along azimuth theta the line of a wall lies at 1/r = A cos(theta) +
B sin(theta); a ray enters a box at the last line of the walls that face the sensor and leaves it
at the first of the others. With b, t the heights of bottom and top above the sensor, the box
meets the beams of slope (the tangent of the elevation)

    min(b / r_enter, b / r_leave) <= slope < max(t / r_enter, t / r_leave)

which includes a roof seen from above. Rays are swept around the circle. On each, the boxes it may
meet are put in order of distance and hide one another beam by beam, in the bits of one word:

    seen = interval & ~covered;  count += ones(seen);  covered |= interval

The order is sorted anew on every ray, for no order of whole boxes is right on all of them: three
long boxes can stand around the sensor so that each is behind the next. From one ray to its
neighbour it hardly ever changes, and keeping it costs one comparison per box.
"""

import math
from typing import Any

import numpy as np
from numba import types
from numba.extending import intrinsic, overload
from numpy.typing import ArrayLike, NDArray

from mdkf.compiled import allocating, inlined, kernel
from mdkf.tables import BoolArray, FloatArray, IntArray
from sim_bridge.frames import checked_frames
from sim_bridge.lidar import HDL_64E, Lidar, Words, fan
from sim_bridge.line_of_sight import CONTACT, MIN_OFFSET

Boxes = NDArray[np.uint32]

HIGHEST = 1e100  # [m] heights are cut here, far from overflow
ZERO = np.uint64(0)
GRACE = 2  # rays from where a box is expected to begin, within which it does

# What a ray needs of a box: A, B of two walls that it enters through, then of three that it leaves
# through [1/m], a missing one repeated; bottom and top above the sensor [m]; 1 / r_leave on the
# present ray [1/m]; y of the outermost corners from the sensor [m].
BOTTOM, TOP, LEAVE, RIGHT_Y, LEFT_Y = 10, 11, 12, 13, 14
VIEW_COLUMNS = 15


def point_counts(
    sensor: ArrayLike, frame_start: ArrayLike, boxes: ArrayLike, lidar: Lidar = HDL_64E
) -> IntArray:
    """Number of LiDAR returns from each box in every frame of a trace.

    Args:
        sensor: `(n_frames, 3)` x, y, z of the sensor in each frame [m].
        frame_start: `(n_frames + 1,)` offsets: frame k is `boxes[frame_start[k]:frame_start[k+1]]`.
        boxes: `(rows, 7)` x, y, z of the centre [m], yaw [rad], length, width, height [m]. Boxes
            are solid, stand upright and should not overlap; where they do, a ray meets the one
            whose footprint it enters first, and of two entered at once the one of the lower row.
        lidar: the rays and beams.

    Returns:
        `(rows,)` counts, at least 0.

    Raises:
        ValueError: a wrong shape, offsets that do not cover the rows in order, or, naming the row:
            a value that is not finite, a size that is not positive, a sensor inside the box's
            footprint (or touching it).
    """
    positions, offsets, table = checked_frames(sensor, frame_start, boxes)
    counts = np.zeros(len(table), dtype=np.int64)
    row = int(_count_frames(positions, offsets, table, *fan(lidar), 1.0 / lidar.max_range, counts))
    _refuse_sensor_inside(row, table)
    return counts


def lone_point_counts(
    sensor: ArrayLike, frame_start: ArrayLike, boxes: ArrayLike, lidar: Lidar = HDL_64E
) -> IntArray:
    """Number of LiDAR returns that each box would give were nothing in front of it.

    Arguments, result and errors are those of `point_counts`, which equals this for a box alone.
    """
    positions, offsets, table = checked_frames(sensor, frame_start, boxes)
    counts = np.zeros(len(table), dtype=np.int64)
    row = int(_count_alone(positions, offsets, table, *fan(lidar), 1.0 / lidar.max_range, counts))
    _refuse_sensor_inside(row, table)
    return counts


def _refuse_sensor_inside(row: int, table: FloatArray) -> None:
    if row >= 0:
        raise ValueError(
            f"boxes: row {row} has the sensor inside or touching its footprint, so no ray can "
            f"enter it: {table[row].tolist()}"
        )


@allocating
def _count_frames(
    positions: FloatArray,
    offsets: IntArray,
    boxes: FloatArray,
    rays: FloatArray,
    within: FloatArray,
    below: Words,
    scale: float,
    shift: float,
    nearest: float,
    counts: IntArray,
) -> int:
    """Add the returns to `counts`; return the first row that contains the sensor, or -1."""
    most = 0
    for frame in range(positions.shape[0]):
        most = max(most, offsets[frame + 1] - offsets[frame])
    views = np.empty((most, VIEW_COLUMNS))
    across = np.empty(most, dtype=np.bool_)  # is the box on both sides of the cut at +-pi?
    # Boxes by their first ray: starting[ray] is one of them, following[box] the next, -1 none.
    starting = np.full(rays.shape[0], -1, dtype=np.int64)
    following = np.empty(most, dtype=np.int64)
    for frame in range(positions.shape[0]):
        first, last = offsets[frame], offsets[frame + 1]
        for row in range(first, last):
            i = row - first
            ray = _place(positions[frame], boxes[row], rays.shape[0], views[i])
            if ray < 0:
                return int(row)
            across[i] = ray > 0 and views[i, RIGHT_Y] >= 0.0 > views[i, LEFT_Y]
            following[i] = starting[ray]
            starting[ray] = i
        _sweep(
            views, across[: last - first], starting, following,
            rays, within, below, scale, shift, nearest, counts[first:last],
        )  # fmt: skip
    return -1


@allocating
def _count_alone(
    positions: FloatArray,
    offsets: IntArray,
    boxes: FloatArray,
    rays: FloatArray,
    within: FloatArray,
    below: Words,
    scale: float,
    shift: float,
    nearest: float,
    counts: IntArray,
) -> int:
    """Fill `counts`, each box by the rays that meet it; return as `_count_frames`."""
    views = np.empty((1, VIEW_COLUMNS))
    for frame in range(positions.shape[0]):
        for row in range(offsets[frame], offsets[frame + 1]):
            first = _place(positions[frame], boxes[row], rays.shape[0], views[0])
            if first < 0:
                return int(row)
            for step in range(rays.shape[0]):
                ray = (first + step) % rays.shape[0]
                enter, leave = _chord(views, np.uint32(0), rays[ray, 0], rays[ray, 1])
                if enter > leave:
                    if enter >= nearest:
                        interval = _interval(
                            views, np.uint32(0), enter, leave, within, below, scale, shift
                        )
                        counts[row] += _ones(interval)
                elif step >= GRACE:
                    break
    return -1


@kernel
def _place(sensor: FloatArray, box: FloatArray, n_rays: int, view: FloatArray) -> int:
    """Fill the view of a box; return a ray at or just before its first, -1 if the sensor is in it.

    Whether a ray meets the box, its walls decide; the first ray only says when to begin.
    """
    cosine, sine = math.cos(box[3]), math.sin(box[3])
    dx, dy = box[0] - sensor[0], box[1] - sensor[1]
    half_u, half_v = 0.5 * box[4], 0.5 * box[5]
    u, v = cosine * dx + sine * dy, cosine * dy - sine * dx
    # Turn the axes of the box to point away from the sensor: the near walls' lines are at
    # u - half_u and v - half_v along them, those of the far walls at u + half_u and v + half_v.
    side_u, side_v = math.copysign(1.0, u), math.copysign(1.0, v)
    ux, uy, vx, vy = side_u * cosine, side_u * sine, -side_v * sine, side_v * cosine
    near_u, near_v = abs(u) - half_u, abs(v) - half_v
    apart_u, apart_v = max(near_u, 0.0), max(near_v, 0.0)
    if apart_u * apart_u + apart_v * apart_v <= CONTACT * CONTACT:
        return -1
    far_u, far_v = max(abs(u) + half_u, MIN_OFFSET), max(abs(v) + half_v, MIN_OFFSET)
    view[4], view[5], view[6], view[7] = ux / far_u, uy / far_u, vx / far_v, vy / far_v
    # Rays enter through a near wall unless the sensor is on the inner side of its line.
    if near_u > 0.0:
        away = max(near_u, MIN_OFFSET)
        view[0], view[1] = ux / away, uy / away
    if near_v > 0.0:
        away = max(near_v, MIN_OFFSET)
        view[2], view[3] = vx / away, vy / away
    view[8], view[9] = view[4], view[5]
    if near_u <= 0.0:
        away = min(near_u, -MIN_OFFSET)
        view[0], view[1] = view[2], view[3]
        view[8], view[9] = ux / away, uy / away
    elif near_v <= 0.0:
        away = min(near_v, -MIN_OFFSET)
        view[2], view[3] = view[0], view[1]
        view[8], view[9] = vx / away, vy / away
    middle = box[2] - sensor[2]
    view[BOTTOM] = min(max(middle - 0.5 * box[6], -HIGHEST), HIGHEST)
    view[TOP] = min(max(middle + 0.5 * box[6], -HIGHEST), HIGHEST)

    # The outermost corners end the near walls that rays enter through; a box spans less than pi,
    # so the cross product tells right from left.
    along, across = -half_u, half_v if near_u > 0.0 else -half_v
    right_x, right_y = dx + along * ux + across * vx, dy + along * uy + across * vy
    along, across = half_u if near_v > 0.0 else -half_u, -half_v
    left_x, left_y = dx + along * ux + across * vx, dy + along * uy + across * vy
    if right_x * left_y - right_y * left_x < 0.0:
        right_x, right_y, left_x, left_y = left_x, left_y, right_x, right_y
    view[RIGHT_Y], view[LEFT_Y] = right_y, left_y
    ray = math.floor((math.atan2(right_y, right_x) + math.pi) * (n_rays / math.tau) - 0.5)
    return int(min(max(ray, 0), n_rays - 1))


@allocating
def _sweep(
    views: FloatArray,
    across: BoolArray,
    starting: IntArray,
    following: IntArray,
    rays: FloatArray,
    within: FloatArray,
    below: Words,
    scale: float,
    shift: float,
    nearest: float,
    counts: IntArray,
) -> None:
    """One turn over the boxes of a frame; empties `starting`."""
    n = across.shape[0]
    # Unsigned, for numba would allow for a negative index wherever it is used.
    active: Boxes = np.empty(n, dtype=np.uint32)  # the boxes that the ray may meet, nearest first
    depth = np.empty(n)  # 1 / r_enter of each of them, 0 where the ray misses [1/m]
    grace = np.empty(n, dtype=np.int64)  # by box, the ray from which on a miss means it is passed
    n_active = 0
    for box in range(n):
        if across[box]:  # begins on the turn's last rays and goes on here, on the first
            grace[box] = GRACE
            active[n_active] = box
            n_active += 1
    for ray in range(rays.shape[0]):
        box = starting[ray]
        if box >= 0:
            starting[ray] = -1
            while box >= 0:
                grace[box] = ray + GRACE
                active[n_active] = box
                n_active += 1
                box = following[box]
        x, y = rays[ray, 0], rays[ray, 1]
        kept = 0
        for rank in range(n_active):
            i = active[rank]
            enter, leave = _chord(views, i, x, y)
            views[i, LEAVE] = leave
            if enter > leave:
                _insert(active, depth, kept, i, enter)
                kept += 1
            elif ray < grace[i]:
                _insert(active, depth, kept, i, 0.0)
                kept += 1
        n_active = kept
        covered = ZERO
        for rank in range(n_active):
            enter = depth[rank]
            if enter < nearest:
                break  # beyond the range, or missed, as are all that follow
            i = active[rank]
            interval = _interval(views, i, enter, views[i, LEAVE], within, below, scale, shift)
            counts[i] += _ones(interval & ~covered)
            covered |= interval


@inlined
def _chord(views: FloatArray, i: np.uint32, x: float, y: float) -> tuple[float, float]:
    """1/r at which the ray towards x, y enters box i and leaves it; missed unless 1st > 2nd."""
    enter = min(views[i, 0] * x + views[i, 1] * y, views[i, 2] * x + views[i, 3] * y)
    leave = max(views[i, 4] * x + views[i, 5] * y, views[i, 6] * x + views[i, 7] * y)
    return enter, max(leave, views[i, 8] * x + views[i, 9] * y)


@inlined
def _interval(
    views: FloatArray,
    i: np.uint32,
    enter: float,
    leave: float,
    within: FloatArray,
    below: Words,
    scale: float,
    shift: float,
) -> np.uint64:
    """The beams that meet box i on a ray that enters and leaves it at these 1/r."""
    bottom, top = views[i, BOTTOM], views[i, TOP]
    bottom, top = min(bottom * enter, bottom * leave), max(top * enter, top * leave)
    upper = _beams_below(within, below, scale * top + shift, top)
    lower = _beams_below(within, below, scale * bottom + shift, bottom)
    return np.uint64(upper & ~lower)


@inlined
def _insert(active: Boxes, depth: FloatArray, rank: int, box: np.uint32, key: float) -> None:
    """Put a box in its place among the first `rank`, nearest first, of equals the lower row."""
    while rank > 0 and (
        depth[rank - 1] < key or (depth[rank - 1] == key and active[rank - 1] > box)
    ):
        active[rank], depth[rank] = active[rank - 1], depth[rank - 1]
        rank -= 1
    active[rank], depth[rank] = box, key


@inlined
def _beams_below(within: FloatArray, below: Words, cell: float, slope: float) -> np.uint64:
    """The beams below `slope`: those below its cell, and perhaps the one within, the next bit."""
    at = np.uint32(min(max(cell, 0.0), below.shape[0] - 1.0))
    one_more = np.uint64(within[at] < slope)
    return np.uint64((below[at] << one_more) | one_more)


def _ones(word: np.uint64) -> int:
    """Number of bits set."""
    return int(word).bit_count()


@intrinsic
def _population(_: Any, word: Any) -> Any:
    """The processor's instruction for it, which numba offers under no name."""
    return types.int64(word), lambda _, builder, __, words: builder.ctpop(words[0])


@overload(_ones)
def _compiled_ones(word):  # type: ignore[no-untyped-def]
    return lambda word: _population(word)  # type: ignore[call-arg]
