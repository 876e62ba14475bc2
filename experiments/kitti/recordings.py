"""What recorded sequences and recorded detections there are, read once for all filters."""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from experiments.detectors.recordings import SPLITS, sequences_of
from experiments.kitti.official import Labels
from mdkf import Detections, Trace
from mdkf.settings import DETECTORS, FOLDERS
from scenarios.kitti import kitti_root
from sim_bridge import KittiError, Profile, detect, kitti_detections, kitti_trace
from sim_bridge.kitti_files import SEQUENCES, read_bytes, read_sequences
from sim_bridge.kitti_image import Camera, pictures


@dataclass(frozen=True, eq=False)
class Recording:
    """A recorded sequence: its trace, its camera, and its labels as KITTI scores them."""

    sequence: str
    trace: Trace
    camera: Camera
    labels: Labels


@dataclass(frozen=True)
class DetectorFolder:
    """A folder of recorded detections; settings: name of the tracker's settings, and of the
    simulated detector's profile."""

    path: Path
    settings: str

    @property
    def name(self) -> str:
        """What the detector is called: its folder's name."""
        return self.path.name

    @property
    def detector(self) -> str:
        """What others call the detector, by its folder's name; whose settings it has is another
        matter."""
        return FOLDERS.get(self.name, self.name)

    @staticmethod
    def of(path: Path, settings: str | None) -> "DetectorFolder":
        """A folder, with the settings of its name unless told; `KittiError` if there are none."""
        told = settings or path.resolve().name
        known = FOLDERS.get(told, told)
        if known not in DETECTORS:
            names = ", ".join(DETECTORS)
            if settings:
                raise KittiError(f"--detector is {told[:40]!r}, expected one of: {names}")
            raise KittiError(
                f"{path}: no tracker settings for {told[:40]!r}; choose with --detector one of:"
                f" {names}"
            )
        return DetectorFolder(path.resolve(), known)


def detector_folders(
    root: Path, paths: Iterable[Path], settings: str | None
) -> tuple[DetectorFolder, ...]:
    """The folders given, or all in the root's `detections`, each name once.

    Raises `KittiError` where there is none, where two have one name, and as `DetectorFolder.of`.
    """
    chosen = list(paths) or sorted(p for p in (root / "detections").glob("*") if p.is_dir())
    if not chosen:
        raise KittiError(f"{root / 'detections'}: no folder of detections, expected some")
    for path in chosen:
        if not path.is_dir():
            raise KittiError(f"{path}: no such folder of detections")
    folders = tuple(DetectorFolder.of(path, settings) for path in chosen)
    names = [folder.name for folder in folders]
    for name in names:
        if names.count(name) > 1:
            raise KittiError(f"two folders of detections are called {name!r}: expected one")
    return folders


def folders_there() -> dict[str, Path]:
    """Folders of recorded detections by the name of their tracker's settings, of several with the
    same the first; none without the data (`scenarios.kitti.kitti_root`)."""
    found: dict[str, Path] = {}
    for path in sorted((kitti_root() / "detections").glob("*/")):
        name = FOLDERS.get(path.name, path.name)
        if name in DETECTORS:
            found.setdefault(name, path)
    return found


def sequences_in(root: Path, split: str) -> tuple[str, ...]:
    """Names of the sequences of a split: one of `SPLITS`, the name of another of the root's lists,
    or a file with a sequence at the begin of each line, as those lists are.

    Raises `KittiError` for a split of which there is neither, or of unknown sequences.
    """
    if split in SPLITS:
        return sequences_of(root, split)
    if (root / f"{SEQUENCES}{split}").is_file():
        return tuple(read_sequences(root, split))
    path = Path(split)
    if not path.is_file():
        raise KittiError(f"--split is {split!r}, expected {', '.join(SPLITS)} or a file")
    try:
        lines = read_bytes(path).decode("utf-8").splitlines()
    except UnicodeDecodeError:
        raise KittiError(f"{path}: is not UTF-8 text") from None
    known = read_sequences(root)
    names = [line.split()[0] for line in lines if line.strip()]
    for k, name in enumerate(names):
        if name not in known or name in names[:k]:
            raise KittiError(
                f"{path}: sequence {name[:40]!r}, expected each once of: {', '.join(known)}"
            )
    if not names:
        raise KittiError(f"{path}: no sequence, expected at least one")
    return tuple(names)


def read_recordings(root: Path, sequences: Iterable[str]) -> tuple[Recording, ...]:
    """The sequences' truth, cameras and labels; `KittiError` for bad files."""
    sequences = tuple(sequences)
    seen = pictures(root, sequences)
    recordings = []
    for name in sequences:
        trace = kitti_trace(root, name)
        camera = Camera.read(root, name, trace.n_frames, seen[name])
        recordings.append(Recording(name, trace, camera, Labels.read(root, name, trace.n_frames)))
    return tuple(recordings)


def recorded_detections(
    root: Path, folder: Path, recordings: Iterable[Recording]
) -> tuple[Detections, ...]:
    """What the recorded detector reported of each sequence; `KittiError` for bad files."""
    return tuple(kitti_detections(root, folder, recording.sequence) for recording in recordings)


def simulated_detections(
    profile: Profile, recordings: Iterable[Recording], seed: int
) -> tuple[Detections, ...]:
    """What the simulated detector reports of each sequence's recorded truth, in the picture.

    Its clutter is all around the sensor; recorded detectors report what the camera sees.
    """
    made = []
    for recording in recordings:
        found = detect(recording.trace, profile, seed)
        made.append(found.take(np.asarray(recording.camera.boxes(found).row)))
    return tuple(made)


@cache
def contents(folder: Path) -> str:
    """SHA-256 of the names and contents of the recordings with a folder of detections."""
    root = kitti_root()
    digest = hashlib.sha256()
    parts = (root / "label_02", root / "calib", root / "pose", folder)
    files = [path for part in parts for path in sorted(part.glob("*"))]
    for path in [*files, *sorted(path for path in root.iterdir() if path.is_file())]:
        content = hashlib.sha256(path.read_bytes()).hexdigest()
        digest.update(f"{path.relative_to(root).as_posix()} {content}\n".encode())
    return digest.hexdigest()
