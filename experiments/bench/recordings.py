"""The whole tracker on the val split of KITTI, detections to track tables; nothing without data."""

import mdkf
from experiments.bench.measure import Block, Case
from experiments.bench.plan import Plan
from experiments.kitti.recordings import folders_there
from mdkf import Detections, Tracker
from scenarios.kitti import kitti_names, kitti_root
from sim_bridge.kitti import kitti_detections
from sim_bridge.kitti_files import read_sequences

WHAT = "recorded"
NAMES = ("ca", "imm", "imm-zero", "md")
RATIOS = (("md", "ca"), ("imm", "md"), ("imm-zero", "md"))
SPLIT = "val"


def blocks(plan: Plan) -> list[Block]:
    """One block for each detector whose detections are there and whose settings are known."""
    return [block(name, recorded(name)) for name in detectors()]


def detectors() -> list[str]:
    """Those detectors, as their folders are named; none without the data."""
    return [path.name for path in folders_there().values()] if kitti_names() else []


def recorded(detector: str) -> list[Detections]:
    """A detector's detections in the split, a table for each sequence."""
    root = kitti_root()
    return [
        kitti_detections(root, detector, sequence, unlabelled=True)
        for sequence in read_sequences(root, SPLIT)
    ]


def block(detector: str, seen: list[Detections]) -> Block:
    """Every filter on all of a detector's tables."""
    cases = {name: _case(name, detector, seen) for name in NAMES}
    ratios = tuple((cases[first], cases[second]) for first, second in RATIOS)
    return Block(tuple(cases.values()), ratios=ratios)


def _case(name: str, detector: str, seen: list[Detections]) -> Case:
    tracker = Tracker(mdkf.estimator(name), detector, position="measurement")
    frames = sum(table.n_frames for table in seen)

    def run(_: None) -> int:
        return sum(len(tracker.run(table)) for table in seen)

    return Case(WHAT, name, detector, frames, frames, "us per frame", 1e6, lambda: None, run)
