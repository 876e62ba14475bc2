"""Scores of the pairs of a frame into matches: the one-to-one choice of the highest sum.

Shortest augmenting paths (Crouse, On Implementing 2D Rectangular Assignment Algorithms, IEEE Trans.
Aerospace and Electronic Systems 52, 2016), in the order of operations and with the choice between
equals of `scipy.optimize.linear_sum_assignment` on the dense matrix: where several assignments cost
the same, scores depend on which one is taken, and TrackEval takes scipy's.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from experiments.metrics.boxes import Floats, Ints, Pairs

_BEYOND_ROUNDING = 1e-9
"""Costs of some thousands at most: sums of a path's costs are rounded by far less than this."""


@njit(cache=True, error_model="numpy")
def match_frame(
    frame: int,
    truth_start: Ints,
    track_start: Ints,
    pairs: Pairs,
    score: Floats,
    matched: Ints,
) -> None:
    """Write into `matched` (n_truth_rows,) the pairs in which the rows of `frame` are matched.

    score: (n_pairs,) 0 or more; a frame's other pairs of rows score 0 and are left at -1.
    """
    first, last = truth_start[frame], truth_start[frame + 1]
    first_track, n_tracks = track_start[frame], track_start[frame + 1] - track_start[frame]
    begin, end = pairs.start[first], pairs.start[last]
    matched[first:last] = assign(
        last - first,
        n_tracks,
        pairs.start[first : last + 1] - begin,
        pairs.row[begin:end] - first_track,
        -score[begin:end],
    )
    for row in range(first, last):
        if matched[row] >= 0:
            matched[row] += begin


@njit(cache=True, error_model="numpy")
def assign(n_rows: int, n_columns: int, start: Ints, column: Ints, cost: Floats) -> Ints:
    """(n_rows,) index of the entry that each row gets, -1 for none or for one that is not listed.

    Args:
        n_rows, n_columns: shape of the matrix.
        start: (n_rows + 1,) row i has the entries start[i]:start[i + 1].
        column: of each entry, rising within a row; what is not listed is 0.
        cost: of each entry, at most 0.
    """
    chosen = np.full(n_rows, -1)
    if n_columns < n_rows:
        turned_start, turned_column, entry = _transposed(n_rows, n_columns, start, column)
        for k in _cheapest(n_columns, n_rows, turned_start, turned_column, cost[entry]):
            if k >= 0:
                chosen[turned_column[k]] = entry[k]
    else:
        chosen[:] = _cheapest(n_rows, n_columns, start, column, cost)
    return chosen


@njit(cache=True, error_model="numpy")
def _transposed(n_rows: int, n_columns: int, start: Ints, column: Ints) -> tuple[Ints, Ints, Ints]:
    """The same matrix by columns: offsets, row of each entry, and which entry it was."""
    turned_start = np.zeros(n_columns + 1, np.int64)
    for j in column:
        turned_start[j + 1] += 1
    for j in range(n_columns):
        turned_start[j + 1] += turned_start[j]
    place = turned_start[:-1].copy()
    row, entry = np.empty(len(column), np.int64), np.empty(len(column), np.int64)
    for i in range(n_rows):
        for k in range(start[i], start[i + 1]):
            row[place[column[k]]], entry[place[column[k]]] = i, k
            place[column[k]] += 1
    return turned_start, row, entry


@njit(cache=True, error_model="numpy")
def _cheapest(n_rows: int, n_columns: int, start: Ints, column: Ints, cost: Floats) -> Ints:
    """`assign` of a matrix with at least as many columns as rows."""
    u, v = np.zeros(n_rows), np.zeros(n_columns)
    column_of, row_of = np.full(n_rows, -1), np.full(n_columns, -1)
    dense = np.zeros(n_columns)
    shortest = np.empty(n_columns)
    before, remaining = np.empty(n_columns, np.int64), np.empty(n_columns, np.int64)
    visited = np.empty(n_columns, np.int64)
    for row in range(n_rows):
        lowest, sink = _first_step(start[row], start[row + 1], column, cost, v, row_of)
        if lowest < -_BEYOND_ROUNDING and row_of[sink] < 0:
            # No column outside the row's entries costs less than nothing: no path is shorter.
            u[row], column_of[row], row_of[sink] = lowest, sink, row
            continue
        for place in range(n_columns):
            remaining[place] = n_columns - 1 - place
            shortest[place] = np.inf
        n_remaining, n_visited = n_columns, 0
        i, lowest, sink = row, 0.0, -1
        while sink < 0:
            for k in range(start[i], start[i + 1]):
                dense[column[k]] = cost[k]
            so_far, lowest, chosen = lowest, np.inf, -1
            for place in range(n_remaining):
                j = remaining[place]
                length = so_far + dense[j] - u[i] - v[j]
                if length < shortest[j]:
                    shortest[j] = length
                    before[j] = i
                if shortest[j] < lowest or (shortest[j] == lowest and row_of[j] < 0):
                    lowest = shortest[j]
                    chosen = place
            for k in range(start[i], start[i + 1]):
                dense[column[k]] = 0.0
            j = remaining[chosen]
            if row_of[j] < 0:
                sink = j
            else:
                i = row_of[j]
                visited[n_visited] = j
                n_visited += 1
            n_remaining -= 1
            remaining[chosen] = remaining[n_remaining]
        u[row] += lowest
        for j in visited[:n_visited]:
            u[row_of[j]] += lowest - shortest[j]
            v[j] -= lowest - shortest[j]
        j = sink
        while True:
            i = before[j]
            row_of[j] = i
            column_of[i], j = j, column_of[i]
            if i == row:
                break
    chosen_entry = np.full(n_rows, -1)
    for i in range(n_rows):
        for k in range(start[i], start[i + 1]):
            if column[k] == column_of[i]:
                chosen_entry[i] = k
    return chosen_entry


@njit(cache=True, error_model="numpy")
def _first_step(
    first: int, last: int, column: Ints, cost: Floats, v: Floats, row_of: Ints
) -> tuple[float, int]:
    """Lowest reduced cost of a new row's entries, and its column: of equals the first free one."""
    lowest, best = 0.0, -1
    for k in range(first, last):
        reduced = cost[k] - v[column[k]]
        if reduced < lowest or (reduced == lowest and best >= 0 and row_of[best] >= 0):
            lowest, best = reduced, column[k]
    return lowest, best
