"""How far a filter itself drifts in each gap, with nothing else in play.

Each object's own detections go into the estimator (`experiments.alone`), and none in the gap, where
nothing is deleted. Every gap counts for every filter, so that the comparison does not depend on
which tracks were captured or deleted, nor on which filters were run.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
import polars as pl

from experiments.alone import by_object, distance, steps
from experiments.gaps import Gaps
from mdkf import Detections, Estimator, Trace, TrackerSettings, filter_sequence
from mdkf.tables import BoolArray, FloatArray, IntArray


def drift(
    trace: Trace, occluded: Detections, gaps: Gaps, estimator: Estimator, settings: TrackerSettings
) -> pl.DataFrame:
    """Distance of the estimated from the true position [m] of the objects with gaps.

    One row for each object and frame in which it is followed: object_id, frame, drift.
    occluded: the detections without those in the gaps. The numbers are those of `followed`, to the
    bit, in compiled passes over all objects at once.
    """
    ids = np.unique(gaps.object_id)
    measured, hidden = _seen_and_hidden(occluded, gaps, ids)
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
    error = distance(estimated, by_object(trace, trace.object_id, ids, "x", "y"))
    frame, place = np.nonzero(np.isfinite(error))
    columns = {"object_id": ids[place], "frame": frame, "drift": error[frame, place]}
    return pl.DataFrame(columns)


def followed(
    occluded: Detections,
    gaps: Gaps,
    ids: IntArray,
    estimator: Estimator,
    settings: TrackerSettings,
) -> Iterator[tuple[int, IntArray, Any]]:
    """After each frame in which any of some objects is followed: its number, the objects that are
    (places in the ascending `ids`), and the estimator's states of them.

    occluded: the detections without those in the gaps.
    """
    measured, hidden = _seen_and_hidden(occluded, gaps, ids)
    for step in steps(measured, occluded.dt, estimator, settings, hidden):
        yield step.frame, step.objects, step.state


def with_drift(errors: pl.DataFrame, drifts: pl.DataFrame, length: int) -> pl.DataFrame:
    """`gap_errors` with the column `drift` of the same objects and frames, null where there is
    none, and past the first `length` frames of a gap: a natural absence can stretch it to minutes,
    and the experiment is about `length` frames."""
    both = errors.join(drifts, on=["object_id", "frame"], how="left", maintain_order="left")
    stretched = (pl.col("phase") == "gap") & (pl.col("offset") >= length)
    return both.with_columns(drift=pl.when(~stretched).then("drift"))


def _seen_and_hidden(
    occluded: Detections, gaps: Gaps, ids: IntArray
) -> tuple[FloatArray, BoolArray]:
    """Measured positions (n_frames, n_objects, 2) [m], and where the objects are in a gap."""
    measured = by_object(occluded, occluded.source, ids, "x", "y")
    hidden = np.zeros(measured.shape[:2], dtype=np.bool_)
    for identifier, start, stop in gaps.rows():
        hidden[start:stop, np.flatnonzero(ids == identifier)] = True
    return measured, hidden


def _first_measured(measured: FloatArray, first: IntArray) -> IntArray:
    """The first frame from `first` on (n,) in which each object was measured (n_frames, n, 2); the
    number of frames where there is none."""
    frame = np.arange(len(measured))[:, None]
    there = np.isfinite(measured[..., 0]) & (frame >= first)
    found: IntArray = np.where(there, frame, len(measured)).min(axis=0, initial=len(measured))
    return found
