"""Recorded or simulated states of a CommonRoad file into a world with exact derivatives.

The file's states are samples, as a simulator's are: taken every 0.5 s (between two of them on the
line that joins them), they are the control points of a smooth path.
"""

import math

import numpy as np

from mdkf.tables import IntArray
from scenarios import CommonRoadScenario
from scenarios.commonroad import Obstacle
from sim_bridge.bodies import Body, World, at_rest
from sim_bridge.kinematics import (
    CONTROL_STEP,
    INTEGRATION_STEP,
    Motion,
    smooth_motion,
    within,
)

_PER_CONTROL = round(CONTROL_STEP / INTEGRATION_STEP)


def commonroad_world(scenario: CommonRoadScenario, ticks: IntArray, stride: int) -> World:
    """The world of a scenario at ticks (n,), multiples of `INTEGRATION_STEP`, `stride` apart.

    Left out is what is there for less than three seconds: it has no smooth path.
    """
    bodies = {}
    for obstacle in scenario.obstacles:
        motion = _motion(scenario, obstacle, ticks, stride)
        if motion is not None:
            size = obstacle.length, obstacle.width, obstacle.height
            bodies[obstacle.name] = Body(obstacle.name, obstacle.kind, *size, motion=motion)
    ego = bodies.pop(scenario.ego)
    return World(list(bodies.values()), ego, "CommonRoad")


def _motion(
    scenario: CommonRoadScenario, obstacle: Obstacle, ticks: IntArray, stride: int
) -> Motion | None:
    x, y, heading = np.array(obstacle.states, dtype=np.float64).T
    if obstacle.static:
        return at_rest(ticks, float(x[0]), float(y[0]), float(heading[0]))
    # Control points are counted from where the recording begins.
    seconds = (obstacle.first + np.arange(len(x))) * scenario.time_step - scenario.begin
    first, last = (seconds[[0, -1]] / CONTROL_STEP).tolist()
    # 1e-9: a sample that is one but for rounding is a control point.
    points = np.arange(math.ceil(first - 1e-9), math.floor(last + 1e-9) + 1)
    if not len(points):
        return None
    at, turned = points * CONTROL_STEP, np.unwrap(heading)
    yaw = np.interp(at, seconds, turned)
    middle = np.column_stack([np.interp(at, seconds, each) for each in (x, y)])
    front = middle + obstacle.length / 2 * np.column_stack([np.cos(yaw), np.sin(yaw)])
    first_tick = int(points[0]) * _PER_CONTROL
    motion = smooth_motion(first_tick, front, yaw, obstacle.length, stride)
    return None if motion is None else within(motion, len(ticks), stride)
