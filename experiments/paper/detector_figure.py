"""What MD gains over each filter of its order, by detector: a panel for each score and order."""

import json

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.figures import colours

MARKERS = {"synthetic": "o", "recorded": "D"}
SPREAD = 0.5
"""Height of the band that a detector's filters share, of the distance between detectors."""


def gains_figure(gains: pl.DataFrame) -> Figure:
    """A panel for each table of the gains: cells of paired differences, a line a detector, with
    their 95 % intervals; filled simulated, hollow recorded."""
    tables = gains["table"].unique(maintain_order=True).to_list()
    figure = Figure(figsize=(11, 3.1 * ((len(tables) + 1) // 2)), layout="constrained")
    panels = figure.subplots((len(tables) + 1) // 2, 2, squeeze=False, sharey="row", sharex="col")
    for axes, table in zip(panels.flat, tables, strict=False):
        _panel(axes, gains.filter(table=table))
        axes.set_title(table, fontsize=10)
    for axes in panels[:, -1]:
        axes.legend(frameon=False, fontsize=9, loc="center left", bbox_to_anchor=(1.0, 0.5))
    for axes in panels[-1]:
        axes.set_xlabel("gain of MD [points], bar: 95 % interval")
    return figure


def _panel(axes: Axes, gains: pl.DataFrame) -> None:
    lines = gains["line"].unique(maintain_order=True).to_list()
    opponents = [json.loads(text)["filter"] for text in gains["against"]]
    own = gains.with_columns(opponent=pl.Series(opponents, dtype=pl.String))
    names = own["opponent"].unique(maintain_order=True).to_list()
    offsets = np.linspace(-SPREAD / 2, SPREAD / 2, len(names))
    for (name, colour), offset in zip(colours(names).items(), offsets, strict=True):
        for source, marker in MARKERS.items():
            part = own.filter(opponent=name, source=source).drop_nulls("value")
            value = part["value"].to_numpy()
            place = [lines.index(line) + offset for line in part["line"]]
            # A bootstrap's interval need not hold the mean; without one there is no bar.
            low, high = (part[side].fill_null(part["value"]).to_numpy() for side in ("low", "high"))
            axes.hlines(place, low, high, color=colour, linewidth=1.6, alpha=0.75)
            axes.scatter(
                *(value, place),
                marker=marker,
                s=26,
                color=colour if source == "synthetic" else "white",
                edgecolors=colour,
                label=f"MD less {name}" if source == "synthetic" else None,
                zorder=3,
            )
    axes.axvline(0.0, color="black", linewidth=0.8)
    axes.set_yticks(range(len(lines)), lines)
    axes.set_ylim(len(lines) - 0.5, -0.5)
    axes.grid(axis="x", alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
