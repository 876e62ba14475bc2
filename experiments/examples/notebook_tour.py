"""What to do with tables in a notebook: python notebook_tour.py [FOLDER].

In a notebook each table, score and picture shows itself as the last line of a cell; this script
writes them to files.
"""

import sys
from pathlib import Path

import polars as pl

import experiments
import mdkf
import scenarios
import sim_bridge
from experiments.plots import birds_eye, weights_over_time

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "mdkf-out/notebook_tour")
folder.mkdir(parents=True, exist_ok=True)
trace = sim_bridge.simulate(scenarios.load("merge"), seed=1)
gap = experiments.OcclusionProtocol("mid", 20)
seen = gap.apply(sim_bridge.detect(trace, seed=1))
tracks = {name: mdkf.Tracker(mdkf.estimator(name)).run(seen) for name in ("imm", "md")}
scores = experiments.score(trace, tracks["md"])

# What is in it? A cell that ends with a table's name shows this.
shown = "<hr>".join(told._repr_html_() for told in (trace, seen, tracks["md"], scores))
(folder / "tables.html").write_text(f"<!DOCTYPE html><meta charset=utf-8>{shown}")

# One call for each picture.
experiments.plot(trace).savefig(folder / "trace.png")
experiments.plot(tracks, trace).savefig(folder / "errors.png")
birds_eye(trace, seen, tracks["md"], frame=150).savefig(folder / "frame.png")
weights_over_time(tracks["md"], trace=trace).savefig(folder / "weights.png")

# polars: what is the mean speed of each kind of road user?
frame = sim_bridge.to_polars(trace)
speed = (pl.col("vx") ** 2 + pl.col("vy") ** 2).sqrt().mean().alias("speed")
print(frame.group_by("kind").agg(speed, pl.col("object_id").n_unique()).sort("kind"))
print(scores.to_polars().select("hota", "mota", "idf1", "error_gap"))

# And back: the first ten seconds, or any other edit, checked as they enter.
first = frame.filter(pl.col("frame") < 100)
print(sim_bridge.from_polars(mdkf.Trace, first, like=trace))
