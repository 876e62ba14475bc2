"""Cells into tables on a terminal: means ± half of the interval, the best in bold, the paper's."""

from collections.abc import Iterator, Mapping
from typing import Any

import polars as pl
from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from experiments.paper.item import Answer, Item

MANY = 9
"""Columns from which they stand closer, so that values need no second line in 120 characters."""

_NOUNS = {
    "synthetic": "seeds",
    "closed form": "seeds",
    "recorded": "sequences",
    "machine": "rounds",
}


def tables(item: Item, answer: Answer) -> Iterator[Table]:
    """The answer's tables, in the order of its cells."""
    for (name,), cells in answer.cells.group_by("table", maintain_order=True):
        caption = " ".join(filter(None, (answer.captions.get(str(name)), sample(cells))))
        columns = headings(cells)
        table = Table(
            title=escape(str(name)),
            title_justify="left",
            caption=escape(caption),
            caption_justify="left",
            box=SIMPLE_HEAD,
            padding=(0, int(len(columns) < MANY), 0, 0),
        )
        table.add_column("", no_wrap=True)
        for heading in columns.values():
            table.add_column(escape(heading), justify="right")
        leaders = best(cells)
        for (line,), own in cells.group_by("line", maintain_order=True):
            by_column = {cell["column"]: cell for cell in own.to_dicts()}
            texts = [_text(by_column.get(column), leaders) for column in columns]
            table.add_row(escape(str(line)), *texts)
        yield table


def headings(cells: pl.DataFrame) -> Mapping[str, str]:
    """Columns of a table, in their order, with their units."""
    pairs = cells.unique("column", maintain_order=True).select("column", "unit").iter_rows()
    told = ((str(column), str(unit)) for column, unit in pairs)
    return {column: f"{column} [{unit}]" if unit else column for column, unit in told}


def sample(cells: pl.DataFrame) -> str:
    """How many seeds, of how many scenarios, or recorded sequences, are behind a table."""
    parts = []
    for source, noun in _NOUNS.items():
        own = cells.filter(source=source)
        if own.is_empty():
            continue
        n, scenarios = (max(own[name].to_list()) for name in ("n", "scenarios"))
        of = f" of {scenarios} scenarios" if source == "synthetic" and scenarios != 1 else ""
        parts.append(f"{source}: {n} {noun if n != 1 else noun.removesuffix('s')}{of}")
    return "; ".join(parts).capitalize() + "." if parts else ""


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
