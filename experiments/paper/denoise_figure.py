"""Errors of what stands for a position: over time for two cars, and as bars by detector."""

from itertools import product

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

_COLOURS = {
    "detection": "#1f5fd0",
    "posterior": "#e07b00",
    "post-processed (literal)": "#2a9d3a",
    "post-processed (innovation)": "#7b3fb5",
    "post-processed (posterior)": "#c2185b",
}
"""The first three as in the paper."""

_DASHED = "post-processed (literal)"
"""Hardly differs from the detection: dashed on top of it, both can be seen."""

_DRAWN = tuple(name for name in _COLOURS if name != "post-processed (posterior)")
"""Over time; what is left out is the posterior of a filter like the one drawn."""


def cars(data: pl.DataFrame) -> Figure:
    """data: scenario, filter, metric, frame, value; `error` [m] by frame, `mse` [m2], `spread`
    [m]."""
    names = data["scenario"].unique(maintain_order=True).to_list()
    whole = Figure(figsize=(11, 3.9 * len(names)), layout="constrained")
    for axes, scenario in zip(
        whole.subplots(len(names), 1, squeeze=False)[:, 0], names, strict=True
    ):
        for name in _DRAWN:
            own = data.filter(scenario=scenario, filter=name)
            by_frame = own.filter(metric="error").sort("frame")
            mse, spread = (
                own.filter(metric=metric)["value"].item() for metric in ("mse", "spread")
            )
            axes.plot(
                by_frame["frame"],
                by_frame["value"],
                linestyle=(0, (3, 2)) if name == _DASHED else "-",
                color=_COLOURS[name],
                linewidth=1.2,
                label=f"{name}: {mse:.4f} m$^2$, {spread:.3f} m",
            )
        axes.set_title(f"a car in {scenario}", fontsize=10, loc="left")
        axes.set_ylabel("distance from the truth [m]")
        axes.set_ylim(bottom=0)
        axes.margins(x=0.01)
        axes.grid(alpha=0.25)
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(
            frameon=False, fontsize=8.5, ncols=2, loc="lower right", bbox_to_anchor=(1.0, 0.98)
        )
    axes.set_xlabel("detections of the car, in order")
    return whole


def bars(data: pl.DataFrame) -> Figure:
    """data: part, which, detector, filter, value, low, high: MSE [m2]; a row of panels for each
    `which`, a column for each part."""
    parts = data["part"].unique(maintain_order=True).to_list()
    rows = data["which"].unique(maintain_order=True).to_list()
    whole = Figure(figsize=(4.2 * len(parts), 3.4 * len(rows)), layout="constrained")
    panels = whole.subplots(len(rows), len(parts), sharey="row", squeeze=False)
    for (row, which), (column, part) in product(enumerate(rows), enumerate(parts)):
        axes = panels[row, column]
        _draw_bars(axes, data.filter(part=part, which=which))
        axes.set_title(f"{part}, {which}", fontsize=10)
        if column == 0:
            axes.set_ylabel("mean squared error [m$^2$]")
    handles, names = panels[0, 0].get_legend_handles_labels()
    whole.legend(handles, names, loc="outside upper center", ncols=3, frameon=False, fontsize=9)
    return whole


def _draw_bars(axes: Axes, data: pl.DataFrame) -> None:
    """The estimates side by side for each detector."""
    width = 0.8 / len(_COLOURS)
    detectors = data["detector"].unique(maintain_order=True).to_list()
    for k, (name, colour) in enumerate(_COLOURS.items()):
        one = data.filter(filter=name)
        value, low, high = (
            one[column].to_numpy().astype(np.float64) for column in ("value", "low", "high")
        )
        place = np.arange(len(detectors)) + (k - (len(_COLOURS) - 1) / 2) * width
        certain = np.nan_to_num(np.array([value - low, high - value]))
        axes.bar(place, value, width, color=colour, label=name)
        axes.errorbar(place, value, certain, fmt="none", ecolor="black", elinewidth=0.9)
    axes.set_xticks(np.arange(len(detectors)), detectors)
    axes.grid(alpha=0.25, axis="y")
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
