"""The command `mdkf paper`: the paper's tables, figures and claims, asked again."""

import difflib
import json
import shlex
import sys
from pathlib import Path
from typing import Annotated, Any

import polars as pl
import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from experiments.claims import scoreboard
from experiments.engine import RunFailed
from experiments.options import Json, Workers, counting
from experiments.paper.item import Item
from experiments.paper.items import ITEMS
from experiments.paper.report import write_report
from experiments.paper.run import run
from experiments.paper.tables import tables
from experiments.studies.scale import QUICK, SCALES, Scale

WIDTH = 120
"""Characters that the tables need: they get them where there is no terminal."""
OUT = Path("mdkf-paper")


def paper(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[ITEM]...", help="Items by id; all if none is given."),
    ] = None,
    list_items: Annotated[
        bool, typer.Option("--list", help="List the items and do nothing else.")
    ] = False,
    scale: Annotated[
        str, typer.Option(metavar="|".join(SCALES), help="How much is run.")
    ] = QUICK.name,
    seeds: Annotated[
        int | None, typer.Option(help="Seeds of every scenario, in place of the scale's.", min=1)
    ] = None,
    out: Annotated[
        Path, typer.Option(help="Folder for results and report; a second run goes on in it.")
    ] = OUT,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Ask the paper's questions again, against exact truth: tables of the items that are named; of
    the whole paper the verdicts on its claims; a page, figures and files in any case."""
    chosen = _chosen(names)
    if list_items:
        _list(chosen, as_json)
        return
    size = _scale(scale, seeds)
    out.mkdir(parents=True, exist_ok=True)
    try:
        with counting("jobs") as progress:
            results = run(chosen, size, out, workers, progress)
    except (KeyboardInterrupt, RunFailed):
        told = f"what was done is kept in {out}: the same command goes on from there"
        Console(stderr=True).print(told, highlight=False, markup=False)
        raise
    line = shlex.join(["mdkf", *sys.argv[1:]])
    page = write_report(chosen, results.answers, results.cells, results.verdicts, size, out, line)
    if as_json:
        document = {
            "rows": results.cells.to_dicts(),
            "claims": results.verdicts.to_dicts(),
            "report": str(page),
        }
        print(json.dumps(document, allow_nan=False))
        return
    shown = Console() if Console().is_terminal else Console(width=WIDTH)
    for item in chosen if names else ():  # of the whole paper the page is the place to read
        shown.print(f"[bold]{item.id}[/bold]: {escape(item.question)} ({escape(item.place)})")
        for table in tables(item, results.answers[item.id]):
            shown.print(table, highlight=False)
        shown.print(f"[dim]{escape(item.caption)}[/dim]\n", highlight=False)
    tested = results.verdicts.filter(pl.col("reason").is_null().any().over("id"))
    if not tested.is_empty():
        shown.print(scoreboard.table(tested), highlight=False)
    print(f"report: {page}")


def _chosen(names: list[str] | None) -> list[Item]:
    """Items by name, each once; all if there are no names."""
    for name in names or ():
        if name not in ITEMS:
            close = difflib.get_close_matches(name, ITEMS, n=1)
            hint = f" (did you mean {close[0]!r}?)" if close else ""
            raise typer.BadParameter(
                f"unknown item {name!r}{hint}; known items: {', '.join(ITEMS)}"
            )
    return [ITEMS[name] for name in dict.fromkeys(names or ITEMS)]


def _scale(name: str, seeds: int | None) -> Scale:
    if name not in SCALES:
        raise typer.BadParameter(f"scale {name!r}, expected one of: {', '.join(SCALES)}")
    return SCALES[name] if seeds is None else SCALES[name].with_seeds(seeds)


def _list(items: list[Item], as_json: bool) -> None:
    if as_json:
        rows: list[dict[str, Any]] = [
            {"id": item.id, "question": item.question, "place": item.place} for item in items
        ]
        print(json.dumps({"rows": rows}))
        return
    table = Table(box=SIMPLE_HEAD)
    for heading in ("item", "question", "place in the paper"):
        table.add_column(heading)
    for item in items:
        table.add_row(*map(escape, (item.id, item.question, item.place)))
    Console().print(table)
