"""How far a filter itself drifts in each gap, with nothing else in play.

Each object's own detections go into the estimator, frame by frame, and none in the gap: perfect
association, no deletion, no clutter. Every gap counts for every filter, so that the comparison
does not depend on which tracks were captured or deleted, nor on which filters were run.
"""

from typing import Any

import numpy as np
import polars as pl

from experiments.occlusion import Gaps
from mdkf import Detections, Estimator, Trace, TrackerSettings
from mdkf.estimator import join
from mdkf.tables import FloatArray, IntArray


def drift(
    trace: Trace, occluded: Detections, gaps: Gaps, estimator: Estimator, settings: TrackerSettings
) -> pl.DataFrame:
    """Distance of the estimated from the true position [m] of the objects with gaps.

    One row for each object and frame, from its first detection to its last frame of truth:
    object_id, frame, drift. occluded: the detections without those in the gaps.
    """
    ids = np.sort(gaps.object_id)
    measured = _positions(occluded, ids, occluded.source)
    true = _positions(trace, ids, trace.object_id)
    noise = np.diag([settings.x_var, settings.y_var])
    # Objects join the batch at their first detection; those never seen do not.
    seen = np.isfinite(measured[:, :, 0])
    first = np.where(seen.any(axis=0), seen.argmax(axis=0), trace.n_frames)
    order = np.argsort(first, kind="stable")
    estimated = np.full(true.shape, np.nan)
    state: Any = None
    n = 0
    for k in range(trace.n_frames):
        joined = int(np.searchsorted(first[order], k, side="right"))
        rows = order[:joined]
        if n:
            state = estimator.predict(state, trace.dt)
            z = np.ascontiguousarray(measured[k, rows[:n]])
            state = estimator.update(state, z, np.broadcast_to(noise, (n, 2, 2)))
        if joined > n:
            z = np.ascontiguousarray(measured[k, rows[n:]])
            new = estimator.start(z, np.broadcast_to(noise, (joined - n, 2, 2)))
            state = new if state is None else join(state, new)
            n = joined
        if n:
            estimated[k, rows] = estimator.position(state)
    error = np.hypot(*(estimated - true).transpose(2, 0, 1))
    frame, place = np.nonzero(np.isfinite(error))
    columns = {"object_id": ids[place], "frame": frame, "drift": error[frame, place]}
    return pl.DataFrame(columns)


def _positions(table: Trace | Detections, ids: IntArray, owner: IntArray) -> FloatArray:
    """Positions (n_frames, n_objects, 2) [m] of some objects, NaN where they have no row."""
    positions = np.full((table.n_frames, len(ids), 2), np.nan)
    rows = np.flatnonzero(np.isin(owner, ids))
    place = np.searchsorted(ids, owner[rows])
    positions[table.frame[rows], place] = np.column_stack([table.x[rows], table.y[rows]])
    return positions
