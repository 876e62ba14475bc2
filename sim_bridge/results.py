"""Result files of other trackers into `Tracks` in the world frame.

KITTI's (`frame id type truncated occluded alpha x1 y1 x2 y2 h w l x y z ry score`, spaces) have
boxes in the axes of the camera of their frame, MOTChallenge's (`frame,id,left,top,w,h,conf` and up
to three columns more, commas) rectangles in the picture from above (`sim_bridge.mot`). Neither
tells velocities, covariances or which frames were coasted: `Tracks` says that they are unknown.
Nor are heights, headings and sizes known from above, or of a KITTI row whose ry is -10 (RobMOT's).
"""

import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from mdkf.tables import Detections, TableError, Trace, Tracks
from scenarios.kitti import PREFIX, kitti_root
from sim_bridge.kitti_files import read_results as read_kitti
from sim_bridge.kitti_rig import Rig
from sim_bridge.mot import BirdPicture, read_mot
from sim_bridge.text_table import lines, read_bytes
from sim_bridge.virtual_camera import virtual_camera


def read_results(
    path: str | Path,
    trace: Trace,
    detections: Detections | None = None,
    root: str | Path | None = None,
) -> Tracks:
    """A tracker's results of one sequence: MOTChallenge's if there are commas, else KITTI's.

    trace: what was tracked; detections: what the tracker was given, if known, of which the tracks'
    provenance tells the gaps then; root: the recordings, if the trace is one (by default
    `scenarios.kitti.kitti_root`).

    Raises `KittiError`, one line that names the file and its line, for malformed files, and
    `TableError` for detections of another trace.
    """
    path = Path(path)
    told = trace.provenance if detections is None else detections.provenance
    if detections is not None and told.get("trace") != trace.content_hash():
        raise TableError("the detections come from another trace (its content hash differs)")
    if any("," in line for line in lines(path)[:1]):
        columns = _from_mot(path, trace)
    else:
        columns = _from_kitti(path, trace, Path(root or kitti_root()))
    n = len(columns["frame"])
    unknown = {name: np.full(n, np.nan) for names in Tracks.UNKNOWN for name in names}
    return Tracks.from_columns(
        {**unknown, **columns, "coasted": np.zeros(n, dtype=np.bool_)},
        n_frames=trace.n_frames,
        dt=trace.dt,
        provenance={
            **told,
            "trace": trace.content_hash(),
            "estimator": f"read from {path.name}",
            "results": hashlib.sha256(read_bytes(path)).hexdigest(),
            "coasted": "unknown",
        },
    )


def _from_kitti(path: Path, trace: Trace, root: Path) -> dict[str, Any]:
    """Columns that KITTI's files tell."""
    track_id, boxes, known = read_kitti(path, trace.n_frames)
    if trace.provenance.get("source") == "kitti":
        sequence = trace.provenance["scenario"].removeprefix(PREFIX)
        rig = Rig.read(root, sequence, trace.n_frames)
    else:
        rig = virtual_camera(trace.ego).rig
    told = {"frame": boxes.frame, "track_id": track_id, "score": boxes.last}
    columns = rig.world_boxes(boxes)
    for name in Tracks.BOX:
        columns[name] = np.where(known, columns[name], np.nan)
    return {**told, **columns}


def _from_mot(path: Path, trace: Trace) -> dict[str, Any]:
    """Columns that MOTChallenge's files tell."""
    found = read_mot(path, trace.n_frames)
    x, y = BirdPicture.of(trace.ego).middles(found.box).T
    told = {"frame": found.frame, "track_id": found.track_id, "score": found.score}
    return {**told, "x": x, "y": y}
