"""Recorded KITTI detections into rows of scores, by KITTI's rules: the validation split, where the
folder of recordings is there (`scenarios.kitti.kitti_root`), and no jobs where it is not.

Scenario `val` is all sequences together, `val-SSSS` all but sequence SSSS (for the jackknife of
`experiments.estimates`); there are no seeds.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import polars as pl

from experiments.estimates import RECORDED
from experiments.jobs import Job, as_rows
from experiments.kitti.recordings import (
    DetectorFolder,
    Recording,
    contents,
    folders_there,
    read_recordings,
    recorded_detections,
    sequences_in,
)
from experiments.kitti.rules import RULES
from experiments.kitti.run import Plan, run
from experiments.occlusion import OcclusionProtocol
from experiments.studies.worlds import FILTERS
from scenarios.kitti import kitti_root

SPLIT = "val"
RULES_NAME = "paper"

METRICS = ("hota", "deta", "assa", "assre", "mota", "motp", "idf1", "idsw")
"""Those of `experiments.kitti.run.scores` that are kept."""


@dataclass(frozen=True)
class Recorded(Job):
    """One detector's recorded detections of the split, occluded, tracked by every filter.

    detector: name of the tracker's settings; occlusion: as `OcclusionProtocol.parse` takes it.
    contents: SHA-256 of the recordings.
    """

    detector: str
    occlusion: str
    contents: str
    filters: tuple[str, ...] = FILTERS

    @property
    def group(self) -> str:
        """A process keeps the recordings that it has read."""
        return f"recorded {self.detector} detections"

    def key(self) -> Mapping[str, Any]:
        """All that decides the rows."""
        return {"study": RECORDED, "split": SPLIT, "rules": RULES_NAME, **vars(self)}

    def rows(self) -> pl.DataFrame:
        """The scores `METRICS` by KITTI's rules, n the sequences they are of."""
        root = kitti_root()
        recordings = _recordings(root)
        folder = DetectorFolder.of(folders_there()[self.detector], None)
        seen = recorded_detections(root, folder.path, recordings)
        protocol = OcclusionProtocol.parse(self.occlusion)
        results = run(Plan(self.filters, (RULES[RULES_NAME],), protocol), folder, recordings, seen)
        scores = {(row["filter"], SPLIT): row for row in results.rows}
        for (_, name), without in results.left_out.items():
            scores |= {(name, f"{SPLIT}-{sequence}"): row for sequence, row in without.items()}
        measured = [
            {"filter": name, "scenario": scenario, "metric": metric, "value": row[metric]}
            | {"n": len(recordings) - (scenario != SPLIT)}
            for (name, scenario), row in scores.items()
            for metric in METRICS
        ]
        everywhere = {"detector": self.detector, "occlusion": self.occlusion}
        return as_rows(measured, study=RECORDED, **everywhere)


def jobs(detectors: Sequence[str], occlusions: Sequence[str] = ("none",)) -> list[Recorded]:
    """A job for each occlusion and each of the detectors of which there are recordings."""
    there = folders_there()
    return [
        Recorded(name, occlusion, contents(there[name]))
        for name in detectors
        if name in there
        for occlusion in occlusions
    ]


@cache
def _recordings(root: Path) -> tuple[Recording, ...]:
    return read_recordings(root, sequences_in(root, SPLIT))
