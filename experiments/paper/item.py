"""What an item of the paper is: a question, where it stands, and a function that answers it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import polars as pl
from matplotlib.figure import Figure
from rich.console import RenderableType

Progress = Callable[[float], None]


@dataclass(frozen=True)
class Options:
    """What a user may choose; None leaves the choice to the item.

    seeds: how many, from 0. noises and filters: by name.
    """

    seeds: int | None = None
    noises: tuple[str, ...] | None = None
    filters: tuple[str, ...] | None = None


@dataclass(frozen=True)
class Answer:
    """rows: one for each measured cell. differences: paired, one for each pair of filters.

    tables and figure make what is shown of them.
    """

    rows: pl.DataFrame
    differences: pl.DataFrame
    tables: Callable[[], Sequence[RenderableType]]
    figure: Callable[[], Figure]


@dataclass(frozen=True)
class Item:
    """A table, figure or claim. where: its place in the paper or in the project's notes.

    prepare: turns the options into the work, or raises `ValueError` for a choice there is not; the
        work tells how much of it is done, from 0 to 1.
    """

    id: str
    question: str
    where: str
    prepare: Callable[[Options], Callable[[Progress], Answer]]
