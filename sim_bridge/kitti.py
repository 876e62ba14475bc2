"""Recorded KITTI tracking data into the tables that simulations give: a trace, and detections.

How a box gets from a camera's axes into the world is told in `sim_bridge.kitti_rig`.
"""

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from mdkf.tables import (
    CLUTTER,
    KINDS,
    UNKNOWN_REGIME,
    BoolArray,
    Detections,
    EgoPath,
    FloatArray,
    IntArray,
    Trace,
)
from scenarios.kitti import FRAME_TIME
from sim_bridge.frames import frames_of
from sim_bridge.kitti_files import (
    CameraBoxes,
    KittiError,
    read_bytes,
    read_detections,
    read_labels,
    read_sequences,
    read_unlabelled,
)
from sim_bridge.kitti_rig import Rig, file_of
from sim_bridge.line_of_sight import CONTACT, visible_fractions

GATE = 2.0
"""Distance on the ground at which a detection no longer belongs to a label [m]."""

VIEW = 1.42
"""Angle of the picture in which cars are labelled and detections reported [rad]: 1242 pixels at a
focal length of 721."""

VISIBLE = ((0.8, 1.0), (0.4, 0.8), (0.05, 0.4), (0.05, 1.0))
"""Least and greatest visible fraction of KITTI's levels of occlusion: in full view, partly hidden,
largely hidden, unknown. KITTI gives no numbers; each level is taken as such a share."""

_DERIVATIVES = ("vx", "vy", "ax", "ay", "jx", "jy", "yaw_rate")


def kitti_trace(root: str | Path, sequence: str, dt: float = FRAME_TIME) -> Trace:
    """The labelled cars and vans of a recorded sequence, and the path of the LiDAR.

    root: the folder with `label_02`, `calib`, `pose` and the list of sequences; sequence: a name
    such as "0001"; dt: time between frames [s]. Objects have KITTI's track ids. Positions are
    human labels, not exact truth: derivatives are NaN and the regime is `unknown`. `visible` is
    computed from the labelled boxes as for simulated traces; since much that hides cars has no
    label, it is then brought within the bounds (`VISIBLE`) of the label's level of occlusion.

    Raises `KittiError` for an unknown sequence and for missing or malformed files, `TableError`
    for a `dt` that is no time.
    """
    root = Path(root)
    n_frames = _n_frames(root, sequence)
    path = file_of(root, "label_02", sequence)
    labels = read_labels(path, n_frames)
    rig = Rig.read(root, sequence, n_frames)
    provenance = {
        "scenario": f"kitti-{sequence}",
        "identity": recording_identity(root, sequence),
        "source": "kitti",
        "simulator": "recorded",
        "kinematics": "labels",
    }
    ego = EgoPath.from_columns(
        {"frame": np.arange(n_frames), **rig.lidar()},
        n_frames=n_frames,
        dt=dt,
        provenance=provenance,
    )
    n = len(labels.line)
    columns: dict[str, Any] = {
        "frame": labels.frame,
        "object_id": labels.last,
        "kind": np.array([KINDS.index(name.lower()) for name in labels.name], dtype=np.uint8),
        **rig.world_boxes(labels),
        **{name: np.full(n, np.nan) for name in _DERIVATIVES},
        "regime": np.full(n, UNKNOWN_REGIME),
        "turning": np.zeros(n),
    }
    _refuse_sensor_inside(path, labels, columns, ego)
    trace = Trace.from_columns(
        {**columns, "visible": np.zeros(n)},
        n_frames=n_frames,
        dt=dt,
        ego=ego,
        provenance=provenance,
    )
    order = np.lexsort((labels.last, labels.frame))
    bounds = np.array(VISIBLE)[labels.occluded[order]].T
    return replace(trace, visible=np.clip(visible_fractions(*frames_of(trace)), *bounds))


def kitti_detections(
    root: str | Path,
    detector: str | Path,
    sequence: str,
    dt: float = FRAME_TIME,
    unlabelled: bool = True,
) -> Detections:
    """The recorded detections of a sequence, in the world frame of its trace.

    detector: the name of a folder in the root's `detections`, or the path of any folder of such
    files; root, sequence and dt as for `kitti_trace`; unlabelled: whether to keep boxes of no label
    that lie in an area where nothing is labelled, so that nobody knows whether they are false.
    `source` is the track id of the label that the box belongs to, `CLUTTER` for none: in each
    frame one to one, so that the sum of 1 - d / `GATE` over the pairs nearer than `GATE` on the
    ground is greatest. Scores are the detector's raw ones.

    Raises `KittiError` as `kitti_trace`, and for an unknown detector.
    """
    root = Path(root)
    trace = kitti_trace(root, sequence, dt)
    folder = detector if isinstance(detector, Path) else _known_detector(root, detector)
    path = folder / f"{sequence}.txt"
    found = read_detections(path, trace.n_frames)
    boxes = Rig.read(root, sequence, trace.n_frames).world_boxes(found)
    source = _sources(found.frame, np.column_stack([boxes["x"], boxes["y"]]), trace)
    kept = np.ones(len(source), dtype=np.bool_)
    if not unlabelled:
        areas = read_unlabelled(file_of(root, "label_02", sequence), trace.n_frames)
        kept = (source != CLUTTER) | ~_within(found, *areas)
    columns = {"frame": found.frame, **boxes, "score": found.last, "source": source}
    return Detections.from_columns(
        {name: values[kept] for name, values in columns.items()},
        n_frames=trace.n_frames,
        dt=dt,
        provenance={
            **trace.provenance,
            "detector": folder.name,
            "detections": hashlib.sha256(read_bytes(path)).hexdigest(),
            "trace": trace.content_hash(),
        },
    )


def in_view(ego: EgoPath, frame: IntArray, x: FloatArray, y: FloatArray) -> BoolArray:
    """Which places x, y [m], (n,), are in the picture's direction in their frames (n,)."""
    bearing = np.arctan2(y - ego.y[frame], x - ego.x[frame]) - ego.yaw[frame]
    seen: BoolArray = np.abs(np.angle(np.exp(1j * bearing))) < VIEW / 2
    return seen


def _known_detector(root: Path, detector: str) -> Path:
    folder = root / "detections"
    known = sorted(path.name for path in folder.glob("*") if path.is_dir())
    if detector not in known:
        raise KittiError(
            f"{folder}: unknown detector {detector[:40]!r}; known: {', '.join(known) or 'none'}"
        )
    return folder / detector


def _n_frames(root: Path, sequence: str) -> int:
    known = read_sequences(root)
    if sequence not in known:
        raise KittiError(
            f"{root}: unknown sequence {sequence[:40]!r}; known: {', '.join(known) or 'none'}"
        )
    return known[sequence]


def recording_identity(root: Path, sequence: str) -> str:
    """SHA-256 of the sequence's name and of the files that its trace is made of."""
    digest = hashlib.sha256(sequence.encode())
    for folder in ("label_02", "calib", "pose"):
        digest.update(hashlib.sha256(read_bytes(file_of(root, folder, sequence))).digest())
    return digest.hexdigest()


def _refuse_sensor_inside(
    path: Path, labels: CameraBoxes, boxes: dict[str, Any], ego: EgoPath
) -> None:
    """Raise at the first label whose footprint holds the sensor: nothing could be seen of it."""
    dx, dy = ego.x[labels.frame] - boxes["x"], ego.y[labels.frame] - boxes["y"]
    cosine, sine = np.cos(boxes["yaw"]), np.sin(boxes["yaw"])
    along = np.abs(cosine * dx + sine * dy) - labels.length / 2
    across = np.abs(cosine * dy - sine * dx) - labels.width / 2
    inside = np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0)) <= CONTACT
    if inside.any():
        row = int(np.argmax(inside))
        raise KittiError(
            f"{path}: line {labels.line[row]}: the box holds the LiDAR that sees it in frame"
            f" {labels.frame[row]}"
        )


def _within(found: CameraBoxes, frame: IntArray, area: FloatArray) -> BoolArray:
    """Which boxes (n,) lie in one of the areas (m, 4) of their frame with more than half of their
    own area in the picture, as KITTI's scorer has it."""
    left, top, right, bottom = found.image.T
    size = np.maximum((right - left) * (bottom - top), 1e-9)
    inside = np.zeros(len(size), dtype=np.bool_)
    for k, (x1, y1, x2, y2) in zip(frame, area, strict=True):
        here = slice(*np.searchsorted(found.frame, [k, k + 1]))
        width = np.minimum(right[here], x2) - np.maximum(left[here], x1)
        height = np.minimum(bottom[here], y2) - np.maximum(top[here], y1)
        common = np.maximum(width, 0.0) * np.maximum(height, 0.0)
        inside[here] |= common > 0.5 * size[here]
    return inside


def _sources(frame: IntArray, place: FloatArray, trace: Trace) -> IntArray:
    """Track ids (n,), or `CLUTTER`, of detections at place (n, 2) [m]; frames ascend."""
    sources = np.full(len(frame), CLUTTER, dtype=np.int64)
    starts = np.searchsorted(frame, np.arange(trace.n_frames + 1))
    labelled = np.column_stack([trace.x, trace.y])
    for k in range(trace.n_frames):
        mine, rows = slice(starts[k], starts[k + 1]), trace.frame_rows(k)
        apart = place[mine, None] - labelled[None, rows]
        nearness = np.maximum(1.0 - np.hypot(apart[..., 0], apart[..., 1]) / GATE, 0.0)
        a, b = linear_sum_assignment(nearness, maximize=True)
        near = nearness[a, b] > 0.0
        sources[starts[k] + a[near]] = trace.object_id[rows][b[near]]
    return sources
