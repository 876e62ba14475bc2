"""Recorded KITTI tracking sequences as scenarios: `kitti-0001`, wherever the recordings are.

Only what a listing needs is read here; `sim_bridge.kitti` reads and checks the files themselves.
"""

import os
from pathlib import Path

from scenarios.scenario import KittiScenario, ScenarioError

VARIABLE = "MDKF_KITTI"
"""Environment variable that names the folder with `label_02`, `calib`, `pose` and `detections`."""

PREFIX = "kitti-"
FRAME_TIME = 0.1
"""Time between the frames of a recording [s]."""

SENSOR_HEIGHT = 1.73
"""Height of KITTI's LiDAR above the road [m] (Geiger et al., 2013): the cameras are at 1.65 m, and
by the calibration the LiDAR is 0.08 m above them."""

_BESIDE_THE_SOURCES = Path(__file__).resolve().parents[2] / "shared" / "kitti"


def kitti_root() -> Path:
    """The folder that the environment names, or `../shared/kitti` as seen from the sources."""
    return Path(os.environ.get(VARIABLE) or _BESIDE_THE_SOURCES)


def kitti_names() -> tuple[str, ...]:
    """The recorded sequences that are there, as scenario names, sorted; none without the data."""
    return tuple(f"{PREFIX}{path.stem}" for path in sorted(kitti_root().glob("pose/*.txt")))


def kitti_scenario(name: str) -> KittiScenario:
    """The scenario of a name of `kitti_names`.

    Raises `ScenarioError` where there are no recordings, or none of that name.
    """
    root, known = kitti_root(), kitti_names()
    if not known:
        raise ScenarioError(
            f"scenario {name[:40]!r}: no KITTI recordings in {root}; set {VARIABLE} to the folder"
            " that holds label_02, calib, pose and detections"
        )
    if name not in known:
        shown = f"{known[0]} to {known[-1]}"
        raise ScenarioError(f"unknown scenario {name[:40]!r}; {root} holds {shown}")
    sequence = name.removeprefix(PREFIX)
    labels, calibration, poses = (
        root / folder / f"{sequence}.txt" for folder in ("label_02", "calib", "pose")
    )
    return KittiScenario(
        name=name,
        purpose="Recorded by KITTI: cars and vans as people labelled them.",
        source="kitti",
        parameters={},
        parameter_specs=(),
        # There is one pose in each frame.
        duration=round(_lines(poses) * FRAME_TIME, 9),
        sensor_height=SENSOR_HEIGHT,
        statics=(),
        walkers=(),
        definition=labels,
        root=root,
        sequence=sequence,
        calibration=calibration,
        poses=poses,
    )


def _lines(path: Path) -> int:
    try:
        return len(path.read_bytes().splitlines())
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror}") from None
