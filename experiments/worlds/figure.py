"""Worlds from above: the lanes, every path coloured by regime, what hides, and the sensor."""

import math
from collections.abc import Sequence
from xml.etree import ElementTree

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from experiments.plots.scenery import TALL, draw_boxes, draw_paths, draw_walls, regime_handles
from experiments.population import SCORED_RANGE, SCORED_VISIBLE
from mdkf.tables import FloatArray, Trace
from scenarios import Scenario, SumoScenario

COLUMNS = 5
"""Worlds in a row of the catalogue."""
WIDE, HIGH = 75.0, 45.0
"""From the middle of a panel of the catalogue to its edges [m]."""


def world_figure(scenario: Scenario, trace: Trace) -> Figure:
    """All paths within range of the sensor, and the frame in which most road users are hidden."""
    near = trace.road_users() & (trace.sensor_distance() <= SCORED_RANGE)
    hidden = near & (trace.visible < SCORED_VISIBLE)
    frame = int(np.argmax(np.bincount(trace.frame[hidden], minlength=trace.n_frames)))
    ego = trace.ego
    figure = Figure(figsize=(10, 10), layout="constrained")
    above, snapshot = figure.subplots(2, 1, height_ratios=(1, 1.1))
    for axes in (above, snapshot):
        _ground(axes, scenario, trace)
        axes.set(xlabel="x [m]", ylabel="y [m]")
    draw_paths(above, trace, near)
    for values, set_limits in ((ego.x, above.set_xlim), (ego.y, above.set_ylim)):
        set_limits(values.min() - SCORED_RANGE, values.max() + SCORED_RANGE)
    above.set_title(
        f"{scenario.name}, seed {trace.provenance['seed']}: {trace.n_frames * trace.dt:g} s,"
        f" within {SCORED_RANGE:g} m of the sensor"
    )
    above.legend(handles=regime_handles([trace]), fontsize=8, loc="upper left", ncols=3)
    draw_boxes(snapshot, trace, frame, hidden)
    for axes in (above, snapshot):
        draw_walls(axes, trace, frame)
    x, y = ego.x[frame], ego.y[frame]
    snapshot.plot([x], [y], "k^", markersize=9, zorder=5)
    snapshot.set(xlim=(x - SCORED_RANGE, x + SCORED_RANGE), ylim=(y - 35.0, y + 35.0))
    snapshot.set_title(
        f"at {frame * trace.dt:.1f} s {int(hidden[trace.frame_rows(frame)].sum())} objects are less"
        f" than {SCORED_VISIBLE:.0%} visible (red); dark: {TALL:g} m or taller; triangle: sensor"
    )
    return figure


def catalogue_figure(worlds: Sequence[tuple[Scenario, Trace]]) -> Figure:
    """A panel for each world, all of one scale: the paths within range of the sensor, around the
    place where it is when half the time is over."""
    rows = math.ceil(len(worlds) / COLUMNS)
    figure = Figure(figsize=(3.6 * COLUMNS, 2.7 * rows + 0.7), layout="constrained")
    panels = figure.subplots(rows, COLUMNS, squeeze=False).ravel()
    for axes, (scenario, trace) in zip(panels, worlds, strict=False):
        _ground(axes, scenario, trace)
        draw_paths(axes, trace, trace.road_users() & (trace.sensor_distance() <= SCORED_RANGE))
        middle = trace.n_frames // 2
        draw_walls(axes, trace, middle)
        x, y = trace.ego.x[middle], trace.ego.y[middle]
        axes.plot([x], [y], "k^", markersize=7, zorder=5)
        axes.set(xlim=(x - WIDE, x + WIDE), ylim=(y - HIGH, y + HIGH))
        axes.set_title(f"{scenario.name} ({scenario.source})", fontsize=10)
        axes.tick_params(labelsize=7)
    for axes in panels[len(worlds) - COLUMNS : len(worlds)]:
        axes.set_xlabel("x [m]", fontsize=8)
    for axes in panels[: len(worlds) : COLUMNS]:
        axes.set_ylabel("y [m]", fontsize=8)
    for axes in panels[len(worlds) :]:
        axes.set_axis_off()
    handles = regime_handles([trace for _, trace in worlds])
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), fontsize=10)
    return figure


def _ground(axes: Axes, scenario: Scenario, trace: Trace) -> None:
    """The lanes, where they are known, and the sensor's path."""
    lanes = _lanes(scenario) if isinstance(scenario, SumoScenario) else []
    axes.add_collection(LineCollection(lanes, colors="#e4e4e4", linewidths=3, zorder=0))
    ego = trace.ego
    axes.plot(ego.x, ego.y, color="black", linewidth=1.2, linestyle="--", zorder=3)
    axes.set_aspect("equal")


def _lanes(scenario: SumoScenario) -> list[FloatArray]:
    """Middle lines of the network's lanes, (points, 2) each [m]."""
    root = ElementTree.parse(scenario.network).getroot()
    shapes = (lane.get("shape", "") for lane in root.iter("lane"))
    return [
        np.array([point.split(",")[:2] for point in shape.split()], dtype=np.float64)
        for shape in shapes
        if shape
    ]
