"""Rows around switches of regime into figures: signals over time, drift by when a gap begins."""

from collections.abc import Sequence

import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.figures import colours, line_style
from experiments.statistics import mean_interval
from experiments.studies.switches import DRAWN, DT, GAP, SWITCHES

SEPARATION = " separation"
WEIGHTS = ("w_v", "w_a", "not cv")
"""Signals between 0 and 1, whose means are drawn."""


def course(rows: pl.DataFrame) -> pl.DataFrame:
    """Of the signals around switches, by scenario, filter, metric and time [s], the mean over
    batches with its 95 % interval: value, low, high."""
    return _summary(rows.filter(pl.col("bin").str.starts_with("frame ")))


def drifts(rows: pl.DataFrame) -> pl.DataFrame:
    """Of the drifts in gaps [m] likewise; time is that of the gap's beginning."""
    return _summary(rows.filter(metric="drift"))


def responses(curves: pl.DataFrame) -> Figure:
    """A column for each switch: means of weights and probabilities above, separations below."""
    figure = Figure(figsize=(17, 8), layout="constrained")
    panels = figure.subplots(2, len(SWITCHES), sharex=True, sharey="row")
    palette = colours(list(dict.fromkeys(name for name, _ in DRAWN)))
    for column, switch in enumerate(SWITCHES):
        own = curves.filter(scenario=switch.id)
        for name, signal in DRAWN:
            style = ":" if signal in ("w_a", "acceleration") else line_style(name)
            for axes, metric in zip(panels[:, column], (signal, signal + SEPARATION), strict=True):
                if metric == signal and signal not in WEIGHTS:
                    continue
                one = own.filter(filter=name, metric=metric)
                _draw(axes, one, palette[name], style, f"{name}: {signal}")
        panels[0, column].set_title(switch.title, fontsize=10)
        panels[1, column].set_xlabel("time since the switch [s]")
        panels[1, column].axhline(0.5, color="black", linewidth=0.8, alpha=0.5)
    for axes in panels.ravel():
        _finish(axes)
        axes.set_ylim(-0.02, 1.02)
        axes.axvline(0.0, color="black", linewidth=0.8)
    panels[0, 0].set_ylabel("mean of the signal [-]")
    panels[1, 0].set_ylabel("probability to exceed\nthat of a track without\nthe switch [-]")
    handles, labels = panels[1, 0].get_legend_handles_labels()
    figure.legend(handles, labels, frameon=False, ncols=len(DRAWN), loc="outside lower center")
    return figure


def gaps(told: pl.DataFrame, filters: Sequence[str]) -> Figure:
    """A panel for each switch, scales of their own."""
    figure = Figure(figsize=(12, 6.6), layout="constrained")
    panels = figure.subplots(2, 3).ravel()
    for axes, switch in zip(panels, SWITCHES, strict=False):
        for name, colour in colours(filters).items():
            one = told.filter(scenario=switch.id, filter=name)
            _draw(axes, one, colour, line_style(name), name)
        _finish(axes)
        axes.set_ylim(bottom=0)
        axes.axvline(0.0, color="black", linewidth=0.8)
        # These gaps hold the switch: it cannot be seen before they end.
        axes.axvspan(-GAP * DT, 0.0, color="#888888", alpha=0.15, linewidth=0)
        axes.set_title(switch.title, fontsize=10)
        axes.set_xlabel("beginning of the gap after the switch [s]")
        axes.set_ylabel("mean error over the gap [m]")
    handles, labels = panels[0].get_legend_handles_labels()
    last = panels[len(SWITCHES)]
    last.set_axis_off()
    last.legend(handles, labels, frameon=False, fontsize=11, loc="upper center")
    explained = f"shaded: the switch happens\nin the gap of {GAP * DT:g} s"
    last.text(0.5, 0.25, explained, ha="center", va="center", transform=last.transAxes)
    return figure


def _summary(rows: pl.DataFrame) -> pl.DataFrame:
    keys = ("scenario", "filter", "metric", "bin")
    found = []
    for key, own in rows.group_by(*keys, maintain_order=True):
        told = mean_interval(own["value"])
        time = int(str(key[3]).split()[1]) * DT
        place = dict(zip(keys[:3], key[:3], strict=True))
        found.append(
            {**place, "time": time, "value": told.mean, "low": told.low, "high": told.high}
        )
    columns = {**dict.fromkeys(keys[:3], pl.String)}
    columns |= dict.fromkeys(("time", "value", "low", "high"), pl.Float64)  # type: ignore[arg-type]
    return pl.DataFrame(found, schema=columns).with_columns(pl.col(pl.Float64).fill_nan(None))


def _draw(axes: Axes, one: pl.DataFrame, colour: str, style: str, label: str) -> None:
    time = one["time"].to_numpy()
    axes.plot(time, one["value"], style, color=colour, label=label, linewidth=1.8)
    if one["low"].null_count() == 0:
        axes.fill_between(time, one["low"], one["high"], color=colour, alpha=0.12, linewidth=0)


def _finish(axes: Axes) -> None:
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
