"""Worlds into MOTChallenge's files, and its rectangles back into the world.

    BENCHMARK-train/SSSS/gt/gt.txt     frame,id,left,top,w,h,counts,class,visibility,x,y,z
    BENCHMARK-train/SSSS/det/det.txt   frame,-1,left,top,w,h,score,x,y,z
    BENCHMARK-train/SSSS/seqinfo.ini   frames, frame rate, picture
    seqmaps/BENCHMARK-train.txt        the sequences
    trackers/BENCHMARK-train/NAME/data/SSSS.txt    frame,id,left,top,w,h,score,-1,-1,-1

Frames count from 1. The picture is the scene seen from above, in which nothing hides anything, the
LiDAR sees all around and the sensor's own motion is out of play. World x is right, y up; a box is
the upright rectangle about its footprint, by `PIXELS_PER_METRE`. x, y, z is its centre [m].

MOTChallenge's scorer knows one class that counts, 1 (pedestrian): it stands for every road user
that counts. Those that do not are distractors (8), a track on which is neither right nor wrong.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mdkf.tables import BoolArray, Detections, EgoPath, FloatArray, IntArray, Trace, Tracks
from sim_bridge.kitti_image import DECIMALS
from sim_bridge.kitti_writing import place, write_text
from sim_bridge.text_table import TextTable

BENCHMARK = "mdkf"
SPLIT = f"{BENCHMARK}-train"

PIXELS_PER_METRE = 10.0

MARGIN = 150.0
"""Of the picture around the sensor's path [m], beyond any detector's reach. What of the truth is
farther away has rectangles beyond the picture's edges."""

COUNTS, DISTRACTOR = 1, 8
"""Classes of what counts and of what is ignored."""

_COLUMNS = ("frame", "id", "left", "top", "w", "h", "conf", "x", "y", "z")
_LEAST_COLUMNS = 7


@dataclass(frozen=True)
class BirdPicture:
    """The scene from above: where its left and top edges are in the world [m], and its size [m]."""

    left: float
    top: float
    width: float
    height: float

    @staticmethod
    def of(ego: EgoPath) -> "BirdPicture":
        """Of whatever is around a sensor's path, in whole metres."""
        left, right = np.floor(ego.x.min()) - MARGIN, np.ceil(ego.x.max()) + MARGIN
        bottom, top = np.floor(ego.y.min()) - MARGIN, np.ceil(ego.y.max()) + MARGIN
        return BirdPicture(float(left), float(top), float(right - left), float(top - bottom))

    def rectangles(self, table: Trace | Detections | Tracks) -> FloatArray:
        """Left, top, width, height (n, 4) [px] about a table's boxes; the first pixel is 1."""
        cosine, sine = np.abs(np.cos(table.yaw)), np.abs(np.sin(table.yaw))
        across = table.length * cosine + table.width * sine
        down = table.length * sine + table.width * cosine
        left, top = table.x - across / 2 - self.left, self.top - table.y - down / 2
        corner = 1.0 + PIXELS_PER_METRE * np.column_stack([left, top])
        return np.column_stack([corner, PIXELS_PER_METRE * across, PIXELS_PER_METRE * down])

    def middles(self, box: FloatArray) -> FloatArray:
        """World x, y (n, 2) [m] of the middles of rectangles (n, 4) [px]."""
        middle = (box[:, :2] + box[:, 2:] / 2 - 1.0) / PIXELS_PER_METRE
        return np.column_stack([self.left + middle[:, 0], self.top - middle[:, 1]])


@dataclass(frozen=True, eq=False)
class MotRows:
    """A tracker's results, frames from 0. box (n, 4): left, top, width, height [px]."""

    frame: IntArray
    track_id: IntArray
    box: FloatArray
    score: FloatArray


def read_mot(path: Path, n_frames: int) -> MotRows:
    """A tracker's results; `KittiError` for malformed rows. What follows `conf` is passed over."""
    columns = TextTable.width(path, ",")
    names = _COLUMNS[: max(_LEAST_COLUMNS, min(columns, len(_COLUMNS)))]
    table = TextTable.read(path, names, separator=",")
    frame = table.whole("frame", 1, n_frames) - 1
    for name in "wh":
        table.refuse(table.column(name) <= 0.0, name, "a size above 0 px")
    box = np.column_stack([table.column(name) for name in ("left", "top", "w", "h")])
    return MotRows(frame, table.refuse_repeated("id"), box, table.column("conf"))


def write_mot_world(
    out: Path,
    sequence: str,
    trace: Trace,
    detections: Detections | None,
    tracks: Mapping[str, Tracks],
    counts: BoolArray,
) -> None:
    """Write a world as a sequence; `write_mot_sequences` lists it.

    counts (n,): which rows of the trace count. tracks: by the names of their folders. `OSError`
    where a file cannot be written.
    """
    picture, folder = BirdPicture.of(trace.ego), out / SPLIT / sequence
    users = np.flatnonzero(trace.road_users())
    truth, counted = trace.take(users), counts[users]
    classes = np.where(counted, COUNTS, DISTRACTOR)
    ends = np.column_stack([truth.visible, truth.x, truth.y, truth.z])
    middle = [f"{int(flag)},{kind}" for flag, kind in zip(counted, classes, strict=True)]
    write_text(
        place(folder / "gt" / "gt.txt"), _rows(truth, truth.object_id, picture, middle, ends)
    )
    if detections is not None:
        places = np.column_stack([detections.x, detections.y, detections.z])
        nobody = np.full(len(detections), -1)
        scores = _scores(detections)
        text = _rows(detections, nobody, picture, scores, places)
        write_text(place(folder / "det" / "det.txt"), text)
    for name, table in tracks.items():
        # Not the place: TrackEval takes the eighth column of a result for its class.
        nowhere = [f"{score},-1,-1,-1" for score in _scores(table)]
        text = _rows(table, table.track_id, picture, nowhere, np.empty((len(table), 0)))
        write_text(place(out / "trackers" / SPLIT / name / "data" / f"{sequence}.txt"), text)
    size = PIXELS_PER_METRE * np.array([picture.width, picture.height])
    information = {
        "name": sequence,
        "imDir": "img1",
        "frameRate": f"{1 / trace.dt:g}",
        "seqLength": trace.n_frames,
        "imWidth": f"{size[0]:.0f}",
        "imHeight": f"{size[1]:.0f}",
        "imExt": ".jpg",
    }
    entries = "".join(f"{key}={value}\n" for key, value in information.items())
    write_text(place(folder / "seqinfo.ini"), f"[Sequence]\n{entries}")


def write_mot_sequences(out: Path, sequences: Mapping[str, int]) -> None:
    """Write the list of sequences; their lengths are in their own files."""
    write_text(place(out / "seqmaps" / f"{SPLIT}.txt"), "\n".join(["name", *sequences]) + "\n")


def _scores(table: Detections | Tracks) -> list[str]:
    return [f"{score:.{DECIMALS}f}" for score in table.score.tolist()]


def _rows(
    table: Trace | Detections | Tracks,
    identifier: IntArray,
    picture: BirdPicture,
    middle: list[str],
    ends: FloatArray,
) -> str:
    """A line for each row: frame, id, rectangle, what is in the middle, numbers at the end."""
    starts = zip((table.frame + 1).tolist(), identifier.tolist(), strict=True)
    boxes = picture.rectangles(table).tolist()
    parts = zip(starts, boxes, middle, ends.tolist(), strict=True)
    return "".join(
        ",".join([*map(str, start), *map(_number, box), text, *map(_number, end)]) + "\n"
        for start, box, text, end in parts
    )


def _number(value: float) -> str:
    return f"{value:.{DECIMALS}f}"
