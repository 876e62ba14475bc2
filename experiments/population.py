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
from mdkf.tables import BoolArray, IntArray, Trace, Tracks

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

    Each frame's tracks are assigned to all of its truth, at most 2 m away: a track counts as its
    object does. A track that belongs to nothing counts (against the filter) within the range;
    a wall is nothing.
    """
    if gap_truth not in get_args(GapTruth):
        raise ValueError(f"gap truth {gap_truth!r}, expected one of {get_args(GapTruth)}")
    distance = trace.sensor_distance()
    in_gap = gaps.covers(trace.object_id, trace.frame)
    seen = trace.visible >= SCORED_VISIBLE
    road_users = trace.road_users()
    counted = road_users & (distance <= SCORED_RANGE) & (seen | in_gap)
    if gap_truth == "ignore":
        counted &= ~in_gap
    ego = trace.ego
    away = np.hypot(tracks.x - ego.x[tracks.frame], tracks.y - ego.y[tracks.frame])
    scored = away <= SCORED_RANGE
    for k in np.unique(tracks.frame):
        truth_rows, track_rows = trace.frame_rows(int(k)), tracks.frame_rows(int(k))
        track, row = _assigned(trace, tracks, truth_rows, track_rows, road_users[truth_rows])
        scored[track] = counted[row]
    return Population(counted, scored)


def _assigned(
    trace: Trace, tracks: Tracks, truth_rows: slice, track_rows: slice, road_users: BoolArray
) -> tuple[IntArray, IntArray]:
    """Rows of tracks and of the truth that the best assignment of one frame gives them."""
    dx = trace.x[truth_rows][:, None] - tracks.x[track_rows]
    dy = trace.y[truth_rows][:, None] - tracks.y[track_rows]
    closeness = np.maximum(MATCH_DISTANCE - np.hypot(dx, dy), 0.0)
    near = np.flatnonzero(closeness.any(axis=1) & road_users)
    chosen, track = linear_sum_assignment(closeness[near], maximize=True)
    taken = closeness[near[chosen], track] > 0
    return track_rows.start + track[taken], truth_rows.start + near[chosen[taken]]
