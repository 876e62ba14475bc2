"""What is on the road: a motion, and what moves by it. All sources of worlds give these."""

from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np

from mdkf.tables import FloatArray, IntArray
from scenarios import StaticBox
from sim_bridge.kinematics import Motion

MOTION = tuple(field.name for field in fields(Motion) if field.name != "tick")
"""The columns of a motion."""

STATIC = "static "
"""Begins the names of the scenario's own boxes that never move."""


@dataclass(frozen=True, eq=False)
class Body:
    """One object: its size [m], its motion and what it is."""

    name: str
    kind: str
    length: float
    width: float
    height: float
    motion: Motion


@dataclass(frozen=True, eq=False)
class World:
    """What a source puts on the road within a trace's frames.

    others: every object but the ego vehicle, in the order of their ids; ego: the body that carries
    the sensor, its frames from the first on; simulator: what made it, with its version.
    """

    others: list[Body]
    ego: Body
    simulator: str


def at_rest(ticks: IntArray, x: float, y: float, yaw: float) -> Motion:
    """The motion of a box that stands at x, y [m], yaw [rad]."""
    still: dict[str, FloatArray] = {name: np.zeros(len(ticks)) for name in MOTION}
    still |= {"x": np.full(len(ticks), x), "y": np.full(len(ticks), y)}
    return Motion(tick=ticks, **(still | {"yaw": np.full(len(ticks), yaw)}))


def static_bodies(statics: tuple[StaticBox, ...], ticks: IntArray) -> Iterator[Body]:
    """The boxes that never move."""
    for k, box in enumerate(statics):
        motion = at_rest(ticks, box.x, box.y, box.yaw)
        yield Body(f"{STATIC}{k}", box.kind, box.length, box.width, box.height, motion)
