"""How far a filter itself drifts in each gap, with nothing else in play.

Each object's own detections go into the estimator, frame by frame, and none in the gap: perfect
association, no clutter, no deletion in the gap (before it, a track lost from sight for too long
starts anew, as in the tracker). Every gap counts for every filter, so that the comparison does not
depend on which tracks were captured or deleted, nor on which filters were run.
"""

import numpy as np
import polars as pl

from experiments.occlusion import Gaps
from mdkf import Detections, Estimator, Trace, TrackerSettings, filter_sequence
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
    hidden = np.zeros(measured.shape[:2], dtype=np.bool_)
    for identifier, start, stop in zip(gaps.object_id, gaps.start, gaps.stop, strict=True):
        hidden[start:stop, np.searchsorted(ids, identifier)] = True
    noise = np.diag([settings.x_var, settings.y_var])
    estimated = np.full(measured.shape, np.nan)
    born = _first_measured(measured, np.zeros(len(ids), dtype=np.int64))
    alive = np.flatnonzero(born < len(measured))
    while len(alive):
        # All lives begin in the first frame of a sequence of their own, as far as the scene goes.
        frame = np.arange(len(measured) - born[alive].min())[:, None] + born[alive]
        there = frame < len(measured)
        frame[~there] = 0
        own = np.where(there[..., None], measured[frame, alive], np.nan)
        found = filter_sequence(estimator, own, noise, trace.dt, predicted=True)
        variance = found.predicted.diagonal(axis1=2, axis2=3).max(axis=2)
        ended = (variance > settings.max_variance) & ~hidden[frame, alive]
        ended[0] = False
        lived = there & ~np.logical_or.accumulate(ended)
        at = frame[lived], np.broadcast_to(alive, lived.shape)[lived]
        estimated[at] = found.position[lived]
        # A life ends before the frame's measurement, which may be the next one's first.
        born[alive] = _first_measured(measured[:, alive], born[alive] + lived.sum(axis=0))
        alive = alive[born[alive] < len(measured)]
    error = np.hypot(*(estimated - _positions(trace, ids, trace.object_id)).transpose(2, 0, 1))
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


def _first_measured(measured: FloatArray, first: IntArray) -> IntArray:
    """The first frame from `first` on (n,) in which each object was measured (n_frames, n, 2); the
    number of frames where there is none."""
    frame = np.arange(len(measured))[:, None]
    there = np.isfinite(measured[..., 0]) & (frame >= first)
    found: IntArray = np.where(there, frame, len(measured)).min(axis=0, initial=len(measured))
    return found
