"""Tracks and detections into KITTI's text files, as its scorers and other trackers read them.

A row is what `Camera.boxes` has of a box: a file's numbers are exactly those in memory. Files
appear whole or not at all.
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from mdkf.tables import Detections, FloatArray, TableError, Trace, Tracks
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
    starts = [f"{frame} Car" for frame in boxes.frame.tolist()]
    if isinstance(table, Tracks):
        names = zip(boxes.frame.tolist(), table.track_id[boxes.row].tolist(), strict=True)
        starts = [f"{frame} {track} Car" for frame, track in names]
    begins = [f"{start} -1 -1" for start in starts]
    write_text(path, "".join(rows(begins, boxes, table.score[boxes.row])))


def rows(begins: Iterable[str], boxes: PictureBoxes, score: FloatArray | None = None) -> list[str]:
    """Lines of boxes behind what each begins with: alpha x1 y1 x2 y2 h w l x y z ry [score]."""
    columns = [boxes.alpha, boxes.image, boxes.height, boxes.width, boxes.length]
    columns += [boxes.bottom, boxes.ry]
    columns += [] if score is None else [np.round(score, DECIMALS)]
    numbers = np.column_stack(columns)
    form = " ".join([f"%.{DECIMALS}f"] * numbers.shape[1])
    values = numbers.tolist()
    return [f"{begin} {form % tuple(row)}\n" for begin, row in zip(begins, values, strict=True)]


def write_text(path: Path, text: str) -> None:
    """Write a file, whole or not at all."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def place(path: Path) -> Path:
    """The path, the folders to it made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


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
