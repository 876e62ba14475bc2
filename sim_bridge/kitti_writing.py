"""Tracks and detections into KITTI's text files, as its scorers and other trackers read them.

A row is what `Camera.boxes` has of a box: a file's numbers are exactly those in memory. Files
appear whole or not at all.
"""

from pathlib import Path

import numpy as np

from mdkf.tables import Detections, TableError, Trace, Tracks
from scenarios.kitti import PREFIX
from sim_bridge.kitti import recording_identity
from sim_bridge.kitti_files import read_sequences
from sim_bridge.kitti_image import DECIMALS, Camera, PictureBoxes, pictures
from sim_bridge.parquet import replacing


def write_boxes(path: Path, table: Detections | Tracks, boxes: PictureBoxes) -> None:
    """Write those boxes of a table that are in the picture, by frame; without any, an empty file.

    Tracks: `frame track_id Car -1 -1 alpha x1 y1 x2 y2 h w l x y z ry score`; detections the same
    without track_id. `OSError` where the file cannot be written.
    """
    score = np.round(table.score[boxes.row], DECIMALS)
    numbers = np.column_stack(
        [
            *(boxes.alpha, boxes.image, boxes.height, boxes.width, boxes.length),
            *(boxes.bottom, boxes.ry, score),
        ]
    )
    starts = [f"{frame} Car" for frame in boxes.frame.tolist()]
    if isinstance(table, Tracks):
        names = zip(boxes.frame.tolist(), table.track_id[boxes.row].tolist(), strict=True)
        starts = [f"{frame} {track} Car" for frame, track in names]
    form = " ".join([f"%.{DECIMALS}f"] * numbers.shape[1])
    lines = [
        f"{start} -1 -1 {form % tuple(values)}\n"
        for start, values in zip(starts, numbers.tolist(), strict=True)
    ]
    with replacing(path) as temporary:
        temporary.write_text("".join(lines), encoding="ascii")


def export_kitti(table: Trace | Detections | Tracks, root: Path, out: Path) -> Path:
    """Write detections or tracks of a recorded sequence as `out`/SSSS.txt, and tell where.

    root: the recordings that the table is of. Boxes are cut at the edges of the sequence's
    picture; those outside are left out.

    Raises `TableError` for a table that is not of a recorded sequence, or of none in `root`, and
    for a trace, whose labels are there already; `KittiError` for bad files, `OSError` where the
    file cannot be written.
    """
    name, source = (table.provenance.get(key, "") for key in ("scenario", "source"))
    if source != "kitti" or not name.startswith(PREFIX):
        raise TableError(
            f"the table is of {name or 'no known scenario'}, which has no camera: expected one of a"
            f" recorded scenario ({PREFIX}SSSS)"
        )
    sequence = name.removeprefix(PREFIX)
    if isinstance(table, Trace):
        raise TableError(
            f"the table is the trace of {name}, whose labels are {root}/label_02/{sequence}.txt:"
            " expected detections or tracks"
        )
    known = read_sequences(root)
    told = table.provenance.get("identity")
    if sequence not in known or told != recording_identity(root, sequence):
        raise TableError(f"the table is of {name} of other recordings than those in {root}")
    picture = pictures(root, [sequence])[sequence]
    camera = Camera.read(root, sequence, known[sequence], picture)
    path = out / f"{sequence}.txt"
    out.mkdir(parents=True, exist_ok=True)
    write_boxes(path, table, camera.boxes(table))
    return path
