"""The command `mdkf paper`: items of the paper by name, answered on the terminal and in files."""

import difflib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from experiments.options import Json
from experiments.paper.item import Answer, Item, Options
from experiments.paper.items import ITEMS
from experiments.paper.regimes import FILTERS, NOISES, SEEDS
from sim_bridge.parquet import replacing, write_frame

WIDTH = 120
"""Characters that the tables need: they get them where there is no terminal."""
DOTS_PER_INCH = 150


def paper(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[ITEM]...", help="Items by id; all if none is given."),
    ] = None,
    list_items: Annotated[
        bool, typer.Option("--list", help="List the items and do nothing else.")
    ] = False,
    seeds: Annotated[
        int | None, typer.Option(help=f"How many seeds, from 0; {SEEDS} if not given.", min=1)
    ] = None,
    noise: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME|SIGMA",
            help="Measurement noise, known to the filters: a detector's, or a standard deviation"
            f" in metres; repeatable or comma-separated. {','.join(NOISES)} if not given.",
        ),
    ] = None,
    filters: Annotated[
        str | None,
        typer.Option(help=f"Comma-separated; if not given: {','.join(FILTERS)}."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for ITEM.parquet, ITEM-differences.parquet, ITEM.png."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Answer questions of the paper: tables, and with --out also files and pictures."""
    chosen = _chosen(names)
    if list_items:
        _list(chosen, as_json)
        return
    options = Options(seeds, _split(noise), _split(None if filters is None else [filters]))
    try:
        prepared = [(item, item.prepare(options)) for item in chosen]
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
    answered = [(item, _answer(item, work)) for item, work in prepared]
    written = [path for item, answer in answered for path in _write(item, answer, out)]
    if as_json:
        print(json.dumps({"items": [_document(*pair) for pair in answered]}, allow_nan=False))
        return
    shown = Console() if Console().is_terminal else Console(width=WIDTH)
    for item, answer in answered:
        shown.print(f"[bold]{item.id}[/bold]: {escape(item.question)} ({escape(item.where)})")
        for table in answer.tables():
            shown.print(table, highlight=False)
    for path in written:
        print(path)


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


def _split(texts: list[str] | None) -> tuple[str, ...] | None:
    """The parts of comma-separated texts, each once; None if there are no texts."""
    if not texts:
        return None
    return tuple(dict.fromkeys(part.strip() for text in texts for part in text.split(",")))


def _list(items: list[Item], as_json: bool) -> None:
    if as_json:
        rows = [{"id": item.id, "question": item.question, "where": item.where} for item in items]
        print(json.dumps({"rows": rows}))
        return
    table = Table(box=SIMPLE_HEAD)
    for heading in ("item", "question", "where"):
        table.add_column(heading)
    for item in items:
        table.add_row(*map(escape, (item.id, item.question, item.where)))
    Console().print(table)


def _answer(item: Item, work: Callable[[Callable[[float], None]], Answer]) -> Answer:
    """The work's answer, with a bar on a terminal while it lasts."""
    console = Console(stderr=True)
    columns = (TextColumn(item.id), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task(item.id, total=1.0)
        return work(lambda done: bar.update(task, completed=done))


def _write(item: Item, answer: Answer, out: Path | None) -> list[Path]:
    """The files of an answer, each whole or not there; none without a folder."""
    if out is None:
        return []
    rows, differences = out / f"{item.id}.parquet", out / f"{item.id}-differences.parquet"
    picture = out / f"{item.id}.png"
    write_frame(answer.rows, rows)
    write_frame(answer.differences, differences)
    with replacing(picture) as temporary:
        answer.figure().savefig(temporary, format="png", dpi=DOTS_PER_INCH)
    return [rows, differences, picture]


def _document(item: Item, answer: Answer) -> dict[str, Any]:
    return {
        "id": item.id,
        "question": item.question,
        "where": item.where,
        "rows": answer.rows.to_dicts(),
        "differences": answer.differences.to_dicts(),
    }
