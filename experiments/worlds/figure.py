"""Worlds from above: the lanes, every path coloured by regime, what hides, and the sensor."""

import math
from collections.abc import Sequence
from xml.etree import ElementTree

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from experiments.population import SCORED_RANGE, SCORED_VISIBLE
from mdkf.tables import REGIMES, BoolArray, FloatArray, IntArray, Trace
from scenarios import Scenario, SumoScenario

REGIME_COLOURS = {
    "stationary": "#c62828",
    "constant_velocity": "#2e7d32",
    "constant_acceleration": "#1565c0",
    "changing_acceleration": "#ef6c00",
    "unknown": "#616161",
}
COLUMNS = 5
"""Worlds in a row of the catalogue."""
WIDE, HIGH = 75.0, 45.0
"""From the middle of a panel of the catalogue to its edges [m]."""
_WALL_COLOUR = "#bcaaa4"
_TALL = 2.0
"""Height from which a box hides a car [m]."""


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
    _paths(above, trace, near)
    for values, set_limits in ((ego.x, above.set_xlim), (ego.y, above.set_ylim)):
        set_limits(values.min() - SCORED_RANGE, values.max() + SCORED_RANGE)
    above.set_title(
        f"{scenario.name}, seed {trace.provenance['seed']}: {trace.n_frames * trace.dt:g} s,"
        f" within {SCORED_RANGE:g} m of the sensor"
    )
    above.legend(handles=_handles([trace]), fontsize=8, loc="upper left", ncols=3)
    _boxes(snapshot, trace, frame, hidden)
    for axes in (above, snapshot):
        _walls(axes, trace, frame)
    x, y = ego.x[frame], ego.y[frame]
    snapshot.plot([x], [y], "k^", markersize=9, zorder=5)
    snapshot.set(xlim=(x - SCORED_RANGE, x + SCORED_RANGE), ylim=(y - 35.0, y + 35.0))
    snapshot.set_title(
        f"at {frame * trace.dt:.1f} s {int(hidden[trace.frame_rows(frame)].sum())} objects are less"
        f" than {SCORED_VISIBLE:.0%} visible (red); dark: {_TALL:g} m or taller; triangle: sensor"
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
        _paths(axes, trace, trace.road_users() & (trace.sensor_distance() <= SCORED_RANGE))
        middle = trace.n_frames // 2
        _walls(axes, trace, middle)
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
    handles = _handles([trace for _, trace in worlds])
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


def _paths(axes: Axes, trace: Trace, near: BoolArray) -> None:
    """A segment for each two consecutive frames of an object in range, thin where it is hidden;
    a dot where it stands."""
    order = np.lexsort((trace.frame, trace.object_id))
    a, b = order[:-1], order[1:]
    joined = (trace.object_id[a] == trace.object_id[b]) & (trace.frame[b] - trace.frame[a] == 1)
    joined &= near[a] & near[b]
    a, b = a[joined], b[joined]
    ends = [np.column_stack([trace.x[rows], trace.y[rows]]) for rows in (a, b)]
    colours = np.array([REGIME_COLOURS[name] for name in REGIMES])
    widths = np.where(trace.visible[a] >= SCORED_VISIBLE, 1.8, 0.5)
    segments = list(np.stack(ends, axis=1))
    paths = LineCollection(
        segments, colors=list(colours[trace.regime[a]]), linewidths=widths, zorder=2
    )
    axes.add_collection(paths)
    stands = near & (trace.regime == REGIMES.index("stationary"))
    colour = REGIME_COLOURS["stationary"]
    axes.plot(trace.x[stands], trace.y[stands], ".", color=colour, markersize=4, zorder=2)


def _boxes(axes: Axes, trace: Trace, frame: int, hidden: BoolArray) -> None:
    rows = _rows_of_frame(trace, frame, trace.road_users())
    faces = np.where(trace.height[rows] >= _TALL, "#455a64", "#b0bec5")
    faces = np.where(hidden[rows], "#ef5350", faces)
    boxes = PolyCollection(
        _outlines(trace, rows),
        facecolors=list(faces),
        edgecolors="#263238",
        linewidths=0.5,
        zorder=3,
    )
    axes.add_collection(boxes)


def _walls(axes: Axes, trace: Trace, frame: int) -> None:
    """Walls as plain areas: they hide, and are nothing that is seen or missed."""
    rows = _rows_of_frame(trace, frame, ~trace.road_users())
    areas = PolyCollection(_outlines(trace, rows), facecolors=_WALL_COLOUR, zorder=1)
    axes.add_collection(areas)


def _rows_of_frame(trace: Trace, frame: int, wanted: BoolArray) -> IntArray:
    there = trace.frame_rows(frame)
    rows: IntArray = there.start + np.flatnonzero(wanted[there])
    return rows


def _outlines(trace: Trace, rows: IntArray) -> list[FloatArray]:
    """Corners (4, 2) of the rows' boxes [m]."""
    size = np.column_stack([trace.length[rows], trace.width[rows]]) / 2
    corners = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * size[:, None, :]
    cosine, sine = np.cos(trace.yaw[rows])[:, None], np.sin(trace.yaw[rows])[:, None]
    x = corners[..., 0] * cosine - corners[..., 1] * sine + trace.x[rows][:, None]
    y = corners[..., 0] * sine + corners[..., 1] * cosine + trace.y[rows][:, None]
    return list(np.stack([x, y], axis=-1))


def _handles(traces: Sequence[Trace]) -> list[Artist]:
    """What colours and lines mean, of what there is."""
    codes = set().union(*(np.unique(trace.regime).tolist() for trace in traces))
    present = [name for code, name in enumerate(REGIMES) if code in codes]
    handles: list[Artist] = [
        Line2D([], [], color=REGIME_COLOURS[name], linewidth=2, label=name.replace("_", " "))
        for name in present
    ]
    handles.append(Line2D([], [], color="#616161", linewidth=0.5, label="thin: hidden"))
    handles.append(Line2D([], [], color="black", linestyle="--", label="the sensor's path"))
    if not all(trace.road_users().all() for trace in traces):
        handles.append(Patch(color=_WALL_COLOUR, label="wall"))
    return handles
