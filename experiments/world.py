"""One world: a scenario with a seed, simulated once, tracked by every filter, scored.

`run_world` is what a worker process does; it takes and returns plain data.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import polars as pl

from experiments.drift import drift, with_drift
from experiments.foreign import told_of
from experiments.occlusion import OcclusionProtocol
from experiments.population import GapTruth
from experiments.scoring import Scores, score
from mdkf import (
    DETECTORS,
    Detections,
    Estimator,
    Trace,
    Tracker,
    TrackerSettings,
    Tracks,
    estimator,
)
from scenarios import Scenario
from sim_bridge import SeedRefused, TraceCache, detect, simulate, write_table

BREAKDOWNS = ("phase", "regime", "range,level")
"""What every world's scores are broken down by; the last as Waymo's tables are."""


@dataclass(frozen=True)
class World:
    """What to do: simulate `scenario` with `seed`, detect, occlude, track with each of `filters`.

    settings: name of the tracker's settings. keep: folder for the world's tables, or None. cache:
    where its trace may be from, or None.
    """

    scenario: Scenario
    seed: int
    filters: Sequence[str]
    detector: str
    settings: str
    occlusion: OcclusionProtocol
    gap_truth: GapTruth = "keep"
    keep: Path | None = None
    cache: TraceCache | None = None


@dataclass(frozen=True)
class Outcome:
    """What came of a world: a row of scores for each filter, the errors around every gap
    (`gap_errors` with a column `drift`) and the scores by bin (`experiments.breakdown`), or the
    reason why the seed was refused."""

    scenario: str
    seed: int
    rows: list[dict[str, Any]] = field(default_factory=list)
    errors: pl.DataFrame = field(default_factory=pl.DataFrame)
    breakdown: pl.DataFrame = field(default_factory=pl.DataFrame)
    refused: str | None = None


def run_world(world: World) -> Outcome:
    """Run one world. Every filter gets the same detections."""
    name, seed = world.scenario.name, world.seed
    try:
        make = simulate if world.cache is None else world.cache.simulate
        trace = make(world.scenario, seed)
    except SeedRefused as refusal:
        return Outcome(name, seed, refused=str(refusal))
    detections = detect(trace, world.detector, seed)
    occluded = world.occlusion.apply(detections, trace)
    if world.keep is not None:
        world.keep.mkdir(parents=True, exist_ok=True)
        write_table(trace, world.keep / "trace.parquet")
        write_table(detections, world.keep / "detections.parquet")
    rows, errors, bins = [], [], []
    for filter_name in world.filters:
        one = follow(
            trace,
            occluded,
            estimator(filter_name),
            DETECTORS[world.settings],
            world.occlusion,
            world.gap_truth,
        )
        which = {"scenario": name, "seed": seed, "filter": filter_name}
        rows.append({**which, **one.summary()})
        labels = [pl.lit(value).alias(key) for key, value in which.items()]
        errors.append(one.errors.select(*labels, pl.all()))
        bins.append(one.scores.by(*BREAKDOWNS).select(*labels, pl.all()))
        if world.keep is not None:
            write_table(one.tracks, world.keep / f"tracks-{filter_name}.parquet")
    return Outcome(name, seed, rows, pl.concat(errors), pl.concat(bins))


@dataclass(frozen=True, eq=False)
class Followed:
    """What one filter made of a world's detections.

    errors: `experiments.phases.gap_errors` with the column `drift`, the filter's own error alone
    [m] (`experiments.drift`), in the first `length` frames of the gaps. ms_per_frame: the
    tracker's CPU time per frame [ms].
    """

    tracks: Tracks
    scores: Scores
    errors: pl.DataFrame
    ms_per_frame: float

    def summary(self) -> dict[str, float]:
        """`Scores.summary`, the mean `drift` in the gaps [m], and `ms_per_frame`."""
        in_gap = self.errors.filter(pl.col("phase") == "gap")["drift"].mean()
        drifted = in_gap if isinstance(in_gap, float) else math.nan
        return {**self.scores.summary(), "drift": drifted, "ms_per_frame": self.ms_per_frame}


def follow(
    trace: Trace,
    occluded: Detections,
    filter: Estimator,
    settings: TrackerSettings,
    occlusion: OcclusionProtocol,
    gap_truth: GapTruth = "keep",
) -> Followed:
    """Track occluded detections with one filter, and score it against the trace.

    Raises `RunFailed` for a filter of somebody else's that raises.
    """
    tracks, milliseconds = timed_tracks(filter, settings, occluded)
    scores = score(trace, tracks, occlusion, gap_truth)
    with told_of(filter):
        alone = drift(trace, occluded, scores.gaps, filter, settings)
    return Followed(
        tracks, scores, with_drift(scores.errors, alone, occlusion.length), milliseconds
    )


def timed_tracks(
    filter: Estimator, settings: TrackerSettings, detections: Detections
) -> tuple[Tracks, float]:
    """The tracks, and the tracker's CPU time per frame [ms] with its kernels already compiled.

    Raises `RunFailed` for a filter of somebody else's that raises.
    """
    tracker = Tracker(filter, settings)
    with told_of(filter):
        tracker.run(replace(detections.between(0, 3), n_frames=3))
        began = time.thread_time()
        tracks = tracker.run(detections)
    return tracks, 1e3 * (time.thread_time() - began) / max(detections.n_frames, 1)
