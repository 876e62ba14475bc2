"""Worlds into a folder of KITTI's or MOTChallenge's layout, sequence by sequence.

Beside what the layout asks for there are `sequences.csv`, which tells what each sequence is, and in
`worlds/SSSS` the tables by which other trackers' results are scored. Whatever ends the work, the
lists name sequences that are whole.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import polars as pl

from experiments.gaps import Gaps
from experiments.occlusion import recorded_gaps, recorded_protocol
from experiments.population import SCORED_RANGE, counted_truth
from mdkf import Detections, TableError, Trace, Tracks
from mdkf.tables import BoolArray
from sim_bridge import write_table
from sim_bridge.kitti_world import write_kitti_world, write_sequences
from sim_bridge.kitti_writing import place, write_text
from sim_bridge.mot import write_mot_sequences, write_mot_world

Layout = Literal["kitti", "mot"]


@dataclass(frozen=True, eq=False)
class World:
    """A trace, what was detected of it, and tracks by their names."""

    trace: Trace
    detections: Detections | None = None
    tracks: Mapping[str, Tracks] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, table in self.tracks.items():
            if not table.knows_boxes():
                raise TableError(f"the tracks {name} have no sizes, expected boxes")

    def counted(self) -> BoolArray:
        """Rows of the trace (n_rows,) that count, also those in the gaps of what was detected."""
        told: Detections | Tracks | None = self.detections
        if told is None:
            told = next(iter(self.tracks.values()), None)
        return counted_truth(self.trace, Gaps.of([]) if told is None else recorded_gaps(told))


@dataclass(eq=False)
class Folder:
    """Where worlds are written as sequences 0000, 0001, ...; rows: what each is."""

    out: Path
    layout: Layout
    rows: list[dict[str, Any]] = field(default_factory=list)

    def add(self, world: World) -> None:
        """Write one more; `TableError` for a world that the layout cannot hold."""
        sequence = f"{len(self.rows):04d}"
        trace, found = world.trace, world.detections
        if self.layout == "kitti":
            if trace.provenance.get("source") == "kitti":
                name = trace.provenance["scenario"]
                raise TableError(f"{name} is recorded: its files are KITTI's already")
            by_detector = {} if found is None else {_detector(found): found}
            write_kitti_world(self.out, sequence, trace, by_detector, world.tracks, SCORED_RANGE)
        else:
            counted = world.counted()
            write_mot_world(self.out, sequence, trace, found, world.tracks, counted)
        tables = self.out / "worlds" / sequence
        write_table(trace, place(tables / "trace.parquet"))
        if found is not None:
            write_table(found, place(tables / "detections.parquet"))
        self.rows.append({"sequence": sequence, **_described(world)})
        self._write_lists()

    def _write_lists(self) -> None:
        frames = {row["sequence"]: row["frames"] for row in self.rows}
        if self.layout == "kitti":
            write_sequences(self.out, frames)
        else:
            write_mot_sequences(self.out, frames)
        write_text(self.out / "sequences.csv", pl.DataFrame(self.rows).write_csv())


def _detector(found: Detections) -> str:
    """Name of the folder of detections."""
    name = found.provenance.get("detector", "detections")
    if Path(name).name != name:
        raise TableError(f"the detector is called {name[:40]!r}, expected the name of a folder")
    return name


def _described(world: World) -> dict[str, Any]:
    """What a sequence is: a row of `sequences.csv`."""
    told, found = world.trace.provenance, world.detections
    seen = {} if found is None else found.provenance
    return {
        **{name: told.get(name, "") for name in ("scenario", "parameters", "seed")},
        "detector": seen.get("detector", ""),
        "detector_seed": seen.get("detector_seed", ""),
        "occlusion": "" if found is None else recorded_protocol(found),
        "frames": world.trace.n_frames,
        "tracks": " ".join(world.tracks),
    }
