"""Rows of single scenes into pictures: errors by frame, hidden paths, and boxes from above."""

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from experiments.estimates import chosen, estimate
from experiments.figures import colours, line_style
from experiments.statistics import told
from experiments.studies import scenes
from experiments.studies.natural import HORIZON
from experiments.studies.scenes import BOX, DETECTED, DRAWN_SEED, TRUTH
from experiments.studies.worlds import FILTERS, ORDER_2, ORDER_3
from mdkf.tables import FloatArray

HOW = {"drift": "filter alone", "error": "in the tracker"}
HALF = 5.0
"""From the middle of a box's panel to its edge [m]: a car and as much around it."""
STRETCH = 30
"""A path's longer axis is at most so many times as long as its shorter one: a straight path's
sideways errors are neither hidden nor blown up without limit."""
PANELS = 3
"""Boxes of each population that are drawn at most."""

EVERY_SCENE = "all scenes"
"""In place of a scenario."""
Panel = tuple[str, str]
"""Scenario and score."""
CURVES = {
    **dict.fromkeys(("scenario", "metric", "filter"), pl.String),
    "frame": pl.Int64,
    **dict.fromkeys(("mean", "low", "high", "sd"), pl.Float64),
    "n": pl.Int64,
}
Orders = Sequence[tuple[str, Sequence[str]]]
"""Name of each order and its filters."""


def curves(rows: pl.DataFrame, panels: Sequence[Panel], population: str) -> pl.DataFrame:
    """scenario, metric, filter, frame, and over seeds mean, low, high, sd and n of a population's
    errors [m] by frame of the gap, counted from 1; where there is a value."""
    bins = {f"{population}, frame {frame}": frame for frame in range(1, HORIZON + 1)}
    own = rows.filter(pl.col("study") == scenes.STUDY, pl.col("bin").is_in(list(bins)))
    found = []
    for scenario, metric in panels:
        part = own if scenario == EVERY_SCENE else own.filter(scenario=scenario)
        for name, (place, frame) in product(FILTERS, bins.items()):
            where = {"metric": metric, "filter": name, "bin": place}
            over = estimate(part, where)
            if over.n:
                spread = chosen(part, where)["value"].std()
                at = (scenario, metric, name, frame)
                found.append((*at, over.value, told(over.low), told(over.high), spread, over.n))
    return pl.DataFrame(found, CURVES, orient="row")


def drawn(rows: pl.DataFrame, scenario: str, kind: str) -> pl.DataFrame:
    """What of a scenario's first seed is drawn, `path` or the boxes of a population: scenario,
    filter, bin and a column for each metric, null where a row has none."""
    own = rows.filter(
        pl.col("study") == scenes.STUDY,
        pl.col("bin").str.contains(f"^{kind}( \\d+|, frame -?\\d+|)$"),
        pl.col("metric").is_in([*BOX, "frames"]),
        scenario=scenario,
        seed=DRAWN_SEED,
    )
    metrics = ("x", "y", "frames") if kind == "path" else BOX
    values = [
        pl.col("value").filter(pl.col("metric") == metric).first().alias(metric)
        for metric in metrics
    ]
    return own.group_by("scenario", "filter", "bin", maintain_order=True).agg(values)


def curves_figure(
    data: pl.DataFrame, panels: Sequence[Panel], published: tuple[int, float] | None = None
) -> Figure:
    """A column for each panel, a row for each order; published: MD's frame and error [m]."""
    figure = Figure(figsize=(3.1 * len(panels) + 1.3, 6.4), layout="constrained")
    grid = figure.subplots(2, len(panels), sharex=True, sharey="col", squeeze=False)
    for names, line in zip((ORDER_2, ORDER_3), grid, strict=True):
        for (scenario, metric), axes in zip(panels, line, strict=True):
            for name, colour in colours(names).items():
                own = data.filter(scenario=scenario, metric=metric, filter=name)
                axes.plot(own["frame"], own["mean"], line_style(name), color=colour, label=name)
                band = (own["frame"], own["low"], own["high"])
                axes.fill_between(*band, color=colour, alpha=0.15, linewidth=0)
            if published is not None and "md" in names:
                axes.plot(*published, "k*", markersize=8, label="md, paper", zorder=5)
            axes.grid(alpha=0.25)
            axes.spines[["top", "right"]].set_visible(False)
        line[0].set_ylabel("error [m]")
        line[-1].legend(frameon=False, fontsize=9, loc="center left", bbox_to_anchor=(1.0, 0.5))
    grid[0, 0].set(xlim=(1, HORIZON), xticks=(1, 4, 10, 15, 20))
    for (scenario, metric), axes, below in zip(panels, grid[0], grid[-1], strict=True):
        axes.set_ylim(0, None)
        axes.set_title(f"{scenario}, {HOW[metric]}", fontsize=10)
        below.set_xlabel("frame since last detected")
    return figure


def gap_figure(path: pl.DataFrame, filters: Sequence[str]) -> Figure:
    """The paths around a gap, and the errors of the tracks by frame."""
    figure = Figure(figsize=(11, 4.8), layout="constrained")
    if path.is_empty():
        return figure
    above, over_time = figure.subplots(1, 2, width_ratios=(1.3, 1))
    _draw_path(above, path, filters)
    _widen(above)
    above.legend(
        frameon=False, fontsize=9, ncols=4, loc="upper center", bbox_to_anchor=(0.5, -0.14)
    )
    true, length = _positions(path, TRUTH), _length(path)
    for name, colour in colours(filters).items():
        own = _positions(path, name)
        both = sorted(set(own) & set(true))
        errors = [np.hypot(*(own[frame] - true[frame])) for frame in both]
        over_time.plot(both, errors, line_style(name), color=colour, label=name, marker=".")
    over_time.axvspan(0.5, length + 0.5, color="#888888", alpha=0.15, linewidth=0)
    over_time.set(xlabel="frame since last detected", ylabel="error of the track [m]")
    over_time.set_ylim(0, None)
    over_time.set_title("grey: no detections", fontsize=10)
    over_time.grid(alpha=0.25)
    over_time.spines[["top", "right"]].set_visible(False)
    return figure


def paths_figure(path: pl.DataFrame, orders: Orders) -> Figure:
    """The paths around a gap, a panel for each order, with a dotted line from the state that is
    nearest to the truth of each frame of the gap to the truth."""
    figure = Figure(figsize=(10, 8.4), layout="constrained")
    if path.is_empty():
        return figure
    panels = figure.subplots(2, 1, sharex=True, sharey=True)
    for (order, names), axes in zip(orders, panels, strict=True):
        _draw_path(axes, path, names)
        true, colour_of = _positions(path, TRUTH), colours(names)
        states = {name: _positions(path, name) for name in names}
        for frame in range(1, _length(path) + 1):
            there = [name for name in names if frame in states[name]]
            if not there:
                continue
            errors = [np.hypot(*(states[name][frame] - true[frame])) for name in there]
            nearest = there[int(np.argmin(errors))]
            ends = np.array([states[nearest][frame], true[frame]])
            axes.plot(*ends.T, ":", color=colour_of[nearest], linewidth=1.4)
        axes.set_title(order, fontsize=10)
        axes.legend(frameon=False, fontsize=9, loc="center left", bbox_to_anchor=(1.0, 0.5))
        axes.label_outer()
    _widen(panels[0])
    return figure


def boxes_figure(boxes: pl.DataFrame, orders: Orders) -> Figure:
    """A column for each car, a row for each order: boxes around the true one's centre."""
    shown: list[tuple[str, str]] = []
    for (scenario,), part in boxes.group_by("scenario", maintain_order=True):
        cars = part["bin"].unique(maintain_order=True).to_list()[:PANELS]
        shown += [(str(scenario), str(car)) for car in cars]
    columns = max(len(shown), 1)
    figure = Figure(figsize=(2.7 * columns + 1.3, 6.2), layout="constrained")
    grid = figure.subplots(2, columns, sharex=True, sharey=True, squeeze=False)
    for (order, names), line in zip(orders, grid, strict=True):
        for (world, car), axes in zip(shown, line, strict=False):
            own = boxes.filter(scenario=world, bin=car)
            true = own.filter(filter=TRUTH).row(0, named=True)
            for name, colour in {**colours(names), TRUTH: "black"}.items():
                style = "--" if name == TRUTH else line_style(name)
                for box in own.filter(filter=name).iter_rows(named=True):
                    offset = (box["x"] - true["x"], box["y"] - true["y"])
                    axes.add_patch(_rectangle(offset, box, edgecolor=colour, linestyle=style))
            axes.set_aspect("equal")
            axes.grid(alpha=0.25)
        line[0].set_ylabel(f"{order}: y − true y [m]")
        styles = {name: (colour, line_style(name)) for name, colour in colours(names).items()}
        for name, (colour, style) in {**styles, TRUTH: ("black", "--")}.items():
            line[-1].plot([], [], style, color=colour, label=name)
        line[-1].legend(frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    grid[0, 0].set(xlim=(-HALF, HALF), ylim=(-HALF, HALF))
    for (world, car), axes, below in zip(shown, grid[0], grid[-1], strict=False):
        axes.set_title(f"{world}: {car}", fontsize=10)
        below.set_xlabel("x − true x [m]")
    return figure


def _draw_path(axes: Axes, path: pl.DataFrame, filters: Sequence[str]) -> None:
    """The truth, the detections, and in the gap the tracks."""
    true, length = _positions(path, TRUTH), _length(path)
    axes.plot(*np.array(list(true.values())).T, color="black", label="truth", linewidth=1.2)
    hidden = np.array([true[frame] for frame in range(1, length + 1)])
    axes.plot(*hidden.T, "|", color="black", markersize=7, label="truth, hidden")
    seen = np.array(list(_positions(path, DETECTED).values()))
    axes.plot(*seen.T, "o", color="#777777", markersize=4, label="detections")
    for name, colour in colours(filters).items():
        own = [at for frame, at in _positions(path, name).items() if 0 <= frame <= length]
        if own:
            ends = np.array(own).T
            axes.plot(*ends, line_style(name), color=colour, marker=".", label=name)
    axes.set(xlabel="x [m]", ylabel="y [m]")
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)


def _widen(axes: Axes) -> None:
    """Limit how differently the axes are scaled."""
    x, y = axes.get_xlim(), axes.get_ylim()
    for (low, high), (first, last), set_limits in ((x, y, axes.set_xlim), (y, x, axes.set_ylim)):
        missing = (last - first) / STRETCH - (high - low)
        if missing > 0:
            set_limits(low - missing / 2, high + missing / 2)


def _positions(path: pl.DataFrame, name: str) -> dict[int, FloatArray]:
    """Position (2,) [m] by frame of the gap, counted from 1."""
    own = path.filter(pl.col("filter") == name, pl.col("bin") != "path")
    return {
        int(place.removeprefix("path, frame ")): np.array([x, y])
        for place, x, y in own.select("bin", "x", "y").iter_rows()
    }


def _length(path: pl.DataFrame) -> int:
    """Frames of the gap."""
    return int(path.filter(bin="path")["frames"].item())


def _rectangle(centre: tuple[float, float], box: Mapping[str, float], **style: str) -> Rectangle:
    """A box from above, around a centre [m]."""
    length, width = box["length"], box["width"]
    corner = (centre[0] - length / 2, centre[1] - width / 2)
    angle = np.degrees(box["yaw"])
    turned: Any = {"angle": angle, "rotation_point": "center", "linewidth": 1.6, **style}
    return Rectangle(corner, length, width, fill=False, **turned)
