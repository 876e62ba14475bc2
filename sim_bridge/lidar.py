"""A spinning LiDAR: where its rays and beams go."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from mdkf.tables import FloatArray

Words = NDArray[np.uint64]

MIN_RAYS = 16  # a box seen from close by spans half the circle, and two rays are added for safety
MAX_BEAMS = 64  # the bits of a word
STEEPEST = math.radians(80.0)  # [rad] of a beam: slopes stay within the same order of magnitude
LEAST_STEP = 1e-6  # [rad] between beams: far above rounding


@dataclass(frozen=True)
class Lidar:
    """A spinning LiDAR; the defaults resemble the Velodyne HDL-64E of KITTI.

    Beams are equally far apart in elevation; the real device has two blocks of 32, the upper one
    spaced 1/3 degree and the lower one 1/2 degree. Rays are fixed in the world, the first half a
    step beyond azimuth -pi; the real device has 4167 of them at 5 turns a second and 2083 at
    KITTI's 10, so that counts are to be scaled by 0.58 for KITTI. All returns of a turn are from
    one moment, and every beam that meets a box within range returns: no reflectivity, no dropout,
    no width of a beam.

    Attributes:
        rays: azimuths per turn, at least 16.
        lowest: elevation of the lowest beam [rad], at least -80 degrees.
        highest: elevation of the highest beam [rad], at most 80 degrees.
        beams: number of beams, 2 to 64.
        max_range: ground distance [m] beyond which the wall that a ray enters returns nothing.
    """

    rays: int = 3600
    lowest: float = math.radians(-24.8)
    highest: float = math.radians(2.0)
    beams: int = 64
    max_range: float = 120.0

    def __post_init__(self) -> None:
        if self.rays < MIN_RAYS:
            raise ValueError(f"rays: expected at least {MIN_RAYS}, got {self.rays}")
        if not 2 <= self.beams <= MAX_BEAMS:
            raise ValueError(f"beams: expected 2 to {MAX_BEAMS}, got {self.beams}")
        step = (self.highest - self.lowest) / (self.beams - 1)
        if not (self.lowest >= -STEEPEST and self.highest <= STEEPEST and step >= LEAST_STEP):
            raise ValueError(
                f"lowest, highest: expected elevations within {STEEPEST:.3f} rad, the second above "
                f"the first by {LEAST_STEP} rad a beam, got {self.lowest} and {self.highest}"
            )
        if not 0.0 < self.max_range < math.inf:
            raise ValueError(f"max_range: expected a distance above 0 m, got {self.max_range}")

    def azimuths(self) -> FloatArray:
        """Azimuths of the rays `(rays,)` [rad], ascending within -pi..pi."""
        azimuths: FloatArray = np.arange(0.5, self.rays) * (math.tau / self.rays) - math.pi
        return azimuths

    def elevations(self) -> FloatArray:
        """Elevations of the beams `(beams,)` [rad], ascending."""
        return np.linspace(self.lowest, self.highest, self.beams)


HDL_64E = Lidar()


@lru_cache(maxsize=16)
def fan(lidar: Lidar) -> tuple[FloatArray, FloatArray, Words, float, float]:
    """What the kernel needs of a LiDAR, the same for every frame.

    rays (rays, 2) cosine and sine of the azimuths; for each cell of the slopes, (n_cells,): below,
    a word with a bit for each beam below the cell, from the lowest bit on, and within, the slope of
    the next beam, in the cell or above it, inf for none; scale and shift from a slope to its cell.
    """
    azimuths = lidar.azimuths()
    rays = np.column_stack([np.cos(azimuths), np.sin(azimuths)])
    slopes = np.tan(lidar.elevations())
    # A cell is half as wide as the least gap, so that it holds one beam at most, also when
    # rounding moves its ends. Two cells are below all beams, the last one above all.
    width = 0.5 * float(np.diff(slopes).min())
    begins = slopes[0] + width * (np.arange(int((slopes[-1] - slopes[0]) / width) + 5) - 2.0)
    # The margin is for a slope that rounding takes into the next cell: all beams counted there
    # must be below it.
    cells = np.searchsorted(slopes, begins - 0.01 * width)
    within = np.append(slopes, math.inf)[cells]
    below = np.array([(1 << n) - 1 for n in cells.tolist()], dtype=np.uint64)
    scale = 1.0 / width
    shift = 2.0 - scale * float(slopes[0])
    for array in (rays, within, below):
        array.flags.writeable = False
    return rays, within, below, scale, shift
