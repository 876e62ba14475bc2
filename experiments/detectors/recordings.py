"""KITTI's recorded sequences by split, and what a detector, real or simulated, made of them."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from experiments.detectors.sightings import Sightings, sightings
from mdkf.tables import KINDS, BoolArray, IntArray, Trace
from sim_bridge import detect, kitti_detections, kitti_trace
from sim_bridge.kitti_files import read_labels, read_sequences
from sim_bridge.profile import Profile

LARGELY_CUT = 2
"""Cars that the picture's edge cuts off this far are left out: detectors see a part of them."""

SPLITS = ("train", "val", "all")
"""val: the validation sequences that trackers are compared on; train: all others."""


def sequences_of(root: Path, split: str) -> tuple[str, ...]:
    """Names of the sequences of one of `SPLITS`."""
    if split == "all":
        return tuple(read_sequences(root))
    held_out = read_sequences(root, "val")
    if split == "val":
        return tuple(held_out)
    return tuple(name for name in read_sequences(root) if name not in held_out)


def recorded(root: Path, detections: Path, sequences: Sequence[str]) -> Sightings:
    """What the recorded detections in a folder made of the sequences.

    Boxes where nothing is labelled are left out: nobody knows whether they are false.
    """
    parts = []
    for name in sequences:
        trace, found = (
            kitti_trace(root, name),
            kitti_detections(root, detections, name, unlabelled=False),
        )
        parts.append(sightings(name, trace, found, *_levels(root, name, trace)))
    return Sightings.joined(parts)


def simulated(root: Path, profile: Profile, sequences: Sequence[str], seeds: int) -> Sightings:
    """What the simulated detector made of the same cars, as often as there are seeds; each time
    counts as a sequence of its own."""
    parts = []
    for name in sequences:
        trace = kitti_trace(root, name)
        levels = _levels(root, name, trace)
        for seed in range(seeds):
            found = detect(trace, profile, seed)
            parts.append(sightings(f"{name}/{seed}", trace, found, *levels))
    return Sightings.joined(parts)


def _levels(root: Path, name: str, trace: Trace) -> tuple[IntArray, BoolArray]:
    """Level of occlusion of each row of the trace, and whether it is a car that counts."""
    labels = read_labels(root / "label_02" / f"{name}.txt", trace.n_frames)
    order = np.lexsort((labels.last, labels.frame))
    cars = (trace.kind == KINDS.index("car")) & (labels.truncated[order] < LARGELY_CUT)
    return labels.occluded[order], cars
