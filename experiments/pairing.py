"""The places of two tables into pairs: per frame the best one-to-one assignment of what is close.

Of all assignments of pairs with a distance d < reach it has the largest sum of reach^p - d^p. As no
frame knows of another, a place is assigned the same whatever happened before.
"""

import numpy as np
from numba import njit

from experiments.metrics.assignment import match_frame
from experiments.metrics.boxes import Pairs, similar_pairs
from mdkf.tables import FloatArray, IntArray

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
    pairs = similar_pairs("centre", truth_start, truth, track_start, track, reach)
    # The similarity is 1 - d / reach.
    gain = 1.0 - (1.0 - pairs.similarity) ** power
    chosen = _best_pairs(truth_start, track_start, pairs, gain)
    taken = np.flatnonzero(chosen != UNASSIGNED)
    row = np.full(len(track), UNASSIGNED)
    row[pairs.row[chosen[taken]]] = taken
    return row


@njit(cache=True)
def _best_pairs(
    truth_start: IntArray, track_start: IntArray, pairs: Pairs, gain: FloatArray
) -> IntArray:
    """The pair of each truth row (n_truth_rows,) in the assignment of the largest sum of gains."""
    chosen = np.full(truth_start[-1], UNASSIGNED)
    for frame in range(len(truth_start) - 1):
        match_frame(frame, truth_start, track_start, pairs, gain, chosen)
    return chosen
