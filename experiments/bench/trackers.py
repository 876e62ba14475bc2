"""The whole tracker on traffic in lanes, for each filter: detections to tracks."""

import math

import numpy as np

import mdkf
from experiments.bench.measure import Block, Case
from experiments.bench.plan import Plan
from mdkf import CLUTTER, Detections, Tracker
from sim_bridge.randomness import stream

WHAT = "tracker"
NAMES = ("ca", "imm", "imm-zero", "md")
RATIOS = (("md", "ca"), ("imm", "md"), ("imm-zero", "md"))
DETECTOR = "pointrcnn"
TIER = "tracker"

DT = 0.1
"""Time between frames [s]."""
LANE = 10.0
"""Between lanes, across [m]: more than twice the gate."""
SPACING = 20.0
"""Between the objects of a lane, along [m]."""
FASTEST = 15.0
"""Mean speed in the fastest lane [m/s]; the slowest stands."""
MISSED = 0.05
"""Share of detections that are missed."""
FALSE = 0.05
"""False boxes for each object and frame."""
SCORES = 3.0, 10.0
"""Of a detection, raw; a false box has the lower one."""


def blocks(plan: Plan) -> list[Block]:
    """One block for each number of objects."""
    return [_block(detections(objects, plan.frames)) for objects in plan.objects]


def detections(objects: int, frames: int) -> Detections:
    """Objects in lanes of one speed each, which swings by half: noisy, some missed, some false."""
    random = stream("bench-tracker", objects, frames)
    lanes = math.ceil(math.sqrt(objects))
    lane, place = np.divmod(np.arange(objects), math.ceil(objects / lanes))
    time = DT * np.arange(frames)[:, None]
    speed = FASTEST * lane / max(lanes - 1, 1)
    swing = 0.5  # [rad/s]
    x = SPACING * place + speed * (time - 0.5 / swing * (np.cos(swing * time) - 1.0))
    y = np.broadcast_to(LANE * lane, x.shape)
    settings = mdkf.DETECTORS[DETECTOR]
    x = x + random.normal(0.0, math.sqrt(settings.x_var), x.shape)
    y = y + random.normal(0.0, math.sqrt(settings.y_var), x.shape)
    frame, source = np.broadcast_to(np.arange(frames)[:, None], x.shape), np.arange(objects)
    seen = random.random(x.shape) >= MISSED
    false = random.poisson(FALSE * objects, frames)
    n = int(false.sum())
    columns = {
        "frame": np.concatenate([frame[seen], np.repeat(np.arange(frames), false)]),
        "source": np.concatenate([np.broadcast_to(source, x.shape)[seen], np.full(n, CLUTTER)]),
        "x": np.concatenate([x[seen], random.uniform(x.min(), x.max(), n)]),
        "y": np.concatenate([y[seen], random.uniform(y.min(), y.max(), n)]),
        "score": np.repeat(SCORES[::-1], [int(seen.sum()), n]),
    }
    rows = len(columns["frame"])
    box = {"z": 0.75, "yaw": 0.0, "length": 4.5, "width": 1.8, "height": 1.5}  # [m], [rad]
    columns |= {name: np.full(rows, value) for name, value in box.items()}
    return Detections.from_columns(columns, n_frames=frames, dt=DT)


def _block(seen: Detections) -> Block:
    cases = {name: _case(name, seen) for name in NAMES}
    ratios = tuple((cases[first], cases[second]) for first, second in RATIOS)
    return Block(tuple(cases.values()), ratios=ratios)


def _case(name: str, seen: Detections) -> Case:
    tracker = Tracker(mdkf.estimator(name), DETECTOR)
    return Case(
        WHAT,
        name,
        TIER,
        int(seen.source.max()) + 1,
        seen.n_frames,
        "us per frame",
        1e6,
        prepare=lambda: None,
        run=lambda _: tracker.run(seen),
    )
