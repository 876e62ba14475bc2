"""Three filters in gaps of two seconds: python occlusion_experiment.py [FOLDER]."""

import sys
from pathlib import Path

import polars as pl

import experiments
import mdkf
import scenarios
import sim_bridge
from experiments.plots import error_over_time

trace = sim_bridge.simulate(scenarios.load("bus_stop"), seed=0)
detections = sim_bridge.detect(trace, detector="pointrcnn", seed=0)

# 20 consecutive detections of every object with enough of them are removed; nothing else changes.
gap = experiments.OcclusionProtocol(kind="mid", length=20, warmup=35)
seen = gap.apply(detections)
print(f"{len(gap.gaps(detections))} gaps, {len(detections) - len(seen)} detections removed")

tracks, parts = {}, []
for name in ("ca", "imm", "md"):
    tracks[name] = mdkf.Tracker(mdkf.estimator(name)).run(seen)
    scores = experiments.score(trace, tracks[name], gap)
    parts.append(scores.errors.with_columns(filter=pl.lit(name)))

# One row for each gap and frame: the error [m] of the track that followed the object into the gap,
# by what the object was really doing as the gap began. A single seed: no claim stands on this.
errors = pl.concat(parts)
in_gap = errors.filter(pl.col("phase") == "gap", pl.col("error").is_not_null())
print(
    in_gap.pivot("filter", index="regime", values="error", aggregate_function="mean").sort("regime")
)

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "mdkf-out/occlusion_experiment")
folder.mkdir(parents=True, exist_ok=True)
errors.write_parquet(folder / "errors.parquet")

# One that moved, of those that all three filters followed to the end of a gap of just 20 frames.
exact = in_gap.filter(pl.col("gap_stop") - pl.col("gap_start") == gap.length)
moved = exact.filter(pl.col("regime") != "stationary").group_by("object_id")
followed = moved.agg(pl.len(), pl.col("filter").n_unique()).filter(filter=3)
subject = followed.sort("len", "object_id")["object_id"][-1]
error_over_time(trace, tracks, subject).savefig(folder / "one_gap.png")
