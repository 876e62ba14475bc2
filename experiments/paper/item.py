"""What an item of the paper is: a question, the jobs that it needs, and the answer they give.

An answer's numbers are cells: each an estimate of rows of results that it names, so that whoever
doubts a number finds the rows behind it.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import polars as pl
from matplotlib.figure import Figure

from experiments.estimates import Estimate, Where, estimate
from experiments.jobs import Job
from experiments.statistics import told
from experiments.studies.scale import Scale

CELLS = {
    "item": pl.String,
    "table": pl.String,
    "line": pl.String,
    "column": pl.String,
    "source": pl.String,
    "unit": pl.String,
    "decimals": pl.Int64,
    "better": pl.String,
    "value": pl.Float64,
    "low": pl.Float64,
    "high": pl.Float64,
    "n": pl.Int64,
    "scenarios": pl.Int64,
    "paper": pl.Float64,
    "where": pl.String,
    "against": pl.String,
}
"""Columns of the results: a row for each number that is shown. table, line, column: where it
stands. source: `synthetic`, `recorded`, `closed form` or `machine`. better: `higher`, `lower`, or
null where neither is. paper: the paper's own value. where: the rows of `runs.parquet` that it is
the estimate of, a JSON object of columns and values; against: null, or the columns replaced in
those it is a paired difference from."""

PARTED = ("study", "metric")

Source = Literal["synthetic", "recorded", "closed form", "machine"]
Better = Literal["higher", "lower"] | None


@dataclass(frozen=True)
class Picture:
    """A figure of an item. data: what is drawn. page: what stands for it in a page, where that is
    more than the figure: a self-contained piece of HTML."""

    name: str
    caption: str
    draw: Callable[[], Figure]
    data: pl.DataFrame
    page: Callable[[], str] | None = None


@dataclass(frozen=True)
class Answer:
    """cells: the numbers, with the columns `CELLS`; tables, lines and columns are shown in the
    order in which they come. captions: by table, what people must know to read it."""

    cells: pl.DataFrame
    captions: Mapping[str, str] = field(default_factory=dict)
    pictures: Sequence[Picture] = ()


@dataclass(frozen=True)
class Item:
    """A table or figure.

    place: where in the paper. caption: what differs in kind from the paper's. jobs: what must be
    done for it at a scale. answer: of all rows of a run, those of its jobs among them.
    """

    id: str
    place: str
    question: str
    caption: str
    jobs: Callable[[Scale], Sequence[Job]]
    answer: Callable[[pl.DataFrame], Answer]


class Cells:
    """Collects an item's cells, each an estimate of some of the rows."""

    def __init__(self, item: str, rows: pl.DataFrame) -> None:
        self._item = item
        self._rows = rows
        # Thousands of cells ask for a few rows of millions, most of them by study and metric.
        self._parts = rows.partition_by(*PARTED, as_dict=True)
        self._cells: list[dict[str, Any]] = []

    def add(
        self,
        place: tuple[str, str, str],
        where: Where,
        unit: str,
        *,
        source: Source = "synthetic",
        against: Where | None = None,
        decimals: int = 2,
        better: Better = None,
        paper: float | None = None,
    ) -> Estimate:
        """Add the estimate of the rows of `where`, or of its paired difference from those with
        `against` in place of some columns. place: table, line and column.

        A cell without a value is there too, empty.
        """
        found = estimate(self._part(where, against or {}), where, against)
        place_of = dict(zip(("table", "line", "column"), place, strict=True))
        values: dict[str, Any] = {"item": self._item, **place_of}
        values.update(source=source, unit=unit, decimals=decimals, better=better, paper=paper)
        values.update({name: told(getattr(found, name)) for name in ("value", "low", "high")})
        values.update(n=found.n, scenarios=found.scenarios, where=json.dumps(dict(where)))
        values["against"] = None if against is None else json.dumps(dict(against))
        self._cells.append(values)
        return found

    def _part(self, where: Where, against: Where) -> pl.DataFrame:
        """Rows among which are all that are asked for."""
        if not where.keys() >= set(PARTED) or against.keys() & set(PARTED):
            return self._rows
        return self._parts.get(tuple(where[name] for name in PARTED), self._rows.clear())

    def frame(self) -> pl.DataFrame:
        """The cells, with the columns `CELLS`."""
        return pl.DataFrame(self._cells, schema=CELLS)


def again(rows: pl.DataFrame, cell: Mapping[str, Any]) -> Estimate:
    """A cell's estimate, from the rows that it names."""
    against = None if cell["against"] is None else json.loads(cell["against"])
    return estimate(rows, json.loads(cell["where"]), against)
