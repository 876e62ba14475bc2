"""Returns by casting every beam at every box, to compare the kernels with, and boxes to cast at.

Beams are clipped by the three slabs of each box in the box's own frame; there are no wall
equations, no sweep, no cells of slopes and no order of boxes.
"""

import math

import numpy as np
from numpy.typing import NDArray

from sim_bridge.lidar import Lidar
from tests.sim_bridge.worlds import BUS, CAR, corners, on_ground

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

COARSE = Lidar(rays=720, beams=33)


def clip(sensor: Floats, box: Floats, x: Floats, y: Floats, z: Floats) -> tuple[Floats, Floats]:
    """Where rays along x, y, z enter and leave a box, in lengths of the ray (inf, -inf: never)."""
    c, s = np.cos(box[3]), np.sin(box[3])
    offset = np.asarray(sensor) - box[:3]
    origin = (c * offset[0] + s * offset[1], c * offset[1] - s * offset[0], offset[2])
    enter, leave = np.zeros(np.broadcast(x, z).shape), np.full(np.broadcast(x, z).shape, np.inf)
    for o, h, half in zip(origin, (c * x + s * y, c * y - s * x, z), box[4:7] / 2, strict=True):
        h = np.where(np.abs(h) < 1e-200, 1e-200, h)
        t1, t2 = (-half - o) / h, (half - o) / h
        enter, leave = np.maximum(enter, np.minimum(t1, t2)), np.minimum(leave, np.maximum(t1, t2))
    hit = (leave > enter) & (leave > 0.0)
    return np.where(hit, enter, np.inf), np.where(hit, leave, -np.inf)


def cast_counts(
    sensor: Floats, boxes: Floats, lidar: Lidar = COARSE, by_footprint: bool = False
) -> Ints:
    """Returns of every box, every beam of every ray cast at every box.

    Boxes that overlap have no first one by themselves; `by_footprint` takes the one whose
    footprint the ray enters first.
    """
    step = math.tau / lidar.rays
    azimuth = (-math.pi + step / 2 + step * np.arange(lidar.rays))[:, None]
    slope = np.tan(np.linspace(lidar.lowest, lidar.highest, lidar.beams))[None, :]
    x, y = np.cos(azimuth), np.sin(azimuth)  # of length 1 on the ground
    nearest = np.full((lidar.rays, lidar.beams), np.inf)
    owner = np.full(nearest.shape, -1)
    for i, box in enumerate(boxes):
        enter, _ = clip(sensor, box, x, y, slope)
        tall = box.copy()
        tall[6] = 1e12
        foot, _ = clip(sensor, tall, x, y, np.zeros((1, 1)))
        enter = np.where(foot > lidar.max_range, np.inf, enter)
        if by_footprint:
            enter = np.where(np.isfinite(enter), foot, np.inf)
        owner = np.where(enter < nearest, i, owner)
        nearest = np.minimum(enter, nearest)
    return np.array([np.count_nonzero(owner == i) for i in range(len(boxes))])


def apart(a: Floats, b: Floats) -> bool:
    """Whether a line parallel to a side of one of two boxes lies between them."""
    for axis in (a[3], a[3] + math.pi / 2, b[3], b[3] + math.pi / 2):
        direction = np.array([math.cos(axis), math.sin(axis)])
        p, q = (corners(box[None, [0, 1, 3, 4, 5]])[0] @ direction for box in (a, b))
        if p.max() < q.min() or q.max() < p.min():
            return True
    return False


def scene(seed: int, n: int, extent: float = 25.0, floating: bool = True) -> tuple[Floats, Floats]:
    """A sensor and up to n boxes that do not overlap, from kerbs to walls, near and far."""
    rng = np.random.default_rng(seed)
    sensor = np.array([*rng.uniform(-50.0, 50.0, 2), rng.uniform(-1.0, 5.0)])
    point = np.array([*sensor[:2], 0.0, 0.0, 1e-3, 1e-3, 1.0])
    boxes: list[Floats] = []
    for _ in range(n):
        size = rng.uniform((0.3, 0.3, 0.2), (14.0, 3.0, 4.0))
        z = size[2] / 2 + (rng.uniform(0.0, 2.0) if floating and rng.random() < 0.3 else 0.0)
        place = sensor[:2] + rng.uniform(-extent, extent, 2)
        box = np.array([*place, z, rng.uniform(-7.0, 7.0), *size])
        if all(apart(box, other) for other in (point, *boxes)):
            boxes.append(box)
    return sensor, np.array(boxes).reshape(-1, 7)


def street(seed: int, n: int, height: float) -> tuple[Floats, Floats]:
    """Cars, buses and people on the ground around a sensor 1.73 m or less above it."""
    rng = np.random.default_rng(seed)
    kinds = (CAR, CAR, CAR, (6.0, 2.0, 2.2), BUS, (0.8, 0.8, 1.75))
    boxes = [np.array(on_ground(0.0, 0.0, 0.0, CAR))]
    while len(boxes) <= n:
        place, yaw = rng.uniform(-60.0, 60.0, 2), rng.uniform(-math.pi, math.pi)
        box = np.array(on_ground(*place, yaw, kinds[rng.integers(len(kinds))]))
        if all(apart(box, other) for other in boxes):
            boxes.append(box)
    return np.array([0.0, 0.0, height]), np.array(boxes[1:])
