"""What a bird's-eye picture is made of: paths coloured by regime, boxes, walls, their legend."""

from collections.abc import Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from experiments.figures import outlines
from experiments.population import SCORED_VISIBLE
from mdkf.tables import REGIMES, BoolArray, FloatArray, IntArray, Trace, Tracks

REGIME_COLOURS = {
    "stationary": "#c62828",
    "constant_velocity": "#2e7d32",
    "constant_acceleration": "#1565c0",
    "changing_acceleration": "#ef6c00",
    "unknown": "#616161",
}
WALL_COLOUR = "#bcaaa4"
TALL = 2.0
"""Height from which a box hides a car [m]."""


def draw_paths(axes: Axes, trace: Trace, near: BoolArray) -> None:
    """A segment for each two consecutive frames of an object in range, thin where it is hidden;
    a dot where it stands."""
    a, b = consecutive(trace, near)
    colours = np.array([REGIME_COLOURS[name] for name in REGIMES])
    widths = np.where(trace.visible[a] >= SCORED_VISIBLE, 1.8, 0.5)
    paths = LineCollection(
        segments(trace, a, b), colors=list(colours[trace.regime[a]]), linewidths=widths, zorder=2
    )
    axes.add_collection(paths)
    stands = near & (trace.regime == REGIMES.index("stationary"))
    colour = REGIME_COLOURS["stationary"]
    axes.plot(trace.x[stands], trace.y[stands], ".", color=colour, markersize=4, zorder=2)


def consecutive(table: Trace | Tracks, wanted: BoolArray) -> tuple[IntArray, IntArray]:
    """Pairs of rows, (n,) each, of the same object or track in two consecutive frames, both
    wanted; object by object."""
    own = getattr(table, str(table.ID))
    order = np.lexsort((table.frame, own))
    a, b = order[:-1], order[1:]
    joined = (own[a] == own[b]) & (table.frame[b] - table.frame[a] == 1) & wanted[a] & wanted[b]
    return a[joined], b[joined]


def segments(table: Trace | Tracks, a: IntArray, b: IntArray) -> list[FloatArray]:
    """Lines from rows a to rows b, (2, 2) each [m]."""
    ends = [np.column_stack([table.x[rows], table.y[rows]]) for rows in (a, b)]
    return list(np.stack(ends, axis=1))


def draw_boxes(axes: Axes, trace: Trace, frame: int, hidden: BoolArray) -> None:
    """The road users of a frame: red where hidden, (n_rows,), else dark where they are tall."""
    rows = _rows_of_frame(trace, frame, trace.road_users())
    faces = np.where(trace.height[rows] >= TALL, "#455a64", "#b0bec5")
    faces = np.where(hidden[rows], "#ef5350", faces)
    boxes = PolyCollection(
        list(outlines(trace, rows)),
        facecolors=list(faces),
        edgecolors="#263238",
        linewidths=0.5,
        zorder=3,
    )
    axes.add_collection(boxes)


def draw_walls(axes: Axes, trace: Trace, frame: int) -> None:
    """Walls as plain areas: they hide, and are nothing that is seen or missed."""
    rows = _rows_of_frame(trace, frame, ~trace.road_users())
    areas = PolyCollection(list(outlines(trace, rows)), facecolors=WALL_COLOUR, zorder=1)
    axes.add_collection(areas)


def _rows_of_frame(trace: Trace, frame: int, wanted: BoolArray) -> IntArray:
    there = trace.frame_rows(frame)
    rows: IntArray = there.start + np.flatnonzero(wanted[there])
    return rows


def regime_handles(traces: Sequence[Trace]) -> list[Artist]:
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
        handles.append(Patch(color=WALL_COLOUR, label="wall"))
    return handles
