"""Accuracy against CPU time, and CPU time against the number of objects, a panel for each tier."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from experiments.estimates import Estimate
from experiments.figures import colours, line_style
from experiments.statistics import told

TIME = "CPU time of a frame [µs]"
PLAIN = StrMethodFormatter("{x:g}")
COLUMNS = 3


@dataclass(frozen=True)
class Point:
    """A filter's CPU time in a tier [us]; its gain in HOTA [%], or the number of objects."""

    tier: str
    filter: str
    time: Estimate
    gain: Estimate | None = None
    objects: int | None = None


def tradeoff_data(points: Sequence[Point]) -> pl.DataFrame:
    """tier, filter, time [us], and gain in HOTA over CA [%], both with intervals."""
    return pl.DataFrame(
        [{**_time(point), **_interval("gain", point.gain)} for point in points if point.gain],
        infer_schema_length=None,
    )


def objects_data(points: Sequence[Point]) -> pl.DataFrame:
    """tier, filter, number of objects, and time [us] with its interval."""
    return pl.DataFrame(
        [{**_time(point), "objects": point.objects} for point in points], infer_schema_length=None
    )


def tradeoff(data: pl.DataFrame) -> Figure:
    """Up is more accurate, left is faster."""
    tiers = data["tier"].unique(maintain_order=True).to_list()
    whole = Figure(figsize=(3.1 * len(tiers), 3.7), layout="constrained")
    panels = whole.subplots(1, len(tiers), sharey=True, squeeze=False)[0]
    for axes, tier in zip(panels, tiers, strict=True):
        own = data.filter(tier=tier)
        for name, colour in _colours(data).items():
            for row in own.filter(filter=name).to_dicts():
                axes.errorbar(
                    row["time"],
                    row["gain"],
                    yerr=_bars(row, "gain"),
                    xerr=_bars(row, "time"),
                    marker="o",
                    markersize=6,
                    capsize=3,
                    linestyle="none",
                    color=colour,
                    label=name,
                )
        axes.axhline(0, color="#888888", linewidth=0.8, zorder=0)
        axes.set_xscale("log")
        axes.set_xlim(_around(own["time"].to_list()))
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.xaxis.set_minor_formatter(NullFormatter())
        _finish(axes, tier, TIME)
    panels[0].set_ylabel("HOTA minus that of ca [%]")
    whole.legend(*_labelled(panels), frameon=False, ncols=4, loc="outside lower center")
    return whole


def by_objects(data: pl.DataFrame) -> Figure:
    """Both axes logarithmic, the same in all panels."""
    tiers = data["tier"].unique(maintain_order=True).to_list()
    rows = len(tiers) // COLUMNS + 1  # one place is the legend's
    whole = Figure(figsize=(3.6 * COLUMNS, 3.1 * rows), layout="constrained")
    panels = whole.subplots(rows, COLUMNS, sharex=True, sharey=True, squeeze=False).ravel()
    for axes, tier in zip(panels, tiers, strict=False):
        for name, colour in _colours(data).items():
            own = data.filter(tier=tier, filter=name).sort("objects")
            if not own.is_empty():
                axes.plot(
                    own["objects"],
                    own["time"],
                    line_style(name),
                    marker="o",
                    markersize=4,
                    color=colour,
                    label=name,
                )
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(PLAIN)
        _finish(axes, tier, "objects in a frame")
        axes.tick_params(labelbottom=True)
    for axes in panels[: len(tiers) : COLUMNS]:
        axes.set_ylabel(TIME)
    for axes in panels[len(tiers) :]:
        axes.set_axis_off()
    panels[len(tiers)].legend(*_labelled(panels), frameon=False, fontsize=11, loc="center")
    return whole


def _time(point: Point) -> dict[str, Any]:
    return {"tier": point.tier, "filter": point.filter, **_interval("time", point.time)}


def _interval(name: str, found: Estimate) -> dict[str, float | None]:
    values = {name: found.value, f"{name}_low": found.low, f"{name}_high": found.high}
    return {column: told(value) for column, value in values.items()}


def _bars(row: Mapping[str, Any], name: str) -> list[list[float]] | None:
    """How far an interval reaches below and above its value; None where there is none."""
    value, low, high = (row[column] for column in (name, f"{name}_low", f"{name}_high"))
    return None if low is None else [[value - low], [high - value]]


def _around(values: Sequence[float]) -> tuple[float, float]:
    """Limits of an axis of which the values take the middle."""
    return min(values) / 1.8, max(values) * 1.8


def _colours(data: pl.DataFrame) -> dict[str, str]:
    """By filter; a dashed variant comes after, and is drawn over, the filter it is one of."""
    return colours(sorted(data["filter"].unique()))


def _labelled(panels: Iterable[Axes]) -> tuple[list[Any], list[str]]:
    """What a legend shows: each filter once, though no panel has all."""
    known: dict[str, Any] = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            known.setdefault(label, handle)
    names = sorted(known)
    return [known[name] for name in names], names


def _finish(axes: Axes, title: str, label: str) -> None:
    axes.set_title(title, fontsize=9.5)
    axes.set_xlabel(label)
    axes.xaxis.set_major_formatter(PLAIN)
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
