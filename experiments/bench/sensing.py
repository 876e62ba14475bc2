"""What a sensor sees of many boxes, frame by frame: visible fractions and LiDAR returns."""

import math
from collections.abc import Callable

import numpy as np

from experiments.bench.measure import Block, Case
from experiments.bench.plan import Plan
from mdkf.tables import FloatArray
from sim_bridge.line_of_sight import visible_fractions
from sim_bridge.point_count import point_counts
from sim_bridge.randomness import stream

WHAT = "line-of-sight"
TIER = "kernel"
FRACTIONS, RETURNS = "visible fractions", "LiDAR returns"
FRAMES = 20
SENSOR = 0.0, 0.0, 1.7
"""[m]"""
CELL = 8.0
"""Side of the square in which a box stands anyhow [m]: boxes do not overlap."""


def blocks(plan: Plan) -> list[Block]:
    """One block: the exact sweep beside the z-buffer that counts a LiDAR's returns."""
    boxes = np.concatenate([scene(plan.boxes, frame) for frame in range(FRAMES)])
    sensor = np.tile(SENSOR, (FRAMES, 1))
    start = plan.boxes * np.arange(FRAMES + 1)
    ways: dict[str, Callable[[], object]] = {
        FRACTIONS: lambda: visible_fractions(sensor, start, boxes),
        RETURNS: lambda: point_counts(sensor, start, boxes),
    }
    cases = [
        Case(
            WHAT,
            name,
            TIER,
            plan.boxes,
            FRAMES,
            "us per frame",
            1e6,
            prepare=lambda: None,
            run=_ignoring(way),
        )
        for name, way in ways.items()
    ]
    return [Block(tuple(cases))]


def _ignoring(way: Callable[[], object]) -> Callable[[object], object]:
    """A run that needs nothing prepared."""
    return lambda _: way()


def scene(n: int, frame: int) -> FloatArray:
    """Boxes (n, 7) around the sensor: x, y, z [m], yaw [rad], length, width, height [m]."""
    random = stream("bench-line-of-sight", n, frame)
    side = math.ceil(math.sqrt(n + 1))
    cells = np.stack(np.meshgrid(*2 * [np.arange(side) - side // 2]), axis=-1).reshape(-1, 2)
    cells = cells[np.abs(cells).sum(axis=1) > 0][:n]  # the sensor's own stays free
    boxes = np.empty((n, 7))
    boxes[:, :2] = CELL * cells + random.uniform(-1.0, 1.0, (n, 2))
    boxes[:, 3] = random.uniform(-math.pi, math.pi, n)
    boxes[:, 4:] = (4.5, 1.8, 1.5)
    boxes[:, 6] += random.uniform(0.0, 1.5, n)
    boxes[:, 2] = boxes[:, 6] / 2
    return boxes
