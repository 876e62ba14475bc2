"""Answers into one self-contained HTML page: claims on top, tables, figures, playback.

Every number in a table carries the number of its row of `results.parquet`, which in turn names the
rows of `runs.parquet` that it was estimated from.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import polars as pl
from markupsafe import Markup

from experiments.claims.hypotheses import SOURCES
from experiments.claims.scoreboard import counts
from experiments.page import svg, write_page
from experiments.paper.item import Answer, Item
from experiments.paper.tables import best, headings, sample, told_value
from experiments.studies.scale import Scale

NAME = "report.html"


def write_report(
    items: Sequence[Item],
    answers: Mapping[str, Answer],
    cells: pl.DataFrame,
    verdicts: pl.DataFrame,
    scale: Scale,
    out: Path,
    command: str,
) -> Path:
    """Write `report.html` into `out` and return its path; needs no network to be read."""
    path = out / NAME
    numbered = cells.with_row_index("row")
    write_page(
        "paper/report.html.j2",
        path,
        scale=scale,
        command=command,
        claims=list(_claims(verdicts)),
        counts=counts(verdicts),
        items=[
            {
                "item": item,
                "tables": list(_tables(numbered.filter(item=item.id), answers[item.id])),
                "pictures": list(_pictures(answers[item.id])),
            }
            for item in items
        ],
    )
    return path


def _claims(verdicts: pl.DataFrame) -> Iterator[dict[str, Any]]:
    """The claims that are tested here, in the order of the paper, with their verdicts by source; of
    those that are not, why."""
    for (name,), own in verdicts.with_row_index("row").group_by("id", maintain_order=True):
        lines = {line["source"]: line for line in own.to_dicts()}
        yield {"id": name, **lines["synthetic"], "sources": [lines[source] for source in SOURCES]}


def _tables(cells: pl.DataFrame, answer: Answer) -> Iterator[dict[str, Any]]:
    """The tables of an item: headings, lines of cells, and what people must know to read them."""
    for (name,), own in cells.group_by("table", maintain_order=True):
        columns = headings(own)
        leaders = best(own)
        lines = []
        for (line,), of_line in own.group_by("line", maintain_order=True):
            by_column = {cell["column"]: cell for cell in of_line.to_dicts()}
            lines.append(
                {
                    "name": line,
                    "cells": [_cell(by_column.get(column), leaders) for column in columns],
                }
            )
        yield {
            "name": name,
            "headings": list(columns.values()),
            "lines": lines,
            "caption": answer.captions.get(str(name), ""),
            "sample": sample(own),
        }


def _cell(cell: Mapping[str, Any] | None, leaders: Mapping[str, float]) -> dict[str, Any] | None:
    """What a page shows of a cell; None where the table has none."""
    if cell is None:
        return None
    leader = leaders.get(cell["column"])
    return {
        "row": cell["row"],
        "text": told_value(cell),
        "best": cell["value"] is not None and cell["value"] == leader,
        "source": cell["source"],
        "paper": None if cell["paper"] is None else f"{cell['paper']:g}",
    }


def _pictures(answer: Answer) -> Iterator[dict[str, Any]]:
    for picture in answer.pictures:
        drawn = svg(picture.draw()) if picture.page is None else Markup(picture.page())
        yield {"name": picture.name, "caption": picture.caption, "drawn": drawn}
