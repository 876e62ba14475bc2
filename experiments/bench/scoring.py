"""HOTA, CLEAR and Identity of a sequence, and TrackEval's if it is installed."""

import importlib
from dataclasses import replace
from typing import Any

import numpy as np

from experiments.bench.measure import Block, Case
from experiments.bench.plan import Plan
from experiments.metrics import Sequence, clear, hota, identity, sequence_from_rows
from sim_bridge.randomness import stream

WHAT = "scoring"
NAME = "hota, clear, identity"
OBJECTS = 20
THRESHOLD = 0.5
"""Similarity from which CLEAR and Identity count a match."""
MISSED, SWAPPED = 0.1, 0.01
"""Share of rows that the tracks lack, and of frames in which two of them change places."""


def blocks(plan: Plan) -> list[Block]:
    """One block; its anchor is TrackEval where that can be imported."""
    scored = sequence(plan.scored)
    ours = Case(WHAT, NAME, "kernel", OBJECTS, 1, *_UNIT, lambda: replace(scored), _ours)
    try:
        metrics = importlib.import_module("trackeval.metrics")
    except ImportError:
        return [Block((ours,))]
    settings = {"THRESHOLD": THRESHOLD, "PRINT_CONFIG": False}
    judges = metrics.HOTA(), metrics.CLEAR(settings), metrics.Identity(settings)

    def theirs(data: dict[str, Any]) -> list[Any]:
        return [judge.eval_sequence(data) for judge in judges]

    other = Case(WHAT, NAME, "trackeval", OBJECTS, 1, *_UNIT, lambda: _as_trackeval(scored), theirs)
    return [Block((ours, other), anchor=other)]


_UNIT = "ms per sequence", 1e3


def sequence(frames: int) -> Sequence:
    """Objects 3 m apart and tracks 0.2 m beside them, some missing, some swapped for good."""
    random = stream("bench-scoring", frames)
    place = np.column_stack([3.0 * np.arange(OBJECTS), np.zeros(OBJECTS)])
    truth = np.broadcast_to(place, (frames, OBJECTS, 2))
    identifier = np.empty((frames, OBJECTS), dtype=np.int64)
    current = np.arange(OBJECTS)
    for k in range(frames):
        if random.random() < SWAPPED:
            pair = random.choice(OBJECTS, 2, replace=False)
            current[pair] = current[pair[::-1]]
        identifier[k] = current
    frame = np.broadcast_to(np.arange(frames)[:, None], identifier.shape)
    found = random.random(identifier.shape) >= MISSED
    near = truth + random.normal(0.0, 0.2, truth.shape)
    objects = np.broadcast_to(np.arange(OBJECTS), identifier.shape)
    return sequence_from_rows(
        frame.ravel(),
        objects.ravel(),
        truth.reshape(-1, 2),
        frame[found],
        identifier[found],
        near[found],
        n_frames=frames,
    )


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
        "similarity_scores": [scored.frame_similarity(k).copy() for k in range(scored.n_frames)],
    }
