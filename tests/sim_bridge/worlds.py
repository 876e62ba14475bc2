"""Worlds that several claims look at: simulations, each run once per process, and hand-made ones.

Nothing here comes from the code under test but `simulate` and the tables themselves.
"""

from functools import cache

import numpy as np
from numpy.typing import ArrayLike

import scenarios
from mdkf.tables import KINDS, REGIMES, EgoPath, FloatArray, IntArray, Trace
from sim_bridge import simulate

SUMO = tuple(name for name in scenarios.list() if scenarios.load(name).source == "sumo")
"""Every scenario of the catalogue on SUMO: a new one cannot escape the tests of them all."""

CAR = (4.5, 1.8, 1.5)  # length, width, height [m]
BUS = (12.0, 2.5, 3.0)
ROOF_SENSOR = (0.0, 0.0, 1.73)  # [m] KITTI's LiDAR height


@cache
def world(name: str, dt: float = 0.1) -> Trace:
    """Seed 0 of a scenario of the catalogue."""
    return simulate(scenarios.load(name), 0, dt)


def by_object(trace: Trace) -> IntArray:
    """The order of rows in which every object's life is one run, in order of frames."""
    return np.lexsort((trace.frame, trace.object_id))


def neighbours(trace: Trace) -> tuple[IntArray, IntArray]:
    """Pairs of rows (before, after) that follow each other in one object's life."""
    order = by_object(trace)
    same = np.diff(trace.object_id[order]) == 0
    return order[:-1][same], order[1:][same]


def stencil(trace: Trace) -> IntArray:
    """Five rows (5, n) that follow each other in one object's life, for every row in the middle of
    such five: all rows but two at either end of a life, of which there must be frames enough."""
    order = by_object(trace)
    rows = np.stack([order[k : len(order) - 4 + k] for k in range(5)])
    rows = rows[:, trace.object_id[rows[0]] == trace.object_id[rows[4]]]
    np.testing.assert_array_equal(np.diff(trace.frame[rows], axis=0), 1)
    assert rows.shape[1] > 0.99 * len(trace)
    return rows


def assert_velocity_acceleration_and_jerk(trace: Trace) -> None:
    """First, second and third central differences of a 100 Hz trace's positions are v, a and j."""
    h, (before2, before, here, after, after2) = trace.dt, stencil(trace)
    for axis in "xy":
        p = getattr(trace, axis)
        v = (p[after] - p[before]) / (2 * h)
        a = (p[after] - 2 * p[here] + p[before]) / h**2
        j = (p[after2] - 2 * p[after] + 2 * p[before] - p[before2]) / (2 * h**3)
        for name, measured, allowed in (("v", v, 1e-3), ("a", a, 1e-2), ("j", j, 5e-2)):
            column = getattr(trace, f"{name}{axis}")[here]
            assert np.abs(measured - column).max() < allowed, f"{name}{axis}"


def assert_yaw_rate(trace: Trace) -> None:
    """Central differences of a 100 Hz trace's yaw are the yaw rate."""
    _, before, here, after, _ = stencil(trace)
    turned = np.angle(np.exp(1j * (trace.yaw[after] - trace.yaw[before])))
    assert np.abs(turned / (2 * trace.dt) - trace.yaw_rate[here]).max() < 1e-3


def corners(boxes: FloatArray) -> FloatArray:
    """Corners (n, 4, 2), counter-clockwise, of boxes (n, 5): x, y, yaw, length, width."""
    x, y, yaw, length, width = boxes.T[:, :, None]
    along = length / 2 * np.array([1, -1, -1, 1])
    across = width / 2 * np.array([1, 1, -1, -1])
    turned = (along + 1j * across) * np.exp(1j * yaw) + x + 1j * y
    return np.stack([turned.real, turned.imag], axis=-1)


def on_ground(x: float, y: float, yaw: float, size: tuple[float, float, float]) -> list[float]:
    """A box's centre x, y, z [m], yaw [rad], length, width, height [m]."""
    return [x, y, size[2] / 2, yaw, *size]


def convoy(
    distance: ArrayLike,
    bearing: ArrayLike,
    visible: ArrayLike,
    n_frames: int,
    dt: float = 0.1,
    seed: str = "0",
) -> Trace:
    """Objects 0, 1, ... that keep their distance [m], bearing [rad] and visible fraction.

    All three broadcast to (n,). The sensor drives straight on, away from the origin; objects look
    in all directions. Row frame * n + object holds an object in a frame.
    """
    r, b, shown = np.broadcast_arrays(*(np.asarray(a, float) for a in (distance, bearing, visible)))
    n = len(r)
    frame = np.arange(n_frames)
    velocity = (5.0, -2.0)  # m/s
    ego = EgoPath.from_columns(
        {
            "frame": frame,
            "x": 300.0 + velocity[0] * frame * dt,
            "y": -80.0 + velocity[1] * frame * dt,
            "z": np.full(n_frames, 1.73),
            "yaw": np.full(n_frames, np.arctan2(velocity[1], velocity[0])),
        },
        n_frames=n_frames,
        dt=dt,
    )

    def everywhere(values: ArrayLike) -> FloatArray:
        return np.tile(np.broadcast_to(np.asarray(values, float), n), n_frames)

    columns = {
        "frame": np.repeat(frame, n),
        "object_id": np.tile(np.arange(n), n_frames),
        "kind": everywhere(KINDS.index("car")),
        "x": np.repeat(ego.x, n) + everywhere(r * np.cos(b)),
        "y": np.repeat(ego.y, n) + everywhere(r * np.sin(b)),
        "z": everywhere(CAR[2] / 2),
        "yaw": everywhere(np.linspace(-3.1, 3.1, n)),
        "vx": everywhere(velocity[0]),
        "vy": everywhere(velocity[1]),
        **{name: everywhere(0.0) for name in ("ax", "ay", "jx", "jy", "yaw_rate", "turning")},
        **{name: everywhere(size) for name, size in zip(SIZE, CAR, strict=True)},
        "regime": everywhere(REGIMES.index("constant_velocity")),
        "visible": everywhere(shown),
    }
    return Trace.from_columns(columns, n_frames=n_frames, dt=dt, ego=ego, provenance={"seed": seed})


SIZE = ("length", "width", "height")
