"""Errors around gaps into curves: how a filter's error grows with the time without a detection.

Two ways to look at it. At the ends: the error in the last frame of gaps of one length after the
other, each length a run of its own; longer gaps need longer trajectories, so that there are fewer
of them, and of other objects. Within: the errors in the frames of the longest gaps, all of the same
objects. Natural occlusions last as long as they last, and are always looked at within.
"""

from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
import polars as pl
from rich.box import SIMPLE_HEAD
from rich.console import Group
from rich.markup import escape
from rich.table import Table

from experiments.bins import EVERYTHING
from experiments.estimates import cluster_bootstrap
from experiments.occlusion import OcclusionProtocol
from experiments.statistics import told
from experiments.terminal import best
from mdkf.tables import REGIMES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

GROWTH = {
    "regime": pl.String,
    "offset": pl.Int64,
    "drift": pl.Float64,
    "gaps": pl.Int64,
}
"""Columns of `growth`. regime: the true one as the gap begins. offset: frame of the gap, counted
from 0, and -1 for the last frame before it, in which the object was detected. drift: mean over gaps
[m]. gaps: how many have a value."""

CURVE = {
    "protocol": pl.String,
    "filter": pl.String,
    "regime": pl.String,
    "length": pl.Int64,
    "error": pl.Float64,
    "low": pl.Float64,
    "high": pl.Float64,
    "gaps": pl.Int64,
    "seeds": pl.Int64,
    "scenarios": pl.Int64,
}
"""Columns of `growth_curve`. protocol: the occlusion as text, `*` for its length. regime: as the
gap begins, or all. length: frames without a detection. error: mean drift in the last of them [m],
of 0 frames in the one before the gap; low, high: its 95 % interval, null where there is one value
alone. gaps: behind it, of so many seeds in all scenarios."""

ANY_LENGTH = "*"

MOST_COLUMNS = 9
"""Lengths that a table shows."""

TEN_METRES = 10.0
"""Errors from which on a table shows one decimal [m]."""

CHARACTERS = 11
"""Of a figure's title to an inch."""


def growth(errors: pl.DataFrame) -> pl.DataFrame:
    """How a filter's own error grows in the gaps of one run: rows with the columns `GROWTH`, by
    regime and offset.

    errors: `experiments.world.Followed.errors`.
    """
    begun = (pl.col("phase") == "gap") | (pl.col("offset") == -1)
    own = errors.filter(begun & pl.col("drift").is_not_null()).group_by("regime", "offset")
    means = own.agg(pl.col("drift").mean(), pl.len().alias("gaps"))
    return means.sort("regime", "offset").cast(GROWTH)  # type: ignore[arg-type]


def growth_curve(rows: pl.DataFrame, within: bool = False) -> pl.DataFrame:
    """The error against the frames without a detection, with intervals: the columns `CURVE`.

    rows: `growth` of many runs, with the columns scenario, seed, filter, occlusion (as
    `OcclusionProtocol.parse` takes it) and length (its), all of one detector. within: of the
    longest gaps of each protocol, frame by frame, in place of the ends of gaps of all lengths.
    Natural occlusions are told at the lengths of the others, or at all if there are no others.

    A seed's value is its mean over gaps, and all scenarios count alike (`experiments.estimates`).
    """
    if rows.is_empty():
        return pl.DataFrame(schema=CURVE)
    found = []
    points = _points(rows, within)
    for (protocol, name), own in points.group_by("protocol", "filter", maintain_order=True):
        every = own.with_columns(regime=pl.lit(EVERYTHING))
        by_seed = (
            pl.concat([every, own])
            .group_by("regime", "length", "scenario", "seed", maintain_order=True)
            .agg(
                value=(pl.col("drift") * pl.col("gaps")).sum() / pl.col("gaps").sum(),
                gaps=pl.col("gaps").sum(),
            )
        )
        for (regime, length), one in by_seed.group_by("regime", "length", maintain_order=True):
            mean = cluster_bootstrap(one)
            values = (told(mean.value), told(mean.low), told(mean.high))
            counts = (one["gaps"].sum(), mean.n, mean.scenarios)
            found.append((protocol, name, regime, length, *values, *counts))
    curve = pl.DataFrame(found, CURVE, orient="row")
    order = pl.Enum([EVERYTHING, *REGIMES])
    by_regime = pl.col("regime").cast(order)
    # Sorting is stable: protocols and filters stay in the order in which they are given.
    places = [_place(curve, "protocol"), by_regime, _place(curve, "filter"), pl.col("length")]
    return curve.sort(places, maintain_order=True)


def growth_figure(curve: pl.DataFrame, dt: float) -> "Figure | None":
    """The curve as panels: a row for each protocol, a column for each regime, a line with its band
    for each filter; None without a gap. dt: time between frames [s].

    Means of a single seed, which have no interval, are left out where others have one.
    """
    from matplotlib.figure import Figure

    from experiments.figures import colours

    if curve.is_empty():
        return None
    if curve["low"].is_not_null().any():
        curve = curve.filter(pl.col("low").is_not_null())
    protocols = curve["protocol"].unique(maintain_order=True).to_list()
    regimes = curve["regime"].unique(maintain_order=True).to_list()
    colour = colours(curve["filter"].unique(maintain_order=True).to_list())
    width, height = 2.7 * len(regimes) + 1.8, 2.9 * len(protocols) + 1.0
    figure = Figure(figsize=(width, height), layout="constrained")
    panels = figure.subplots(
        len(protocols), len(regimes), sharex="row", sharey="col", squeeze=False
    )
    for protocol, row in zip(protocols, panels, strict=True):
        for regime, axes in zip(regimes, row, strict=True):
            own = curve.filter(protocol=protocol, regime=regime)
            _draw(axes, own, colour, dt)
            axes.set_title(f"{regime.replace('_', ' ')}\n{_counted(own)}", fontsize=9)
        row[0].set_ylabel(f"{_described(protocol)}\ndrift [m]", fontsize=9)
    for axes in panels.flat:
        axes.set_ylim(bottom=0)
    title = (
        "Drift after so long without a detection, by true regime as it began;"
        " mean over gaps, band: 95 % over scenarios and seeds"
    )
    figure.suptitle(fill(title, int(width * CHARACTERS)), fontsize=10)
    figure.supxlabel("time without a detection [s]", fontsize=10)
    lines = {line.get_label(): line for axes in panels.flat for line in axes.get_lines()}
    named = [lines[name] for name in colour]
    figure.legend(handles=named, loc="outside right center", frameon=False, fontsize=9)
    return figure


def growth_table(curve: pl.DataFrame, intervals: bool = True) -> Group:
    """The curve as tables for a terminal, one for each protocol: lengths from left to right,
    filters by regime, the best in bold. intervals: whether they are shown."""
    tables = curve.group_by("protocol", maintain_order=True)
    return Group(*(_table(str(protocol), own, intervals) for (protocol,), own in tables))


def _table(protocol: str, curve: pl.DataFrame, intervals: bool) -> Table:
    """Of one protocol."""
    lengths = _shown(sorted(set(curve["length"])))
    title = f"{_described(protocol)}: drift [m] after so many frames without a detection"
    title += ", means" + " ± half of the 95 % interval" * intervals
    table = Table(title=escape(title), title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("filter", no_wrap=True)
    for length in lengths:
        table.add_column(str(length), justify="right", no_wrap=True)
    for (regime,), own in curve.group_by("regime", maintain_order=True):
        by_filter = {
            name: {row["length"]: row for row in one.to_dicts()}
            for (name,), one in own.group_by("filter", maintain_order=True)
        }
        columns = [
            [one[length] for one in by_filter.values() if length in one] for length in lengths
        ]
        table.add_row(f"[italic]{escape(str(regime).replace('_', ' '))}[/italic]")
        counts = (max((row["gaps"] for row in column), default=0) for column in columns)
        table.add_row("gaps", *map(str, counts), style="dim")
        least = [best(column, "error", smaller=True) for column in columns]
        for name, one in by_filter.items():
            at = zip(map(one.get, lengths), least, strict=True)
            table.add_row(escape(str(name)), *(_cell(*cell, intervals) for cell in at))
    return table


def _points(rows: pl.DataFrame, within: bool) -> pl.DataFrame:
    """The rows that are on the curve, with the columns protocol and length, the frames without a
    detection."""
    protocols = {text: OcclusionProtocol.parse(text) for text in rows["occlusion"].unique()}
    names = {text: _any_length(protocol) for text, protocol in protocols.items()}
    natural = [text for text, protocol in protocols.items() if protocol.kind == "natural"]
    own = rows.with_columns(
        protocol=pl.col("occlusion").replace_strict(names, return_dtype=pl.String),
        natural=pl.col("occlusion").is_in(natural),
        frames=pl.col("offset") + 1,
    )
    longest = pl.col("length") == pl.col("length").max().over("protocol")
    looked_at = pl.lit(within) | pl.col("natural")
    on_it = pl.when(looked_at).then(longest).otherwise(pl.col("frames") == pl.col("length"))
    points = own.filter(on_it)
    told_at = points.filter(~pl.col("natural"))["frames"].unique()
    if len(told_at):
        points = points.filter(~pl.col("natural") | pl.col("frames").is_in(told_at.implode()))
    return points.select(
        *("protocol", "filter", "regime", "scenario", "seed", "drift", "gaps"),
        pl.col("frames").alias("length"),
    )


def _any_length(protocol: OcclusionProtocol) -> str:
    """A protocol as text whatever its length."""
    kind, _, *others = str(protocol).split(":")
    return ":".join((kind, ANY_LENGTH, *others))


def _described(protocol: str) -> str:
    """A protocol whatever its length, for a reader."""
    kind, _, warmup, *others = protocol.split(":")
    return ", ".join((kind, f"warm-up {warmup}", *others))


def _place(curve: pl.DataFrame, column: str) -> pl.Expr:
    """Sorts a column's values in the order in which they come first."""
    return pl.col(column).cast(pl.Enum(curve[column].unique(maintain_order=True)))


def _draw(axes: "Axes", own: pl.DataFrame, colour: dict[str, str], dt: float) -> None:
    """One panel."""
    from experiments.figures import line_style

    for (name,), one in own.group_by("filter", maintain_order=True):
        line = one.sort("length")
        seconds = line["length"].to_numpy() * dt
        low, high = (line[side].to_numpy().astype(np.float64) for side in ("low", "high"))
        axes.plot(
            *(seconds, line["error"].to_numpy(), line_style(str(name))),
            color=colour[str(name)],
            label=name,
            linewidth=1.6,
            marker="o" if len(line) <= MOST_COLUMNS else "",
            markersize=3,
        )
        axes.fill_between(seconds, low, high, color=colour[str(name)], alpha=0.13, linewidth=0)
    axes.set_xlim(left=0)
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)


def _counted(own: pl.DataFrame) -> str:
    """How many gaps there are, from the shortest length to the longest."""
    if own.is_empty():
        return "no gaps"
    by_length = own.group_by("length").agg(pl.col("gaps").max()).sort("length")["gaps"]
    first, last = by_length[0], by_length[-1]
    return f"{first} gaps" if first == last else f"{first} to {last} gaps"


def _shown(lengths: list[int]) -> list[int]:
    """The lengths themselves, or of many some, evenly, the first and the last with them."""
    if len(lengths) <= MOST_COLUMNS:
        return lengths
    places = np.linspace(0, len(lengths) - 1, MOST_COLUMNS).round().astype(int)
    return [lengths[place] for place in places]


def _cell(row: dict[str, Any] | None, least: float | None, intervals: bool) -> str:
    if row is None:
        return "–"
    decimals = 2 if row["error"] < TEN_METRES else 1
    text = f"{row['error']:.{decimals}f}"
    if intervals and row["low"] is not None:
        text += f" ±{(row['high'] - row['low']) / 2:.{decimals}f}"
    return f"[bold]{text}[/bold]" if row["error"] == least else text
