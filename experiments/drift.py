"""How far a filter itself drifts in each gap, with nothing else in play.

Each object's own detections go into the estimator, frame by frame, and none in the gap: perfect
association, no clutter, no deletion in the gap (before it, a track lost from sight for too long
starts anew, as in the tracker). Every gap counts for every filter, so that the comparison does not
depend on which tracks were captured or deleted, nor on which filters were run.
"""

from typing import Any

import numpy as np
import polars as pl

from experiments.occlusion import Gaps
from mdkf import Detections, Estimator, Trace, TrackerSettings
from mdkf.estimator import join, take
from mdkf.tables import FloatArray, IntArray


def drift(
    trace: Trace, occluded: Detections, gaps: Gaps, estimator: Estimator, settings: TrackerSettings
) -> pl.DataFrame:
    """Distance of the estimated from the true position [m] of the objects with gaps.

    One row for each object and frame in which it is followed: object_id, frame, drift.
    occluded: the detections without those in the gaps.
    """
    ids = np.unique(gaps.object_id)
    measured = _positions(occluded, ids, occluded.source)
    true = _positions(trace, ids, trace.object_id)
    hidden = np.zeros(measured.shape[:2], dtype=np.bool_)
    for identifier, start, stop in zip(gaps.object_id, gaps.start, gaps.stop, strict=True):
        hidden[start:stop, np.searchsorted(ids, identifier)] = True
    noise = np.diag([settings.x_var, settings.y_var])
    unborn = np.isfinite(measured[:, :, 0])  # what would start a filter
    estimated = np.full(true.shape, np.nan)
    state: Any = None
    alive = np.empty(0, dtype=np.int64)  # the object of each row of the state
    for k in range(trace.n_frames):
        if len(alive):
            state = estimator.predict(state, trace.dt)
            variance = estimator.covariance(state).diagonal(axis1=1, axis2=2).max(axis=1)
            kept = np.flatnonzero((variance <= settings.max_variance) | hidden[k, alive])
            if len(kept) < len(alive):
                state, alive = take(state, kept), alive[kept]
        if len(alive):
            z = np.ascontiguousarray(measured[k, alive])
            state = estimator.update(state, z, np.broadcast_to(noise, (len(z), 2, 2)))
        unborn[k, alive] = False
        born = np.flatnonzero(unborn[k])
        if len(born):
            z = np.ascontiguousarray(measured[k, born])
            new = estimator.start(z, np.broadcast_to(noise, (len(z), 2, 2)))
            state = join(state, new) if len(alive) else new
            alive = np.concatenate([alive, born])
        if len(alive):
            estimated[k, alive] = estimator.position(state)
    error = np.hypot(*(estimated - true).transpose(2, 0, 1))
    frame, place = np.nonzero(np.isfinite(error))
    columns = {"object_id": ids[place], "frame": frame, "drift": error[frame, place]}
    return pl.DataFrame(columns)


def with_drift(errors: pl.DataFrame, drifts: pl.DataFrame, length: int) -> pl.DataFrame:
    """`gap_errors` with the column `drift` of the same objects and frames, null where there is
    none, and past the first `length` frames of a gap: a natural absence can stretch it to minutes,
    and the experiment is about `length` frames."""
    both = errors.join(drifts, on=["object_id", "frame"], how="left", maintain_order="left")
    stretched = (pl.col("phase") == "gap") & (pl.col("offset") >= length)
    return both.with_columns(drift=pl.when(~stretched).then("drift"))


def _positions(table: Trace | Detections, ids: IntArray, owner: IntArray) -> FloatArray:
    """Positions (n_frames, n_objects, 2) [m] of some objects, NaN where they have no row."""
    positions = np.full((table.n_frames, len(ids), 2), np.nan)
    rows = np.flatnonzero(np.isin(owner, ids))
    place = np.searchsorted(ids, owner[rows])
    positions[table.frame[rows], place] = np.column_stack([table.x[rows], table.y[rows]])
    return positions
