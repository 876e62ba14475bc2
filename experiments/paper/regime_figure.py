"""Errors over time in the gap, a panel for each motion regime."""

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.figures import colours, line_style
from experiments.statistics import mean_intervals
from experiments.studies.motions import REGIMES, Regime
from experiments.studies.regimes import DRAWN, DT, GAPS, HISTORIES, in_frame, occlusion

COLUMNS = 5
"""Panels in a row; the legend takes the place after the last."""
BAND = ("error", "low", "high")


def data(rows: pl.DataFrame, noise: str) -> pl.DataFrame:
    """regime, filter, time since the gap began [s], seeds, and mean errors with their 95 %
    interval over seeds (null with one) [m], in the longest history and gap."""
    own = rows.filter(detector=noise, occlusion=occlusion(max(GAPS), max(HISTORIES)))
    frames = [in_frame(k + 1) for k in range(max(GAPS))]
    found = []
    for (regime, name), part in own.filter(pl.col("bin").is_in(frames)).group_by(
        "scenario", "filter", maintain_order=True
    ):
        by_seed = part.pivot("bin", index="seed", values="value").select(frames).to_numpy()
        band = dict(zip(BAND, mean_intervals(by_seed), strict=True))
        time = DT * np.arange(max(GAPS))
        found.append(
            pl.DataFrame({"time": time, **band}).select(
                pl.lit(regime).alias("regime"),
                pl.lit(name).alias("filter"),
                "time",
                pl.lit(len(by_seed)).alias("seeds"),
                *(pl.col(column).fill_nan(None) for column in BAND),
            )
        )
    return pl.concat(found)


def figure(errors: pl.DataFrame) -> Figure:
    """What `data` gives, with bands where there is an interval."""
    regimes = [regime for regime in REGIMES if regime.id in set(errors["regime"])]
    rows = len(regimes) // COLUMNS + 1  # one place is the legend's
    whole = Figure(figsize=(3.1 * COLUMNS, 2.55 * rows + 0.3), layout="constrained")
    panels = whole.subplots(rows, COLUMNS, squeeze=False).ravel()
    for axes, regime in zip(panels, regimes, strict=False):
        _draw(axes, regime, errors.filter(regime=regime.id))
    for place in range(len(regimes)):
        if place % COLUMNS == 0:
            panels[place].set_ylabel("mean position error [m]")
        if place + COLUMNS >= len(regimes):
            panels[place].set_xlabel("time since the gap began [s]")
    for axes in panels[len(regimes) :]:
        axes.set_axis_off()
    handles, labels = panels[0].get_legend_handles_labels()
    seeds = errors["seeds"][0]
    panels[len(regimes)].legend(
        handles,
        labels,
        title=f"{seeds} seed{'s' * (seeds != 1)}",
        frameon=False,
        fontsize=11,
        loc="center",
    )
    return whole


def _draw(axes: Axes, regime: Regime, errors: pl.DataFrame) -> None:
    for name, colour in colours(DRAWN).items():
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
