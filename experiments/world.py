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
from experiments.occlusion import OcclusionProtocol
from experiments.population import GapTruth
from experiments.score import score
from mdkf import DETECTORS, Detections, Tracker, TrackerSettings, Tracks, estimator
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
    """Run one world. Every filter gets the same detections.

    To the scores of each filter come `ms_per_frame`, the tracker's CPU time per frame [ms], and
    `drift`, the filter's own mean error in the first `length` frames of the gaps [m]
    (`experiments.drift`).
    """
    name, seed = world.scenario.name, world.seed
    try:
        make = simulate if world.cache is None else world.cache.simulate
        trace = make(world.scenario, seed)
    except SeedRefused as refusal:
        return Outcome(name, seed, refused=str(refusal))
    detections = detect(trace, world.detector, seed)
    occluded = world.occlusion.apply(detections)
    if world.keep is not None:
        world.keep.mkdir(parents=True, exist_ok=True)
        write_table(trace, world.keep / "trace.parquet")
        write_table(detections, world.keep / "detections.parquet")
    rows, errors, bins = [], [], []
    for filter_name in world.filters:
        tracks, milliseconds = timed_tracks(filter_name, world.settings, occluded)
        scores = score(trace, tracks, world.occlusion, world.gap_truth)
        alone = drift(
            trace, occluded, scores.gaps, estimator(filter_name), DETECTORS[world.settings]
        )
        both = with_drift(scores.errors, alone, world.occlusion.length)
        in_gap = both.filter(pl.col("phase") == "gap")["drift"].mean()
        which = {"scenario": name, "seed": seed, "filter": filter_name}
        row = {**which, **scores.summary(), "drift": math.nan if in_gap is None else in_gap}
        rows.append({**row, "ms_per_frame": milliseconds})
        labels = [pl.lit(value).alias(key) for key, value in which.items()]
        errors.append(both.select(*labels, pl.all()))
        bins.append(scores.by(*BREAKDOWNS).select(*labels, pl.all()))
        if world.keep is not None:
            write_table(tracks, world.keep / f"tracks-{filter_name}.parquet")
    return Outcome(name, seed, rows, pl.concat(errors), pl.concat(bins))


def timed_tracks(
    filter_name: str, settings: str | TrackerSettings, detections: Detections
) -> tuple[Tracks, float]:
    """The tracks, and the tracker's CPU time per frame [ms] with its kernels already compiled."""
    tracker = Tracker(estimator(filter_name), settings)
    tracker.run(replace(detections.between(0, 3), n_frames=3))
    began = time.thread_time()
    tracks = tracker.run(detections)
    return tracks, 1e3 * (time.thread_time() - began) / max(detections.n_frames, 1)
