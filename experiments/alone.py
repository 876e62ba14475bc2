"""Estimators alone: each object's own detections, frame by frame, into its own estimates.

Perfect association, no clutter, no tracker: what comes out is the filter's own doing. A track lost
from sight for too long starts anew, as in the tracker.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from mdkf import Detections, Estimator, Trace, TrackerSettings
from mdkf.estimator import join, take
from mdkf.tables import BoolArray, FloatArray, IntArray

SETTLED = 10
"""Frames in a row with a detection before one in which an estimate is settled: a second, after
which the start is no longer most of its error."""


@dataclass(frozen=True, eq=False)
class Step:
    """A frame with n followed objects.

    objects (n,): their places among all; predicted (n, 2): positions before this frame's
    measurement [m], NaN for those that are first seen in it; state: after it, batched over n.
    """

    frame: int
    objects: IntArray
    predicted: FloatArray
    state: Any


def steps(
    measured: FloatArray,
    dt: float,
    estimator: Estimator,
    settings: TrackerSettings,
    hidden: BoolArray | None = None,
) -> Iterator[Step]:
    """The frames in which objects are followed.

    measured (n_frames, n_objects, 2): their positions [m], NaN where not detected; dt [s]. hidden
    (n_frames, n_objects): where an object is followed whatever its variance; nowhere if None.
    """
    noise = np.tile(np.diag([settings.x_var, settings.y_var]), (measured.shape[1], 1, 1))
    seen = np.isfinite(measured[..., 0])
    state: Any = None
    alive = np.empty(0, dtype=np.int64)  # the object of each row of the state
    for k, now in enumerate(measured):
        predicted = np.full(now.shape, np.nan)
        if len(alive):
            state = estimator.predict(state, dt)
            variance = estimator.covariance(state).diagonal(axis1=1, axis2=2).max(axis=1)
            stays = variance <= settings.max_variance
            if hidden is not None:
                stays |= hidden[k, alive]
            if not stays.all():
                state, alive = take(state, np.flatnonzero(stays)), alive[stays]
        if len(alive):
            predicted[alive] = estimator.position(state)
            state = estimator.update(state, now[alive], noise[: len(alive)])
        new_here = seen[k].copy()
        new_here[alive] = False
        born = np.flatnonzero(new_here)
        if len(born):
            new = estimator.start(now[born], noise[: len(born)])
            state = join(state, new) if len(alive) else new
            alive = np.concatenate([alive, born])
        if len(alive):
            yield Step(k, alive, predicted[alive], state)


def run_lengths(measured: FloatArray) -> IntArray:
    """How many frames in a row, up to each, have a detection of each object (n_frames, n_objects);
    0 where it is not detected. measured (n_frames, n_objects, 2): NaN where not detected."""
    seen = np.isfinite(measured[..., 0])
    lengths = np.zeros(seen.shape, dtype=np.int64)
    so_far = np.zeros(seen.shape[1], dtype=np.int64)
    for k, now in enumerate(seen):
        so_far = lengths[k] = np.where(now, so_far + 1, 0)
    return lengths


def by_object(
    table: Trace | Detections, owner: IntArray, ids: IntArray, *columns: str
) -> FloatArray:
    """Columns of a table (n_frames, n_objects, n_columns) of some objects, NaN where they have no
    row. owner (rows,): the object of each row; ids (n_objects,), ascending."""
    values = np.full((table.n_frames, len(ids), len(columns)), np.nan)
    rows = np.flatnonzero(np.isin(owner, ids))
    place = np.searchsorted(ids, owner[rows])
    values[table.frame[rows], place] = np.column_stack([getattr(table, c)[rows] for c in columns])
    return values


def distance(estimated: FloatArray, true: FloatArray) -> FloatArray:
    """Distances (...) of positions (..., 2) [m]; NaN where one is."""
    off = estimated - true
    return np.hypot(off[..., 0], off[..., 1])
