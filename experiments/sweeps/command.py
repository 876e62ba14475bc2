"""The command `mdkf sweep`: a grid of runs, resumable, on this machine or on a cluster."""

import json
import math
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import polars as pl
import typer
from rich.console import Console, Group
from rich.live import Live
from rich.markup import escape
from rich.progress import TextColumn
from rich.table import Table

from experiments import terminal
from experiments.engine import RunFailed
from experiments.growth import growth_table
from experiments.options import Json, NoCache, Workers, progress_bar
from experiments.sweeps.file import read_sweep
from experiments.sweeps.progress import WATCHED, Progress
from experiments.sweeps.run import SweepResults, run_sweep
from experiments.sweeps.sweep import Sweep

OUT = Path("mdkf-sweep")
MAX_ROWS, MAX_PAIRS = 48, 24
"""Rows of the tables that a terminal is shown; the files have them all."""


def sweep(
    file: Annotated[Path, typer.Argument(help="The sweep's YAML file.", dir_okay=False)],
    out: Annotated[
        Path, typer.Option(help="Folder for results; a second run goes on in it.", file_okay=False)
    ] = OUT,
    workers: Workers = None,
    dask: Annotated[
        str | None,
        typer.Option(
            help="Address of a running Dask scheduler, such as tcp://10.0.0.1:8786: its workers do"
            " the work.",
            metavar="ADDRESS",
        ),
    ] = None,
    preview: Annotated[
        bool,
        typer.Option(
            "--preview", help="Do one world of each scenario, tell how long all would take."
        ),
    ] = False,
    retry: Annotated[bool, typer.Option("--retry", help="Do runs that failed again.")] = False,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Delete the results that are in the folder.")
    ] = False,
    no_cache: NoCache = False,
    as_json: Json = False,
) -> None:
    """Cross scenarios, parameters, seeds, detectors, occlusions and filters: every run once, kept
    as it comes. Whatever interrupts it, the same command goes on where it was."""
    if dask is not None and workers is not None:
        raise typer.BadParameter("give --workers or --dask, not both")
    chosen = read_sweep(file)
    console = Console(stderr=True)
    console.print(_size(chosen), highlight=False, markup=False, soft_wrap=True)
    with _shown(console) as watch:
        try:
            results = run_sweep(
                chosen,
                out,
                workers,
                dask,
                retry=retry,
                fresh=fresh,
                first=preview,
                cached=not no_cache,
                command=["mdkf", *sys.argv[1:]],
                watch=watch,
            )
        except (KeyboardInterrupt, RunFailed):
            told = f"what was done is kept in {out}: the same command goes on from there"
            console.print(told, highlight=False, markup=False, soft_wrap=True)
            raise
    for line in _told(results, preview):
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    if as_json:
        print(json.dumps(_document(results, out), allow_nan=False))
        return
    _print(results, out)
    if not preview and results.summary.is_empty():
        raise RunFailed(f"no run was done; {out}/runs tells why")


def _size(chosen: Sweep) -> str:
    """How many runs, and of what."""
    counts = {
        "scenario": len(chosen.scenarios),
        "seed": len(chosen.seeds),
        "detector": len(chosen.detectors),
        "occlusion": len(chosen.occlusions),
        "set of rules": len(chosen.tracker),
        "filter": len(chosen.filters),
    }
    told = " x ".join(_counted(number, name) for name, number in counts.items())
    return f"{told.replace('1 set of rules x ', '')}: {_counted(len(chosen), 'run')}"


def _counted(number: int, name: str) -> str:
    plural = name.replace("set ", "sets ") if "set " in name else f"{name}s"
    return f"{number} {name if number == 1 else plural}"


@contextmanager
def _shown(console: Console) -> Iterator[Any]:
    """Shows how far a sweep is, on a terminal."""
    bar = progress_bar(console)
    bar.columns = (*bar.columns, TextColumn("{task.fields[told]}"))
    task = bar.add_task("runs", total=None, told="")
    if not console.is_terminal:
        yield lambda progress: None
        return
    with Live(bar, console=console, refresh_per_second=4, transient=True) as live:

        def watch(progress: Progress) -> None:
            told = f"{progress.rate:.1f}/s, {_duration(progress.remaining)} left"
            if progress.failed:
                told += f", {progress.failed} failed"
            bar.update(task, completed=progress.there, total=progress.total, told=told)
            live.update(Group(bar, _so_far(progress)))

        yield watch


def _so_far(progress: Progress) -> Table:
    """Means of what was done since the command began."""
    table = Table(box=None, title="so far", title_justify="left", title_style="dim")
    table.add_column("filter")
    for score in WATCHED:
        table.add_column(escape(HEADINGS[score]), justify="right")
    for name, means in progress.watched.items():
        cells = [means[score].value for score in WATCHED]
        table.add_row(escape(name), *("–" if math.isnan(v) else f"{v:.2f}" for v in cells))
    return table


HEADINGS = {column: heading for column, heading, _, _ in terminal.COLUMNS}


def _duration(seconds: float) -> str:
    """A time in the unit that one would say it in."""
    if math.isnan(seconds):
        return "?"
    for unit, length in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 1.5 * length:
            return f"{seconds / length:.1f} {unit}"
    return f"{seconds:.0f} s"


def _told(results: SweepResults, preview: bool) -> Iterator[str]:
    """What there is to say of how it went."""
    progress = results.progress
    if progress.found:
        yield f"{progress.found} of {progress.total} runs were there already"
    if progress.damaged:
        yield f"{progress.damaged} damaged files of results were found, and their runs done again"
    if preview and progress.there < progress.total:
        left, workers = progress.total - progress.there, progress.workers
        told = f"{left} runs are left: about {_duration(progress.remaining)} on {workers} processes"
        yield f"{told}; the same command without --preview does them"
    for status, what in (("refused", "were refused"), ("failed", "failed")):
        own = results.runs.filter(pl.col("status") == status)["error"]
        if len(own):
            yield f"{_counted(len(own), 'run')} {what}, for example: {own[0]}"


def _document(results: SweepResults, out: Path) -> dict[str, Any]:
    """The results as one JSON document."""
    progress = results.progress
    return {
        "rows": results.summary.to_dicts(),
        "differences": results.differences.to_dicts(),
        "runs": {
            "all": progress.total,
            "there": progress.there,
            "found": progress.found,
            "failed": progress.failed,
            "refused": progress.refused,
        },
        "folder": str(out),
    }


def _print(results: SweepResults, out: Path) -> None:
    """Means and differences, as far as they fit."""
    shown = Console() if Console().is_terminal else Console(width=terminal.FULL_WIDTH)
    wide = shown.width >= terminal.FULL_WIDTH
    summary = _labelled(results.summary)
    if not summary.is_empty():
        shown.print(terminal.results_table(summary.head(MAX_ROWS), intervals=wide))
    pairs = _labelled(results.differences)
    keys = pairs.select("scenario", "against").unique(maintain_order=True)
    first = pairs.join(keys.head(MAX_PAIRS), on=["scenario", "against"], how="semi")
    if not first.is_empty():
        shown.print(terminal.difference_table(first, wide))
    for _, curve in results.curves.group_by("detector", "tracker", maintain_order=True):
        if curve["length"].n_unique() > 1:
            shown.print(growth_table(curve, intervals=wide))
    for picture in results.pictures:
        print(f"error growth: {picture}")
    more = max(len(summary) - MAX_ROWS, 0) + max(len(keys) - MAX_PAIRS, 0)
    if more:
        print(f"{more} more rows are in {out / 'summary.parquet'} and differences.parquet")
    print(f"runs: {out / 'runs'}, of which the manifest is {out / 'manifest.json'}")


def _labelled(rows: pl.DataFrame) -> pl.DataFrame:
    """Rows whose scenario is told with all that they have in common and not all others do."""
    told = [pl.col("label")]
    for column in ("detector", "tracker", "occlusion"):
        if rows[column].n_unique() > 1:
            told.append(pl.col(column).replace("", "detector's rules"))
    return rows.with_columns(scenario=pl.concat_str(told, separator=", "))
