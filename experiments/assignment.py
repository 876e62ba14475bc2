"""The places of two tables into pairs: per frame the best one-to-one assignment of what is close.

Of all assignments of pairs with a distance d < reach it has the largest sum of reach^p - d^p. As
no frame knows of another, a place is assigned the same whatever happened before.
"""

import math

import numpy as np
from numba import njit
from scipy.optimize import linear_sum_assignment

from mdkf.tables import BoolArray, FloatArray, IntArray

UNASSIGNED = -1


def assigned(
    truth_frame: IntArray,
    truth: FloatArray,
    track_frame: IntArray,
    track: FloatArray,
    n_frames: int,
    reach: float,
    power: float = 1.0,
) -> IntArray:
    """The truth row of every track row, `UNASSIGNED` where it has none: (n_track_rows,).

    truth_frame (n_truth_rows,), track_frame (n_track_rows,): in 0..n_frames-1, ascending. truth
    (n_truth_rows, 2), track (n_track_rows, 2) [m]. reach [m]; power p.
    """
    frames = np.arange(n_frames + 1)
    truth_start, track_start = (np.searchsorted(f, frames) for f in (truth_frame, track_frame))
    row, near, rivalled = _unrivalled(truth_start, truth, track_start, track, reach)
    # Where something has the choice between two, scipy decides.
    for k in rivalled:
        rows = truth_start[k] + np.flatnonzero(near[truth_start[k] : truth_start[k + 1]])
        own = slice(track_start[k], track_start[k + 1])
        d = truth[rows, None] - track[own]
        gain = np.maximum(reach**power - np.hypot(d[..., 0], d[..., 1]) ** power, 0.0)
        chosen, column = linear_sum_assignment(gain, maximize=True)
        taken = gain[chosen, column] > 0.0
        row[own] = UNASSIGNED
        row[own.start + column[taken]] = rows[chosen[taken]]
    return row


@njit(cache=True)
def _unrivalled(
    truth_start: IntArray,
    truth: FloatArray,
    track_start: IntArray,
    track: FloatArray,
    reach: float,
) -> tuple[IntArray, BoolArray, IntArray]:
    """The rows assigned where nobody has a choice, whether each truth row has a track within
    reach, and the frames in which something has a choice."""
    row = np.full(len(track), UNASSIGNED)
    near = np.zeros(len(truth), np.bool_)
    rivalled = np.zeros(len(truth_start) - 1, np.bool_)
    for k in range(len(truth_start) - 1):
        for i in range(truth_start[k], truth_start[k + 1]):
            for j in range(track_start[k], track_start[k + 1]):
                dx, dy = truth[i, 0] - track[j, 0], truth[i, 1] - track[j, 1]
                if abs(dx) < reach and abs(dy) < reach and math.hypot(dx, dy) < reach:
                    rivalled[k] |= near[i] or row[j] != UNASSIGNED
                    row[j] = i
                    near[i] = True
    return row, near, np.flatnonzero(rivalled)
