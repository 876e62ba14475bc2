"""Files into the scenes that are shown: a trace with detections, tracks and gaps of it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import polars as pl

from experiments.gaps import Gap, Gaps
from experiments.matched import check_origin
from experiments.occlusion import recorded_gaps
from experiments.phases import gap_errors
from experiments.playback.scene import inner_diagnostics
from experiments.report import nearest_gap
from experiments.run import KEPT
from mdkf import Detections, TableError, Trace, Tracks
from sim_bridge import read_table

TRACE, DETECTIONS = "trace.parquet", "detections.parquet"
TRACKS = "tracks-"
"""What the file of a filter's tracks begins with; its name follows."""

_Of = TypeVar("_Of", Detections, Tracks)


@dataclass(frozen=True, eq=False)
class Scene:
    """What is shown of a world.

    detections: with or without those in the gaps, None if they are not shown. tracks: by the name
    of the filter. gaps: those of the occlusion protocol. source: where the trace was read.
    """

    trace: Trace
    detections: Detections | None
    tracks: Mapping[str, Tracks]
    gaps: Gaps
    source: Path

    @property
    def name(self) -> str:
        """The scenario with its seed, the file's name for want of one."""
        told = self.trace.provenance
        scenario = told.get("scenario", self.source.stem)
        return f"{scenario}, seed {told['seed']}" if "seed" in told else scenario

    def diagnostics(self, name: str) -> list[str]:
        """What is plotted of a filter."""
        return inner_diagnostics(self.tracks[name])

    def shown_gaps(self) -> list[Gap]:
        """The gaps, by object, that begin while the trace has their object: those that scores
        are about."""
        found = gap_errors(self.trace, next(iter(self.tracks.values())), self.gaps)
        return found.select("object_id", "gap_start", "gap_stop").unique().sort(pl.all()).rows()

    def focus(self, object_id: int | None) -> Gap | None:
        """The gap that is looked at: an object's, or by default the one nearest to the sensor
        that all filters' tracks go through; None if there is none.

        Raises `TableError` for an object without a gap.
        """
        gaps = self.shown_gaps() if self.tracks else []
        if object_id is not None:
            own = [gap for gap in gaps if gap[0] == object_id]
            if not own:
                known = ", ".join(str(gap[0]) for gap in gaps[:20]) or "none"
                raise TableError(
                    f"{self.source}: object {object_id} has no gap with tracks around it, expected"
                    f" one of: {known}{', ...' * (len(gaps) > 20)}"
                )
            return own[0]
        if not gaps:
            return None
        errors = pl.concat(
            [gap_errors(self.trace, each, self.gaps) for each in self.tracks.values()]
        )
        return nearest_gap(self.trace, self.trace.sensor_distance(), errors) or gaps[0]


def world_folders(run: Path) -> list[Path]:
    """The folders of worlds' tables in an output folder of `mdkf run`, or the folder itself if it
    is such a one.

    Raises `TableError` if there are none.
    """
    if (run / TRACE).is_file():
        return [run]
    found = sorted(path.parent for path in run.glob(f"{KEPT}/*/{TRACE}"))
    if not found:
        raise TableError(
            f"{run}: expected an output folder of mdkf run with {KEPT}/SCENARIO-SEED/{TRACE}, one"
            f" of these SCENARIO-SEED folders, or a trace's file"
        )
    return found


def read_folder(folder: Path, filters: Sequence[str] | None) -> Scene:
    """A world that `mdkf run` has kept, with the tracks of some filters, or of all.

    Raises `TableError` as `read_files`, and for a filter that was not run.
    """
    files = {path.stem.removeprefix(TRACKS): path for path in folder.glob(f"{TRACKS}*.parquet")}
    for name in filters or ():
        if name not in files:
            known = ", ".join(sorted(files)) or "none"
            raise TableError(f"{folder}: no tracks of filter {name!r}, expected one of: {known}")
    chosen = [files[name] for name in filters or sorted(files)]
    detections = folder / DETECTIONS
    return read_files(folder / TRACE, detections if detections.is_file() else None, chosen)


def read_files(trace: Path, detections: Path | None, tracks: Sequence[Path]) -> Scene:
    """A trace with detections and tracks of it, named by their files: md of tracks-md.parquet.

    Raises `TableError`, naming the file, for what is no such table, is not of this trace, or
    tells of other gaps than the rest.
    """
    truth = read_table(trace, Trace)
    seen = None if detections is None else _of(truth, detections, Detections)
    estimates: dict[str, Tracks] = {}
    for path in tracks:
        name = path.stem.removeprefix(TRACKS)
        if name in estimates:
            raise TableError(
                f"{path}: tracks named {name} are given twice, expected names that differ"
            )
        estimates[name] = _of(truth, path, Tracks)
    told = {
        path: _gaps(path, table) for path, table in zip(tracks, estimates.values(), strict=True)
    }
    if detections is not None and seen is not None:
        gaps = _gaps(detections, seen)
        # A run keeps the detections from before the protocol, which have no gaps yet.
        if len(gaps) or not told:
            told[detections] = gaps
    first, gaps = next(iter(told.items()), (trace, Gaps.of([])))
    for path, other in told.items():
        if other.rows() != gaps.rows():
            raise TableError(f"{path}: its gaps are not those of {first}, expected one protocol")
    return Scene(truth, seen, estimates, gaps, trace)


def _of(trace: Trace, path: Path, kind: type[_Of]) -> _Of:
    """A table that is of the trace."""
    table = read_table(path, kind)
    try:
        check_origin(trace, table)
    except TableError as error:
        raise TableError(f"{path}: {error}") from None
    return table


def _gaps(path: Path, table: Detections | Tracks) -> Gaps:
    try:
        return recorded_gaps(table)
    except TableError as error:
        raise TableError(f"{path}: {error}") from None
