"""The filters at several numbers of tracks: filterpy, numpy, call by call, one compiled pass.

A step is a prediction and an update. A compiled pass also starts the tracks and writes down every
frame's estimates; in the other tiers the tracks are there, and only the last positions are read.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

import mdkf
from experiments.bench.measure import Block, Case
from experiments.bench.plan import Plan
from mdkf import Estimator, MotionDynamics
from mdkf.reference import (
    NumpyMotionDynamics,
    UnbiasedImm,
    filterpy_imm,
    filterpy_kalman,
    numpy_kalman,
)
from mdkf.tables import FloatArray
from sim_bridge.randomness import stream

WHAT = "filter"
DT = 0.1
"""Time between frames [s]."""
R = np.diag([mdkf.DETECTORS["pointrcnn"].x_var, mdkf.DETECTORS["pointrcnn"].y_var])
"""Measurement noise [m2]."""

NAMES = ("cv", "ca", "cj", "imm", "imm-zero", "imm3", "md", "md3")
ORDERS = {"cv": 1, "ca": 2, "cj": 3, "imm": 2, "imm-zero": 2, "imm3": 3, "md": 2, "md3": 3}
ANCHOR_TRACKS = 10
"""A filter's `ratio` refers to filterpy's Kalman filter of constant acceleration, so many."""
RATIOS = (("md", "ca"), ("imm", "md"), ("imm-zero", "md"))
"""Costs of the first over those of the second; the paper's table has them for its own IMM."""

FILTERPY, NUMPY, CALLS, KERNEL = "filterpy", "numpy", "calls", "kernel"
TIERS: Mapping[str, str] = {
    FILTERPY: "filterpy's objects, one for each track",
    NUMPY: "plain numpy, one object for each track",
    CALLS: "mdkf's estimators, frame by frame",
    KERNEL: "mdkf.filter_sequence, all frames in one compiled pass",
}

# An object of the reference tier: what predicts, and what updates with a position (2,).
_Track = tuple[Callable[[], None], Callable[[FloatArray], None], Callable[[], FloatArray]]


def blocks(plan: Plan) -> list[Block]:
    """One block for each number of tracks."""
    return [_block(tracks, plan) for tracks in plan.tracks]


def measurements(tracks: int, steps: int) -> FloatArray:
    """Positions (steps + 1, tracks, 2) [m]: every fourth object stands, the others go to and fro
    by up to 20 m, at up to 8 m/s; with the detector's noise."""
    random = stream("bench-filters", tracks, steps)
    time = DT * np.arange(steps + 1)[:, None, None]
    amplitude = 20.0 * random.uniform(size=(tracks, 2))
    amplitude[::4] = 0.0
    rate = random.uniform(0.1, 0.4, (tracks, 2))  # [rad/s]
    phase = random.uniform(0.0, 2 * np.pi, (tracks, 2))
    place = random.uniform(-100.0, 100.0, (tracks, 2))
    noise = random.standard_normal((steps + 1, tracks, 2)) * np.sqrt(np.diag(R))
    seen: FloatArray = place + amplitude * np.sin(rate * time + phase) + noise
    return seen


def _block(tracks: int, plan: Plan) -> Block:
    few = measurements(tracks, plan.steps)
    many = measurements(tracks, max(plan.passes, plan.updates // tracks))
    cases = [_calls(name, few) for name in NAMES] + [_kernel(name, many) for name in NAMES]
    if tracks in plan.reference:
        cases += [_reference(name, tier, few) for name, tier in _MADE]
    known = {(case.name, case.tier): case for case in cases}
    anchor = known.get(("ca", FILTERPY))
    if anchor is None or tracks != ANCHOR_TRACKS:
        anchor = _reference("ca", FILTERPY, measurements(ANCHOR_TRACKS, plan.steps))
    ratios = [
        (known[first, tier], known[second, tier])
        for tier in TIERS
        for first, second in RATIOS
        if (first, tier) in known and (second, tier) in known
    ]
    return Block(tuple(cases), anchor, tuple(ratios))


def _case(name: str, tier: str, z: FloatArray, prepare: Any, run: Any) -> Case:
    steps, tracks = len(z) - 1, z.shape[1]
    work = steps * tracks
    return Case(WHAT, name, tier, tracks, work, "ns per track and step", 1e9, prepare, run)


def _calls(name: str, z: FloatArray) -> Case:
    estimator: Estimator = mdkf.estimator(name)
    noise = np.tile(R, (z.shape[1], 1, 1))
    start = estimator.start(z[0], noise)

    def run(state: Any) -> FloatArray:
        for k in range(1, len(z)):
            state = estimator.update(estimator.predict(state, DT), z[k], noise)
        return estimator.position(state)

    return _case(name, CALLS, z, lambda: start, run)


def _kernel(name: str, z: FloatArray) -> Case:
    estimator = mdkf.estimator(name)

    def run(_: None) -> FloatArray:
        return np.asarray(mdkf.filter_sequence(estimator, z, R, DT).position[-1])

    return _case(name, KERNEL, z, lambda: None, run)


def _reference(name: str, tier: str, z: FloatArray) -> Case:
    make = _MADE[name, tier]

    def prepare() -> list[_Track]:
        return [make(position, ORDERS[name]) for position in z[0]]

    def run(tracks: list[_Track]) -> FloatArray:
        for seen in z[1:]:
            for (predict, update, _), position in zip(tracks, seen, strict=True):
                predict()
                update(position)
        return np.array([position() for _, _, position in tracks])

    return _case(name, tier, z, prepare, run)


def _kalman(make: Callable[..., Any]) -> Callable[[FloatArray, int], _Track]:
    def made(position: FloatArray, order: int) -> _Track:
        kf = make(position, order, DT)
        kf.R = R
        return kf.predict, kf.update, lambda: kf.x[:: order + 1]

    return made


def _motion_dynamics(kalman: Callable[..., Any]) -> Callable[[FloatArray, int], _Track]:
    def made(position: FloatArray, order: int) -> _Track:
        window, factors = MotionDynamics(order).window, MotionDynamics(order).motion_factors
        md = NumpyMotionDynamics(position, order, DT, window, factors, kalman=kalman)
        return md.predict, lambda z: md.update(z, R), lambda: md.filter.x[:: order + 1]

    return made


def _filterpy_imm(position: FloatArray, order: int) -> _Track:
    imm = filterpy_imm(position, order, DT)
    for model in imm.filters:
        model.R = R
    return imm.predict, imm.update, lambda: imm.x[:: order + 1]


def _numpy_imm(position: FloatArray, order: int) -> _Track:
    imm = UnbiasedImm(position, order, DT)
    return imm.predict, lambda z: imm.update(z, R), lambda: imm.position


_MADE: Mapping[tuple[str, str], Callable[[FloatArray, int], _Track]] = {
    **{(name, FILTERPY): _kalman(filterpy_kalman) for name in ("cv", "ca", "cj")},
    ("imm-zero", FILTERPY): _filterpy_imm,
    **{(name, FILTERPY): _motion_dynamics(filterpy_kalman) for name in ("md", "md3")},
    **{(name, NUMPY): _kalman(numpy_kalman) for name in ("cv", "ca", "cj")},
    **{(name, NUMPY): _numpy_imm for name in ("imm", "imm3")},
    **{(name, NUMPY): _motion_dynamics(numpy_kalman) for name in ("md", "md3")},
}
"""The filters of the reference tier by name and tier."""
