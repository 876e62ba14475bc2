"""KITTI tracking files made by hand: sequence 0003, and what a detector `mine` found in it."""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from mdkf.tables import FloatArray

# The LiDAR looks along the camera's axis, 0.08 m above and 0.27 m behind it.
PLAIN = np.array([[0, -1, 0, 0], [0, 0, -1, -0.08], [1, 0, 0, -0.27]])
STILL = np.eye(3, 4)
LEFT = np.array([[0, -1, 0, 10], [1, 0, 0, 2], [0, 0, 1, 0.5]])  # turned left, moved
CAR = (1.5, 1.8, 4.5)  # h, w, l [m]


def numbers(values: ArrayLike) -> str:
    return " ".join(f"{v:.17g}" for v in np.ravel(values))


def label(
    frame: int, track: int, place: ArrayLike, ry: float, kind: str = "Car", occluded: int = 0
) -> str:
    """One line of a label file: middle of the bottom face x, y, z [m] in camera axes, ry [rad],
    level of occlusion."""
    values = numbers([*CAR, *np.ravel(place), ry])
    return f"{frame} {track} {kind} 0 {occluded} -10 0 0 9 9 {values}"


def detection(frame: int, place: ArrayLike, ry: float, score: float) -> str:
    """One line of a file of detections."""
    values = numbers([*CAR, *np.ravel(place), ry, score])
    return f"{frame} Car -1 -1 -10 0 0 9 9 {values}"


Files = dict[str, list[str]]


def files(
    labels: list[str],
    detections: list[str] | None = None,
    poses: list[FloatArray] | None = None,
    rectification: FloatArray = STILL[:, :3],
    mounting: FloatArray = PLAIN,
) -> Files:
    """The files of sequence 0003 and of detector `mine`, as lines."""
    poses = [STILL, LEFT] if poses is None else poses
    return {
        "evaluate_tracking.seqmap.training": [f"0003 empty 000000 {len(poses):06d}"],
        "label_02/0003.txt": labels,
        "calib/0003.txt": [
            f"P2: {numbers(np.eye(3, 4))}",
            f"R0_rect: {numbers(rectification)}",
            f"Tr_velo_to_cam: {numbers(mounting)}",
            "",
        ],
        "pose/0003.txt": [f"{k} {numbers(pose)}" for k, pose in enumerate(poses)],
        "detections/mine/0003.txt": detections or [],
    }


def written(folder: Path, content: Files) -> Path:
    for name, lines in content.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("".join(f"{line}\n" for line in lines))
    return folder


GOOD = files(
    [label(0, 1, (3, 1.65, 20), 0.0), label(1, 1, (3, 1.65, 20), 0.0)],
    [detection(0, (3, 1.65, 20), 0.0, 5.0), detection(1, (3, 1.65, 20), 0.0, 6.0)],
)
LABELS, FOUND = "label_02/0003.txt", "detections/mine/0003.txt"
POSES, CALIBRATION = "pose/0003.txt", "calib/0003.txt"
SEQUENCES = "evaluate_tracking.seqmap.training"
