"""Errors of motion models over one journey, and the journey's speed and acceleration below."""

from itertools import groupby

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from experiments.figures import colours, line_style
from experiments.studies.dynamics import DRAWN
from mdkf.tables import REGIMES, FloatArray
from sim_bridge import DT

AVERAGED = 11
"""Frames over which errors are averaged: those up to half a second before and after."""

_SHADES = ("#c8ccd0", "#cfe3f7", "#fbe3c2", "#ecd3c9")
"""Of the regimes in their order: standing, then the paper's blue, orange and brown."""


def figure(data: pl.DataFrame) -> Figure:
    """data: filter (`truth` for the truth), metric, frame, value; `predicted` and `posterior`
    errors [m], `speed` [m/s], `acceleration` [m/s2] and `regime` (a code)."""
    whole = Figure(figsize=(11, 8), layout="constrained")
    panels = whole.subplots(4, 1, sharex=True, height_ratios=(1.5, 1.5, 0.8, 0.8))
    truth = {
        metric: _values(data, "truth", metric) for metric in ("speed", "acceleration", "regime")
    }
    for axes, metric, told in (
        (panels[0], "predicted", "mean error of the\nprediction [m]"),
        (panels[1], "posterior", "mean error of the\nposterior [m]"),
    ):
        for name, colour in colours(DRAWN).items():
            values = _averaged(_values(data, name, metric))
            time = DT * np.arange(len(values))
            axes.plot(time, values, line_style(name), color=colour, label=name, linewidth=1.5)
        axes.set_ylabel(told)
        axes.set_ylim(bottom=0)
    for axes, metric, told in (
        (panels[2], "speed", "speed\n[m/s]"),
        (panels[3], "acceleration", "acceleration\n[m/s$^2$]"),
    ):
        time = DT * np.arange(len(truth[metric]))
        axes.plot(time, truth[metric], color="black", linewidth=1.4)
        axes.set_ylabel(told)
    for axes in panels:
        _shade(axes, truth["regime"])
        axes.grid(alpha=0.25)
        axes.spines[["top", "right"]].set_visible(False)
    panels[-1].set_xlabel("time [s]")
    panels[-1].set_xlim(0, DT * len(truth["regime"]))
    lines, names = panels[0].get_legend_handles_labels()
    shades = [Patch(color=_SHADES[code], label=_name(code)) for code in range(len(_SHADES))]
    whole.legend(
        [*lines, *shades],
        [*names, *(str(shade.get_label()) for shade in shades)],
        loc="outside upper center",
        ncols=len(DRAWN),
        frameon=False,
        fontsize=9,
    )
    return whole


def _values(data: pl.DataFrame, name: str, metric: str) -> FloatArray:
    """Values by frame (n_frames,), NaN where there is none."""
    own = data.filter(filter=name, metric=metric).sort("frame")
    return own["value"].to_numpy().astype(np.float64)


def _averaged(values: FloatArray) -> FloatArray:
    """Means of `AVERAGED` frames around each (n_frames,), NaN where one of them has none."""
    kept = np.full(len(values), np.nan)
    half = AVERAGED // 2
    kept[half:-half] = np.lib.stride_tricks.sliding_window_view(values, AVERAGED).mean(axis=1)
    return kept


def _shade(axes: Axes, regime: FloatArray) -> None:
    start = 0
    for code, run in groupby(regime.astype(int)):
        stop = start + len(list(run))
        axes.axvspan(DT * start, DT * stop, color=_SHADES[code], linewidth=0, zorder=0)
        start = stop


def _name(code: int) -> str:
    return REGIMES[code].replace("_", " ")
