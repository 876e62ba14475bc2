"""Detections to tracks: gated bird's-eye distance, greedy global minimum (RobMOT)."""

import numpy as np
from numba import njit

from mdkf.tables import BoolArray, FloatArray, IntArray

UNMATCHED = -1


@njit(cache=True)
def associate(predicted: FloatArray, measured: FloatArray, gate: float) -> IntArray:
    """The detection of each track, `UNMATCHED` where there is none: (n_tracks,).

    predicted (n_tracks, 2), measured (n_detections, 2) [m]. The closest pair of all is matched
    first, then the closest of what remains, as long as it is strictly closer than the gate [m].
    Of equal distances the first track's, then the first detection's pair wins.
    """
    match = np.full(len(predicted), UNMATCHED, dtype=np.int64)
    taken = np.zeros(len(measured), dtype=np.bool_)
    pairs = 0
    for t in range(len(predicted)):
        for d in range(len(measured)):
            pairs += _distance(predicted[t], measured[d]) < gate
    pair = np.empty((pairs, 2), dtype=np.int64)
    distance = np.empty(pairs)
    n = 0
    for t in range(len(predicted)):
        for d in range(len(measured)):
            length = _distance(predicted[t], measured[d])
            if length < gate:
                # Insertion sort: the gate leaves few pairs, and equal ones keep their order.
                k = n
                while k > 0 and distance[k - 1] > length:
                    distance[k] = distance[k - 1]
                    pair[k, 0], pair[k, 1] = pair[k - 1, 0], pair[k - 1, 1]
                    k -= 1
                distance[k], pair[k, 0], pair[k, 1] = length, t, d
                n += 1
    for k in range(pairs):
        t, d = pair[k, 0], pair[k, 1]
        if match[t] == UNMATCHED and not taken[d]:
            match[t] = d
            taken[d] = True
    return match


@njit(cache=True)
def within_gate(measured: FloatArray, tracks: FloatArray, gate: float) -> BoolArray:
    """Whether each detection (n_detections, 2) is strictly closer to some track than the gate."""
    near = np.zeros(len(measured), dtype=np.bool_)
    for d in range(len(measured)):
        for t in range(len(tracks)):
            if _distance(tracks[t], measured[d]) < gate:
                near[d] = True
                break
    return near


@njit(cache=True)
def _distance(a: FloatArray, b: FloatArray) -> float:
    return float(np.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2))
