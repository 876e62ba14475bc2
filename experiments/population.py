"""Which rows of truth and tracks a score is about.

Truth counts where the object is within range and visible, and in a protocol's gap (or not there,
by the other convention). What does not count is ignored, as KITTI ignores DontCare: a track on it
is neither right nor wrong.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from scipy.optimize import linear_sum_assignment

from experiments.occlusion import Gaps
from mdkf.tables import BoolArray, Trace, Tracks

GapTruth = Literal["keep", "ignore"]

SCORED_RANGE = 60.0
"""Distance from the sensor within which truth counts [m]: inside the detector's reach."""

SCORED_VISIBLE = 0.15
"""Visible fraction from which truth counts: what a person would still label."""

MATCH_DISTANCE = 2.0
"""Distance at which a track has nothing to do with an object any more [m]."""


@dataclass(frozen=True, eq=False)
class Population:
    """The rows that count: masks over the trace's and the tracks' rows."""

    truth: BoolArray
    tracks: BoolArray


def population(trace: Trace, tracks: Tracks, gaps: Gaps, gap_truth: GapTruth) -> Population:
    """Rows to score; `gap_truth` says whether truth in the protocol's gaps is kept or ignored.

    Tracks that are assigned to ignored truth, at most 2 m from it, or that lie out of range, are
    not scored either.
    """
    if gap_truth not in get_args(GapTruth):
        raise ValueError(f"gap truth {gap_truth!r}, expected one of {get_args(GapTruth)}")
    distance = trace.sensor_distance()
    in_gap = gaps.covers(trace.object_id, trace.frame)
    seen = trace.visible >= SCORED_VISIBLE
    counted = (distance <= SCORED_RANGE) & (seen | in_gap)
    if gap_truth == "ignore":
        counted &= ~in_gap
    ego = trace.ego
    away = np.hypot(tracks.x - ego.x[tracks.frame], tracks.y - ego.y[tracks.frame])
    scored = away <= SCORED_RANGE
    for k in np.unique(tracks.frame[scored]):
        truth_rows, track_rows = trace.frame_rows(int(k)), tracks.frame_rows(int(k))
        scored[track_rows] &= ~_on_ignored(trace, tracks, truth_rows, track_rows, counted)
    return Population(counted, scored)


def _on_ignored(
    trace: Trace, tracks: Tracks, truth_rows: slice, track_rows: slice, counted: BoolArray
) -> BoolArray:
    """Tracks of one frame that the best assignment to all of its truth puts on ignored rows."""
    dx = trace.x[truth_rows][:, None] - tracks.x[track_rows]
    dy = trace.y[truth_rows][:, None] - tracks.y[track_rows]
    closeness = np.maximum(MATCH_DISTANCE - np.hypot(dx, dy), 0.0)
    ignored = ~counted[truth_rows]
    on_ignored = np.zeros(closeness.shape[1], dtype=np.bool_)
    near = closeness.any(axis=1)
    if not (near & ignored).any():
        return on_ignored
    rows = np.flatnonzero(near)
    chosen, track = linear_sum_assignment(closeness[rows], maximize=True)
    taken = closeness[rows[chosen], track] > 0
    on_ignored[track[taken]] = ignored[rows[chosen[taken]]]
    return on_ignored
