"""Routes through a road network into smooth paths, and where two of them are in conflict.

A path is sampled every `SPACING`; its corners are rounded, and on it stand the course, the
curvature and the speed at which it can be driven in comfort.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import cKDTree

from mdkf.tables import FloatArray, IntArray

SPACING = 0.5  # m between samples
ROUNDING = 2.5  # m, standard deviation of the kernel that rounds corners
LATERAL_ACCELERATION = 2.0  # m/s2 in bends
BRAKING = 1.2  # m/s2 before bends
CLEARANCE = 2.8
"""Paths closer than this are in conflict [m]: two lorries and some air; lanes are 4 m apart."""
MERGE = 8.0
"""How much of a common path counts as conflict [m]; from there on one follows the other."""


@dataclass(frozen=True, eq=False)
class Path:
    """The way of a vehicle's centre, all (n,): x, y [m], course [rad], curvature [1/m], and the
    speed that bends allow [m/s].

    Who comes along it gives way at `line` [m], where it has one, to paths of higher `priority`.
    """

    x: FloatArray
    y: FloatArray
    course: FloatArray
    curvature: FloatArray
    speed: FloatArray
    line: float = -np.inf
    priority: int = 0
    _table: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        columns = [self.x, self.y, self.course, self.curvature, self.speed]
        object.__setattr__(self, "_table", np.column_stack(columns))

    def at(self, s: float) -> FloatArray:
        """x, y, course, curvature and speed at a distance [m] from the start, (5,)."""
        k = min(max(int(s / SPACING), 0), len(self.x) - 2)
        low, high = self._table[k], self._table[k + 1]
        sample: FloatArray = low + (s / SPACING - k) * (high - low)
        return sample


@dataclass(frozen=True)
class Conflict:
    """Stretches [m] of two paths on which their vehicles would meet: `mine` and `theirs`.

    `merges` says that from there on both paths are one.
    """

    mine: tuple[float, float]
    theirs: tuple[float, float]
    merges: bool


def path_along(
    network: Any,
    route: Sequence[tuple[str, str, int]],
    *,
    approach: int = 0,
    setback: float = 1.0,
    yield_speed: float = np.inf,
    priority: int = 0,
) -> Path:
    """The path along the lanes of a route.

    It has a line to give way at `setback` [m] before the end of the first `approach` lanes, if
    there are any, which is approached at `yield_speed` [m/s] at most.
    """
    pieces, end = [], np.empty(0)
    for k, index in enumerate(route):
        lane = network.get_lane(index)
        places = np.append(np.arange(0.0, lane.length, SPACING), lane.length)
        pieces.append(np.array([lane.position(place, 0.0) for place in places]))
        if k == approach - 1:
            end = pieces[-1][-1]
    points = _evenly(np.concatenate(pieces))
    points = _evenly(gaussian_filter1d(points, ROUNDING / SPACING, axis=0, mode="nearest"))
    course = np.unwrap(np.arctan2(*np.gradient(points, axis=0).T[::-1]))
    curvature = np.gradient(course, SPACING)
    speed = np.sqrt(LATERAL_ACCELERATION / np.maximum(np.abs(curvature), 1e-4))
    line = -np.inf
    if approach:
        nearest = int(np.argmin(np.hypot(*(points - end).T)))
        line = nearest * SPACING - setback
        speed[nearest] = min(speed[nearest], yield_speed)
    # v^2 falls by 2 b ds at most towards every slower sample.
    square, fall = speed**2, 2.0 * BRAKING * SPACING * np.arange(len(speed))
    square = np.minimum.accumulate((square + fall)[::-1])[::-1] - fall
    return Path(points[:, 0], points[:, 1], course, curvature, np.sqrt(square), line, priority)


def conflicts(mine: Path, theirs: Path) -> tuple[Conflict, ...]:
    """Where the paths come closer than `CLEARANCE`, in order along mine.

    A common start is none: there one follows the other.
    """
    here, there = (np.column_stack([path.x, path.y]) for path in (mine, theirs))
    near = _near(there, here)
    found = []
    for run in np.split(near, np.flatnonzero(np.diff(near) > 1) + 1):
        if not len(run):
            continue
        along = _near(here[run], there)
        (first, last), (low, high) = ((float(r[0]), float(r[-1])) for r in (run, along))
        merges = bool(np.cos(mine.course[run[-1]] - theirs.course[along[-1]]) > 0.5)
        if merges:
            if first == 0.0 or low == 0.0:
                continue
            last, high = first + MERGE / SPACING, low + MERGE / SPACING
        found.append(
            Conflict((first * SPACING, last * SPACING), (low * SPACING, high * SPACING), merges)
        )
    return tuple(found)


def _near(points: FloatArray, others: FloatArray) -> IntArray:
    """Which of the others (n, 2) are closer than `CLEARANCE` to a point (m, 2)."""
    distance, _ = cKDTree(points).query(others, distance_upper_bound=CLEARANCE)
    return np.flatnonzero(np.isfinite(distance))


def _evenly(points: FloatArray) -> FloatArray:
    """The same line (n, 2), sampled every `SPACING`."""
    steps = np.hypot(*np.diff(points, axis=0).T)
    points = points[np.append(True, steps > 1e-9)]
    length = np.append(0.0, np.cumsum(steps[steps > 1e-9]))
    places = np.arange(0.0, length[-1], SPACING)
    return np.column_stack([np.interp(places, length, points[:, axis]) for axis in (0, 1)])
