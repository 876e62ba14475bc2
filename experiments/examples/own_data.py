"""Your own detections through the tracker: python own_data.py [FOLDER]."""

import sys
from pathlib import Path

import numpy as np
import polars as pl

import experiments
import mdkf
import sim_bridge

# Stand-ins for what your detector found: three cars at 8, 10 and 12 m/s for 5 s at 10 Hz, measured
# with a standard deviation of 0.15 m. Rows may be in any order, positions in any fixed frame.
rng = np.random.default_rng(0)
frame, car = np.divmod(np.arange(150), 3)
columns = {
    "frame": frame,
    "x": 0.1 * frame * (8 + 2 * car) + rng.normal(0, 0.15, 150),  # box centre [m]
    "y": 4.0 * car + rng.normal(0, 0.15, 150),
    "z": np.full(150, 0.8),
    "yaw": np.zeros(150),  # counter-clockwise from x [rad]
    "length": np.full(150, 4.5),
    "width": np.full(150, 1.8),
    "height": np.full(150, 1.5),
    "score": np.full(150, 5.0),  # as your detector gives it
    "source": np.full(150, -1),  # whose box it is, -1: nobody knows; no tracker sees it
}
detections = mdkf.Detections.from_columns(columns, n_frames=50, dt=0.1)
print(detections.describe())

# The rules are those for a detector; any can be replaced. The noise is yours to know.
tracker = mdkf.Tracker(
    mdkf.MotionDynamics(), "pointrcnn", x_var=0.15**2, y_var=0.15**2, validity=10
)
tracks = tracker.run(detections)

# polars, or anything that reads Parquet, goes on from here.
table = sim_bridge.to_polars(tracks)
by_track = table.group_by("track_id").agg(pl.len().alias("frames"), pl.col("vx").last())
print(by_track.sort("track_id"))
folder = Path(sys.argv[1] if len(sys.argv) > 1 else "mdkf-out/own_data")
folder.mkdir(parents=True, exist_ok=True)
table.write_csv(folder / "tracks.csv")
sim_bridge.write_table(tracks, folder / "tracks.parquet")
experiments.plot(tracks).savefig(folder / "tracks.png")
