"""Errors over time in the gap, a panel for each motion regime and noise."""

import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.figures import colours, line_style
from experiments.paper.motions import REGIMES, Regime
from experiments.paper.regimes import DT, GAPS, HISTORIES, Results

DRAWN = ("ca", "imm", "imm-zero", "md")
COLUMNS = 5
"""Panels in a row; the legend takes the place after the last."""


def figure(results: Results) -> Figure:
    """Mean errors of CA, both IMMs and MD (of what there is, if none of these) after the long
    history, with 95 % bands over seeds; panels have scales of their own."""
    errors = results.over_time.filter(history=max(HISTORIES))
    there = errors["filter"].unique(maintain_order=True).to_list()
    drawn = [name for name in DRAWN if name in there] or there
    regimes = [regime for regime in REGIMES if regime.id in set(errors["regime"])]
    noises = errors["noise"].unique(maintain_order=True).to_list()
    rows = len(regimes) // COLUMNS + 1  # one place is the legend's
    whole = Figure(figsize=(3.1 * COLUMNS, (2.55 * rows + 0.3) * len(noises)), layout="constrained")
    parts = whole.subfigures(len(noises), 1, squeeze=False)[:, 0]
    for part, noise in zip(parts, noises, strict=True):
        measured = f"white noise of {noise} m" if noise[0].isdigit() else f"noise of {noise}"
        part.suptitle(
            f"{measured}, {max(HISTORIES)} frames of history, {results.rows['seeds'][0]} seeds;"
            " bands: 95 % interval of the mean",
            fontsize=11,
        )
        panels = part.subplots(rows, COLUMNS, squeeze=False).ravel()
        for axes, regime in zip(panels, regimes, strict=False):
            _draw(axes, regime, errors.filter(regime=regime.id, noise=noise), drawn)
        for place in range(len(regimes)):
            if place % COLUMNS == 0:
                panels[place].set_ylabel("mean position error [m]")
            if place + COLUMNS >= len(regimes):
                panels[place].set_xlabel("time since the gap began [s]")
        for axes in panels[len(regimes) :]:
            axes.set_axis_off()
        handles, labels = panels[0].get_legend_handles_labels()
        panels[len(regimes)].legend(handles, labels, frameon=False, fontsize=11, loc="center")
    return whole


def _draw(axes: Axes, regime: Regime, errors: pl.DataFrame, drawn: list[str]) -> None:
    for name, colour in colours(drawn).items():
        own = errors.filter(filter=name).sort("time")
        time = own["time"].to_numpy()
        axes.plot(time, own["error"], line_style(name), color=colour, label=name, linewidth=1.8)
        if own["low"].null_count() == 0:
            axes.fill_between(time, own["low"], own["high"], color=colour, alpha=0.25, linewidth=0)
    axes.set_xlim(0, (max(GAPS) - 1) * DT)
    axes.set_ylim(bottom=0)
    axes.set_title(regime.title, fontsize=9.5)
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
