"""The commands `mdkf export` and `mdkf import`."""

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

import scenarios
import sim_bridge
from experiments.engine import RunFailed
from experiments.exchange import jobs
from experiments.exchange.results import read_results
from experiments.exchange.worlds import Folder, Layout
from experiments.options import (
    Json,
    NoCache,
    Root,
    chosen_filters,
    chosen_occlusion,
    chosen_parameters,
    progress_of,
)
from mdkf import Detections, TableError, Trace, Tracks
from mdkf.tables import Table
from scenarios.kitti import kitti_root
from sim_bridge import SeedRefused
from sim_bridge.kitti_writing import export_kitti
from sim_bridge.parquet import read_any_table

TABLE = ".parquet"
"""How the names of tables end; all else that is exported is a scenario."""


def export(
    what: Annotated[
        list[str],
        typer.Argument(
            metavar="SCENARIO|TABLE...",
            help="Scenarios to simulate; or Parquet files, a trace with detections and tracks of it"
            " (of a recorded sequence detections or tracks alone).",
        ),
    ],
    out: Annotated[Path, typer.Option(help="Folder to write.", file_okay=False)],
    layout: Annotated[
        Layout, typer.Option("--format", help="Whose format: kitti, or MOTChallenge's.")
    ] = "kitti",
    seeds: Annotated[
        int | None,
        typer.Option(help="Of scenarios: how many seeds, from 0; 1 if not given.", min=1),
    ] = None,
    detector: Annotated[
        str | None, typer.Option(help="Of scenarios: the detector; pointrcnn if not given.")
    ] = None,
    occlusion: Annotated[
        str | None, typer.Option(help="Of scenarios: detections to hide, as mid:20.")
    ] = None,
    filters: Annotated[
        str | None,
        typer.Option(help="Of scenarios: comma-separated, to write their tracks beside the rest."),
    ] = None,
    parameters: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=VALUE", help="Of scenarios: a parameter; repeatable."),
    ] = None,
    root: Root = None,
    no_cache: NoCache = False,
    as_json: Json = False,
) -> None:
    """Write worlds as others read them: truth, detections, calibration and poses, tracks.

    Each world is a sequence, 0000, 0001, ...; sequences.csv tells which is which.
    """
    tables = [name.lower().endswith(TABLE) for name in what]
    if all(tables):
        given = (seeds, detector, occlusion, filters, parameters)
        if any(option is not None for option in given):
            raise typer.BadParameter(
                "--seeds, --detector, --occlusion, --filters and --set are for scenarios"
            )
        named = [(path, read_any_table(path)) for path in map(Path, what)]
        if layout == "kitti" and all(_is_of_recording(table) for _, table in named):
            for path, table in named:
                print(_exported(path, table, root or kitti_root(), out))
            return
        todo = jobs.of_tables(named)
    elif any(tables):
        other = what[tables.index(False)]
        raise typer.BadParameter(
            f"{other!r} is no {TABLE} file: expected tables only, or scenarios"
        )
    else:
        todo = _of_scenarios(what, seeds, detector, occlusion, filters, parameters, no_cache)
    folder, refused = Folder(out, layout), []
    with progress_of(len(todo), "worlds") as progress:
        for job in todo:
            try:
                folder.add(job())
            except SeedRefused as refusal:
                refused.append(str(refusal))
            progress("worlds")
    for reason in refused:
        print(f"refused: {reason}", file=sys.stderr)
    if not folder.rows:
        raise RunFailed("no world is left: every seed was refused")
    if as_json:
        document = {"folder": str(out), "sequences": folder.rows, "refused": refused}
        print(json.dumps(document, allow_nan=False))
    else:
        print(out / "sequences.csv")


def import_results(
    results: Annotated[
        Path,
        typer.Argument(
            help="Another tracker's results of one sequence (.txt): KITTI's or MOTChallenge's."
        ),
    ],
    trace: Annotated[Path, typer.Option(help="The sequence's trace, a Parquet file.")],
    out: Annotated[Path, typer.Option(help="Parquet file to write.", dir_okay=False)],
    detections: Annotated[
        Path | None,
        typer.Option(help="The detections that the tracker was given, which tell the gaps."),
    ] = None,
    root: Root = None,
) -> None:
    """Read another tracker's results into a track table; what they do not tell is empty there."""
    truth = sim_bridge.read_table(trace, Trace)
    tracks = read_results(results, truth, detections, root)
    sim_bridge.write_table(tracks, out)
    print(f"{out}: {tracks!r}", file=sys.stderr)


def _of_scenarios(
    names: Sequence[str],
    seeds: int | None,
    detector: str | None,
    occlusion: str | None,
    filters: str | None,
    parameters: Sequence[str] | None,
    no_cache: bool,
) -> list[jobs.Job]:
    values = chosen_parameters(parameters)
    chosen = [scenarios.load(name, **values) for name in names]
    detector = detector or "pointrcnn"
    for scenario in chosen:
        sim_bridge.check_detector(detector, scenario)
        sim_bridge.check_inputs(scenario)
    try:
        return jobs.of_scenarios(
            chosen,
            seeds or 1,
            detector,
            chosen_occlusion(occlusion or "none"),
            () if filters is None else chosen_filters(filters),
            no_cache,
        )
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None


def _is_of_recording(table: Table) -> bool:
    return table.provenance.get("source") == "kitti"


def _exported(path: Path, table: Table, root: Path, out: Path) -> Path:
    """Where a table of a recorded sequence was written."""
    if not isinstance(table, Trace | Detections | Tracks):
        raise TableError(f"{path}: holds {type(table).__name__}, expected Detections or Tracks")
    try:
        return export_kitti(table, root, out)
    except TableError as error:
        raise TableError(f"{path}: {error}") from None
