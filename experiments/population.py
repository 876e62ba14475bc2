"""Which rows of truth and tracks a score is about.

Truth counts where the object is within range and visible, and in a protocol's gap (or not there,
by the other convention). What does not count is ignored, as KITTI ignores DontCare: a track on it
is neither right nor wrong.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from experiments.gaps import Gaps
from experiments.pairing import UNASSIGNED, assigned
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
    """The rows that count: masks over the trace's and the tracks' rows.

    object_row: (n_track_rows,) the truth row of the road user, counted or not, that the track is
    on; `UNASSIGNED` where it is on none.
    """

    truth: BoolArray
    tracks: BoolArray
    object_row: IntArray


def population(trace: Trace, tracks: Tracks, gaps: Gaps, gap_truth: GapTruth) -> Population:
    """Rows to score; `gap_truth` says whether truth in the protocol's gaps is kept or ignored.

    Each frame's tracks are assigned to all of its truth, at most 2 m away: a track counts as its
    object does. A track that belongs to nothing counts (against the filter) within the range;
    a wall is nothing.
    """
    counted, ego = counted_truth(trace, gaps, gap_truth), trace.ego
    away = np.hypot(tracks.x - ego.x[tracks.frame], tracks.y - ego.y[tracks.frame])
    scored = away <= SCORED_RANGE
    # Nothing farther away than this is close to any track.
    farthest = away.max(initial=0.0) + MATCH_DISTANCE
    candidates = np.flatnonzero(trace.road_users() & (trace.sensor_distance() <= farthest))
    object_row = _objects(trace, tracks, candidates)
    on_one = object_row != UNASSIGNED
    scored[on_one] = counted[object_row[on_one]]
    return Population(counted, scored, object_row)


def counted_truth(trace: Trace, gaps: Gaps, gap_truth: GapTruth = "keep") -> BoolArray:
    """Rows of the truth (n_rows,) that count, as a mask."""
    if gap_truth not in get_args(GapTruth):
        raise ValueError(f"gap truth {gap_truth!r}, expected one of {get_args(GapTruth)}")
    in_gap = gaps.covers(trace.object_id, trace.frame)
    seen = trace.visible >= SCORED_VISIBLE
    counted = trace.road_users() & (trace.sensor_distance() <= SCORED_RANGE) & (seen | in_gap)
    return counted & ~in_gap if gap_truth == "ignore" else counted


def naturally_occluded(trace: Trace, gaps: Gaps) -> BoolArray:
    """The truth rows of road users within range that do not count because they are hidden from
    view: outside the protocol's gaps."""
    near = trace.road_users() & (trace.sensor_distance() <= SCORED_RANGE)
    return near & (trace.visible < SCORED_VISIBLE) & ~gaps.covers(trace.object_id, trace.frame)


def _objects(trace: Trace, tracks: Tracks, candidates: IntArray) -> IntArray:
    """The truth row that each track row is on, of the given ones."""
    row = assigned(
        trace.frame[candidates],
        np.column_stack([trace.x[candidates], trace.y[candidates]]),
        tracks.frame,
        np.column_stack([tracks.x, tracks.y]),
        trace.n_frames,
        MATCH_DISTANCE,
    )
    # The last place, which -1 takes, stands for no object.
    return np.append(candidates, UNASSIGNED)[row]
