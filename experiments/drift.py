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
from experiments.occlusion import Gaps
from mdkf import Detections, Estimator, Trace, TrackerSettings
from mdkf.tables import IntArray


def drift(
    trace: Trace, occluded: Detections, gaps: Gaps, estimator: Estimator, settings: TrackerSettings
) -> pl.DataFrame:
    """Distance of the estimated from the true position [m] of the objects with gaps.

    One row for each object and frame in which it is followed: object_id, frame, drift.
    occluded: the detections without those in the gaps.
    """
    ids = np.unique(gaps.object_id)
    true = by_object(trace, trace.object_id, ids, "x", "y")
    estimated = np.full(true.shape, np.nan)
    for k, place, state in followed(occluded, gaps, ids, estimator, settings):
        estimated[k, place] = estimator.position(state)
    error = distance(estimated, true)
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
    measured = by_object(occluded, occluded.source, ids, "x", "y")
    hidden = np.zeros(measured.shape[:2], dtype=np.bool_)
    for identifier, start, stop in zip(gaps.object_id, gaps.start, gaps.stop, strict=True):
        hidden[start:stop, np.flatnonzero(ids == identifier)] = True
    for step in steps(measured, occluded.dt, estimator, settings, hidden):
        yield step.frame, step.objects, step.state


def with_drift(errors: pl.DataFrame, drifts: pl.DataFrame, length: int) -> pl.DataFrame:
    """`gap_errors` with the column `drift` of the same objects and frames, null where there is
    none, and past the first `length` frames of a gap: a natural absence can stretch it to minutes,
    and the experiment is about `length` frames."""
    both = errors.join(drifts, on=["object_id", "frame"], how="left", maintain_order="left")
    stretched = (pl.col("phase") == "gap") & (pl.col("offset") >= length)
    return both.with_columns(drift=pl.when(~stretched).then("drift"))
