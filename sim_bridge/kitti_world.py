"""Simulated worlds into the files of KITTI's tracking benchmark, for other trackers and scorers.

    label_02, calib, pose, oxts /SSSS.txt     truth, and the sensor (`sim_bridge.virtual_camera`)
    detections/DETECTOR/SSSS.txt              as RobMOT reads them
    robmot/kitti/LiDAR/training/              calib and pose as RobMOT reads them
    ab3dmot/DETECTOR_Car_val/SSSS.txt         as AB3DMOT reads them
    tracks/NAME/data/SSSS.txt                 as trackers write them and TrackEval reads them
    evaluate_tracking.seqmap.training, .val   the sequences

The LiDAR sees all around, KITTI's camera only ahead. Boxes in space are written all around. What is
not in the picture has the box `NOWHERE` there, and labels of it are truncated (2): KITTI's scorer
compares boxes in the picture, and ignores both. So its scores are of what the camera sees.

The detector does not tell kinds, every detection and track is a `Car`. Cars and vans have labels
that count as KITTI has it; on the boxes of all others, whose labels tell their types, lies a
`DontCare` area, where tracks are neither right nor wrong. So are those of cars out of reach, which
KITTI leaves without labels, too.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from mdkf.tables import (
    KINDS,
    BoolArray,
    Detections,
    FloatArray,
    IntArray,
    TableError,
    Trace,
    Tracks,
)
from scenarios.kitti import FRAME_TIME
from sim_bridge.kitti import VISIBLE
from sim_bridge.kitti_files import SEQUENCES, UNLABELLED
from sim_bridge.kitti_image import DECIMALS, Camera, PictureBoxes
from sim_bridge.kitti_rig import file_of
from sim_bridge.kitti_writing import place, rows, write_boxes, write_text
from sim_bridge.virtual_camera import (
    calibration_text,
    oxts_text,
    poses_text,
    robmot_calibration_text,
    virtual_camera,
)

TYPES: Mapping[str, str] = {
    "car": "Car",
    "van": "Van",
    "truck": "Truck",
    "bus": "Misc",  # KITTI knows none
    "bicycle": "Cyclist",
    "pedestrian": "Pedestrian",
}
"""KITTI's types of the kinds of road users."""

COUNTED = ("car", "van")
"""Kinds whose labels KITTI's scorer of cars reads."""

AB3DMOT_CAR = 2
"""AB3DMOT's number of the type Car."""

_NOTHING = "-1000.000000 -1000.000000 -1000.000000 -10.000000 -1.000000 -1.000000 -1.000000"
"""h w l x y z ry of an area without labels, in the order in which KITTI writes them."""


def write_kitti_world(
    out: Path,
    sequence: str,
    trace: Trace,
    detections: Mapping[str, Detections],
    tracks: Mapping[str, Tracks],
    reach: float,
) -> None:
    """Write a simulated world as a sequence; `write_sequences` lists it.

    detections and tracks: by the names of their folders. reach: distance from the sensor within
    which objects have labels [m].

    Raises `TableError` for a world that has not KITTI's time between frames, which its files do not
    tell; `OSError` where a file cannot be written.
    """
    if trace.dt != FRAME_TIME:
        raise TableError(
            f"the trace has frames of {trace.dt} s, expected {FRAME_TIME} s: KITTI's files do not"
            " tell the time"
        )
    ego, camera = trace.ego, virtual_camera(trace.ego)
    write_text(place(file_of(out, "calib", sequence)), calibration_text())
    write_text(place(file_of(out, "pose", sequence)), poses_text(ego))
    robmot = out / "robmot" / "kitti" / "LiDAR" / "training"
    write_text(place(file_of(robmot, "calib", sequence)), robmot_calibration_text())
    write_text(place(file_of(robmot, "pose", sequence)), poses_text(ego))
    write_text(place(file_of(out, "oxts", sequence)), oxts_text(ego))
    write_text(place(file_of(out, "label_02", sequence)), _labels(trace, camera, reach))
    for name, found in detections.items():
        boxes = camera.boxes(found, around=True)
        write_boxes(place(file_of(out / "detections", name, sequence)), found, boxes)
        path = place(file_of(out / "ab3dmot", f"{name}_Car_val", sequence))
        write_text(path, _as_ab3dmot(found, boxes))
    for name, table in tracks.items():
        path = place(file_of(out / "tracks" / name, "data", sequence))
        write_boxes(path, table, camera.boxes(table, around=True))


def write_sequences(out: Path, frames: Mapping[str, int]) -> None:
    """Write the lists of sequences, as training and as validation data.

    frames: number of frames by the name of each sequence.
    """
    text = "".join(f"{name} empty 000000 {count:06d}\n" for name, count in frames.items())
    for split in ("training", "val"):
        write_text(place(out / f"{SEQUENCES}{split}"), text)


def occlusion_levels(visible: FloatArray) -> IntArray:
    """KITTI's level of occlusion of visible fractions (n,): 0 full view, 1 partly, 2 largely hidden
    (`sim_bridge.kitti.VISIBLE`), and 3, unknown, of what hardly anything can be seen of."""
    least = np.array([low for low, _ in VISIBLE[:3]])
    levels: IntArray = np.sum(visible[:, None] < least, axis=1)
    return levels


def _labels(trace: Trace, camera: Camera, reach: float) -> str:
    """Labels and areas without labels, frame by frame."""
    users = trace.take(trace.road_users())
    near: BoolArray = users.sensor_distance() <= reach
    labelled = users.take(near)
    kinds = [KINDS[code] for code in labelled.kind.tolist()]
    told = zip(
        labelled.frame.tolist(),
        labelled.object_id.tolist(),
        kinds,
        camera.truncation(labelled).tolist(),
        occlusion_levels(labelled.visible).tolist(),
        strict=True,
    )
    begins = [
        f"{frame} {identifier} {TYPES[kind]} {truncated} {occluded}"
        for frame, identifier, kind, truncated, occluded in told
    ]
    counted = np.isin(users.kind, [KINDS.index(kind) for kind in COUNTED])
    areas = camera.boxes(users.take(~(near & counted)))
    texts = [
        f"{frame} -1 {UNLABELLED} -1 -1 -10.000000"
        f" {' '.join(f'{pixel:.{DECIMALS}f}' for pixel in image)} {_NOTHING}\n"
        for frame, image in zip(areas.frame.tolist(), areas.image.tolist(), strict=True)
    ]
    texts += rows(begins, camera.boxes(labelled, around=True))
    order = np.argsort(np.concatenate([areas.frame, labelled.frame]), kind="stable")
    return "".join(texts[k] for k in order.tolist())


def _as_ab3dmot(found: Detections, boxes: PictureBoxes) -> str:
    """frame, type, x1, y1, x2, y2, score, h, w, l, x, y, z, ry, alpha."""
    score = np.round(found.score[boxes.row], DECIMALS)
    columns = [boxes.image, score, boxes.height, boxes.width, boxes.length]
    numbers = np.column_stack([*columns, boxes.bottom, boxes.ry, boxes.alpha]).tolist()
    return "".join(
        f"{frame},{AB3DMOT_CAR},{','.join(f'{value:.{DECIMALS}f}' for value in row)}\n"
        for frame, row in zip(boxes.frame.tolist(), numbers, strict=True)
    )
