"""HOTA, CLEAR and Identity of a crowd, and TrackEval's if it is installed; IoU of rotated boxes."""

import importlib
import math
from dataclasses import replace
from typing import Any

import numpy as np

from experiments.bench.measure import Block, Case
from experiments.bench.plan import Plan
from experiments.metrics import Sequence, bird_iou, clear, hota, identity, sequence_from_rows
from mdkf.tables import FloatArray
from sim_bridge.randomness import stream

WHAT = "scoring"
TIER, TRACKEVAL = "kernel", "trackeval"
NAME, IOU = "hota, clear, identity", "bird_iou"
THRESHOLD = 0.5
"""Similarity from which CLEAR and Identity count a match."""

DENSITY = 0.05
"""Of the crowd [1/m2]: nearly half of its people have another within 2 m, where similarity ends."""
SPEED = 1.0
"""Standard deviation along each axis [m/s]; frames are 0.1 s apart."""
ERROR = 0.2
"""Standard deviation of a track's position along each axis [m]."""
MISSED = 0.1
"""Share of rows that the tracks lack."""
CLOSE, SWAPPED, RENEWED = 1.0, 0.02, 0.002
"""Two tracks closer than this [m] change places for good in such a share of frames; any track gets
a new id in such a share."""

JAM = 20
"""Frames of a traffic jam, boxes of 4.5 m x 1.8 m, to compare with boxes beside them."""


def blocks(plan: Plan) -> list[Block]:
    """A block for each number of objects, its anchor TrackEval where that can be imported."""
    return [*(_block(objects, plan.scored) for objects in plan.crowds), _iou(plan.boxes)]


def _block(objects: int, frames: int) -> Block:
    scored = sequence(objects, frames)
    # Prepared anew, so that what a sequence derives from its rows is worked out on the clock.
    ours = Case(WHAT, NAME, TIER, objects, 1, *_UNIT, lambda: replace(scored), _ours)
    try:
        metrics = importlib.import_module("trackeval.metrics")
    except ImportError:
        return Block((ours,))
    settings = {"THRESHOLD": THRESHOLD, "PRINT_CONFIG": False}
    judges = metrics.HOTA(), metrics.CLEAR(settings), metrics.Identity(settings)

    def theirs(data: dict[str, Any]) -> list[Any]:
        return [judge.eval_sequence(data) for judge in judges]

    other = Case(
        *(WHAT, NAME, TRACKEVAL, objects, 1, *_UNIT), lambda: _as_trackeval(scored), theirs
    )
    return Block((ours, other), anchor=other)


_UNIT = "ms per sequence", 1e3


def sequence(objects: int, frames: int) -> Sequence:
    """People who cross a square, thrown back by its sides, and tracks with the usual faults."""
    random = stream("bench-scoring", objects, frames)
    side = math.sqrt(objects / DENSITY)
    velocity = random.normal(0.0, SPEED, (objects, 2))
    straight = (
        random.uniform(0.0, side, (objects, 2)) + velocity * np.arange(frames)[:, None, None] / 10
    )
    truth = side - np.abs(straight % (2 * side) - side)
    identifier = np.empty((frames, objects), dtype=np.int64)
    current, unused = np.arange(objects), objects
    for k in range(frames):
        apart = np.hypot(*(truth[k][:, None] - truth[k]).T)
        for pair in np.argwhere(np.triu(apart < CLOSE, 1)):
            if random.random() < SWAPPED:
                current[pair] = current[pair[::-1]]
        for renewed in np.flatnonzero(random.random(objects) < RENEWED):
            current[renewed], unused = unused, unused + 1
        identifier[k] = current
    frame = np.broadcast_to(np.arange(frames)[:, None], identifier.shape)
    found = random.random(identifier.shape) >= MISSED
    near = truth + random.normal(0.0, ERROR, truth.shape)
    place = np.broadcast_to(np.arange(objects), identifier.shape)
    return sequence_from_rows(
        frame.ravel(),
        place.ravel(),
        truth.reshape(-1, 2),
        frame[found],
        identifier[found],
        near[found],
        n_frames=frames,
    )


def _iou(boxes: int) -> Block:
    jams = [jam(boxes, frame) for frame in range(JAM)]

    def run(_: None) -> list[FloatArray]:
        return [bird_iou(truth, track) for truth, track in jams]

    return Block((Case(WHAT, IOU, TIER, boxes, JAM, "us per frame", 1e6, lambda: None, run),))


def jam(n: int, frame: int) -> tuple[FloatArray, FloatArray]:
    """True boxes (n, 5) x, y [m], yaw [rad], length, width [m] in lanes 3.2 m apart, one every
    6.5 m, and as many boxes a little beside them."""
    random = stream("bench-iou", n, frame)
    lanes = max(1, round(math.sqrt(n / 2)))
    place, lane = np.divmod(np.arange(n), lanes)
    truth = np.column_stack(
        [6.5 * place, 3.2 * lane, np.zeros(n), np.full(n, 4.5), np.full(n, 1.8)]
    )
    truth += random.normal(0.0, (0.5, 0.1, 0.05, 0.0, 0.0), truth.shape)
    return truth, truth + random.normal(0.0, (0.2, 0.2, 0.05, 0.1, 0.1), truth.shape)


def _ours(scored: Sequence) -> tuple[Any, ...]:
    return hota(scored), clear(scored, THRESHOLD), identity(scored, THRESHOLD)


def _as_trackeval(scored: Sequence) -> dict[str, Any]:
    """The dictionary that TrackEval's datasets hand to `eval_sequence`."""
    return {
        "num_timesteps": scored.n_frames,
        "num_gt_dets": len(scored.truth),
        "num_tracker_dets": len(scored.track),
        "num_gt_ids": scored.n_objects,
        "num_tracker_ids": scored.n_tracks,
        "gt_ids": np.split(scored.truth, scored.truth_start[1:-1]),
        "tracker_ids": np.split(scored.track, scored.track_start[1:-1]),
        "similarity_scores": [scored.frame_similarity(k) for k in range(scored.n_frames)],
    }
