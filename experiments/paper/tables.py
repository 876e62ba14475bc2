"""Cells into tables on a terminal: means ± half of the interval, the best in bold, the paper's."""

from collections.abc import Iterator, Mapping
from typing import Any

import polars as pl
from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from experiments.paper.item import Answer, Item


def tables(item: Item, answer: Answer) -> Iterator[Table]:
    """The answer's tables, in the order of its cells."""
    for (name,), cells in answer.cells.group_by("table", maintain_order=True):
        table = Table(
            title=escape(str(name)),
            title_justify="left",
            caption=escape(answer.captions.get(str(name), "")) or None,
            caption_justify="left",
            box=SIMPLE_HEAD,
            padding=(0, 1, 0, 0),
        )
        columns = cells.unique("column", maintain_order=True)
        table.add_column("")
        for heading, unit in columns.select("column", "unit").iter_rows():
            told_unit = f" [{unit}]" if unit else ""
            table.add_column(escape(f"{heading}{told_unit}"), justify="right")
        leaders = best(cells)
        for (line,), own in cells.group_by("line", maintain_order=True):
            by_column = {cell["column"]: cell for cell in own.to_dicts()}
            texts = [_text(by_column.get(name), leaders) for name in columns["column"]]
            table.add_row(escape(str(line)), *texts)
        yield table


def best(cells: pl.DataFrame) -> Mapping[str, float]:
    """The best value of each column of a table in which one is better than another."""
    found = {}
    for (column, better), own in cells.group_by("column", "better"):
        values = own["value"].drop_nulls()
        if better is not None and len(values) > 1:
            found[str(column)] = float(values.max() if better == "higher" else values.min())  # type: ignore[arg-type]
    return found


def told_value(cell: Mapping[str, Any]) -> str:
    """A cell's value ± half of its interval, a difference with its sign; – is no value."""
    if cell["value"] is None:
        return "–"
    decimals = cell["decimals"]
    sign = "-" if cell["against"] is None else "+"
    text = f"{cell['value']:{sign}z.{decimals}f}"
    if cell["low"] is None:
        return text
    return f"{text} ±{(cell['high'] - cell['low']) / 2:.{decimals}f}"


def _text(cell: Mapping[str, Any] | None, leaders: Mapping[str, float]) -> str:
    if cell is None:
        return ""
    text = told_value(cell)
    if cell["value"] is not None and leaders.get(cell["column"]) == cell["value"]:
        text = f"[bold]{text}[/bold]"
    if cell["paper"] is not None:
        text += f" [dim]({cell['paper']:g})[/dim]"
    return text
