"""Tables from above: everything that happened, or one frame of it."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection, PolyCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from experiments.figures import colours, confidence_ellipse, line_style, outlines
from experiments.matched import check_origin
from experiments.plots.picture import Picture, by_name, check_times, origin, picture, plain
from experiments.plots.scenery import (
    consecutive,
    draw_boxes,
    draw_paths,
    draw_walls,
    regime_handles,
    segments,
)
from experiments.population import SCORED_RANGE, SCORED_VISIBLE
from mdkf.tables import CLUTTER, Detections, EgoPath, FloatArray, IntArray, Trace, Tracks

FEW = 20
"""Up to so many tracks are labelled with their ids."""
TRAIL = 2.0
"""Of how long a track's way is shown behind it [s]."""
MARGIN = 8.0
"""Around what has no sensor [m]."""
FARTHEST = 1e9
"""Largest coordinate of a picture [m]: beyond it metres are lost in its numbers."""
WIDTH, LEAST_HEIGHT, MOST_HEIGHT = 10.0, 3.8, 9.0
"""Size of a picture [inches]."""
_CLUTTER_COLOUR = "#c2185b"

View = tuple[float, float, float, float]
"""Least and largest x, least and largest y [m]."""


def birds_eye(
    trace: Trace | None = None,
    detections: Detections | None = None,
    tracks: Tracks | Mapping[str, Tracks] | None = None,
    *,
    frame: int | None = None,
    view: View | None = None,
) -> Picture:
    """A scene from above, of whatever tables there are.

    frame: that frame alone: the true boxes (red: less than 15 % visible), detections, each track's
    box with the 95 % ellipse of its position, and its way of the last 2 s. None: all frames: the
    objects' paths by regime, or plain beside tracks; all detections; all tracks, thin where they
    coast.
    tracks: one table, or several by name. view: (least x, largest x, least y, largest y) [m]; None:
    60 m around the sensor, or all that there is without a trace.

    Raises `TableError` for tables that do not belong together, `IndexError` for a frame that is not
    there, and `ValueError` without any table and for a view that shows nothing.
    """
    filters = {} if tracks is None else by_name(tracks)
    tables = [table for table in (trace, detections, *filters.values()) if table is not None]
    if not tables:
        raise ValueError("birds_eye: no table, expected a trace, detections or tracks")
    check_times(*tables)
    for table in (detections, *filters.values()):
        if trace is not None and table is not None:
            check_origin(trace, table)
    if frame is not None:
        tables[0].frame_rows(frame)
    left, right, low, high = _checked(view or _view(trace, detections, filters, frame))
    height = WIDTH * (high - low) / (right - left) + 1.1
    figure = picture(WIDTH, float(np.clip(height, LEAST_HEIGHT, MOST_HEIGHT)))
    axes = figure.subplots()
    axes.set(xlim=(left, right), ylim=(low, high), xlabel="x [m]", ylabel="y [m]")
    axes.set_aspect("equal", adjustable="box")
    axes.grid(alpha=0.25)
    draw = _Drawing(axes, (left, right, low, high), frame)
    if trace is not None:
        draw.trace(trace, plain_paths=bool(filters))
    if detections is not None:
        draw.detections(detections)
    for name, colour in colours(list(filters)).items():
        draw.tracks(filters[name], plain(name), colour, line_style(name))
    seconds = tables[0].dt * (tables[0].n_frames if frame is None else frame)
    when = f"{seconds:g} s" if frame is None else f"at {seconds:.1f} s (frame {frame})"
    axes.set_title(f"{origin(tables[0])}: {when}", fontsize=11)
    if not any(map(len, tables)):
        axes.text(0.5, 0.5, "no rows", transform=axes.transAxes, ha="center", va="center")
    if draw.handles:
        columns = min(len(draw.handles), 6)
        figure.legend(
            handles=draw.handles,
            loc="outside lower center",
            ncols=columns,
            frameon=False,
            fontsize=9,
        )
    return figure


def path(ego: EgoPath) -> Picture:
    """The sensor's way from above, and where it begins."""
    left, right, low, high = _checked(_around(ego.x, ego.y, MARGIN, MARGIN))
    figure = picture(WIDTH, 5.0)
    axes = figure.subplots()
    axes.set(xlim=(left, right), ylim=(low, high), xlabel="x [m]", ylabel="y [m]")
    axes.set_aspect("equal", adjustable="box")
    axes.grid(alpha=0.25)
    axes.plot(ego.x, ego.y, "--", color="black", linewidth=1.2)
    axes.plot(ego.x[:1], ego.y[:1], "k^", markersize=9)
    axes.set_title(f"{origin(ego)}: the sensor, {ego.n_frames * ego.dt:g} s", fontsize=11)
    return figure


class _Drawing:
    """A picture in the making: what is drawn tells the legend what it is."""

    def __init__(self, axes: Axes, view: View, frame: int | None) -> None:
        self.axes, self.view, self.frame = axes, view, frame
        self.handles: list[Artist] = []

    def trace(self, trace: Trace, plain_paths: bool) -> None:
        """Walls, the sensor, and the objects' boxes or paths."""
        ego, k = trace.ego, self.frame
        near = trace.road_users() & self._inside(trace)
        if k is None:
            middle = slice(trace.n_frames // 2, trace.n_frames // 2 + 1)
            if trace.n_frames:
                draw_walls(self.axes, trace, middle.start)
            self.axes.plot(ego.x, ego.y, "--", color="black", linewidth=1.2, zorder=3)
            self.axes.plot(ego.x[middle], ego.y[middle], "k^", markersize=7, zorder=5)
            if plain_paths:
                a, b = consecutive(trace, near)
                lines = LineCollection(segments(trace, a, b), colors="black", linewidths=0.8)
                self.axes.add_collection(lines)
                self.handles += [
                    _line("truth", color="black", linewidth=0.8),
                    _line("the sensor's path", color="black", linestyle="--"),
                ]
            else:
                draw_paths(self.axes, trace, near)
                self.handles += regime_handles([trace.take(near | ~trace.road_users())])
            return
        hidden = trace.visible < SCORED_VISIBLE
        draw_walls(self.axes, trace, k)
        draw_boxes(self.axes, trace, k, hidden)
        self.axes.plot(ego.x[k], ego.y[k], "k^", markersize=9, zorder=5)
        self.handles += [
            Patch(facecolor="#b0bec5", edgecolor="#263238", label="truth (dark: 2 m or taller)"),
            Patch(facecolor="#ef5350", edgecolor="#263238", label="truth, hidden"),
            _line("sensor", color="black", marker="^", markersize=9, linestyle=""),
        ]

    def detections(self, detections: Detections) -> None:
        """Dots, crosses for what no object caused."""
        rows = self._rows(detections)
        false = detections.source[rows] == CLUTTER
        size, alpha = (1.8, 0.25) if self.frame is None else (4.0, 1.0)
        x, y = detections.x[rows], detections.y[rows]
        for own, mark, colour, label in (
            (~false, "o", "#212121", "detections"),
            (false, "x", _CLUTTER_COLOUR, "false detections"),
        ):
            style: dict[str, Any] = {"marker": mark, "color": colour, "linestyle": ""}
            markersize = size if mark == "o" else 1.6 * size
            self.axes.plot(x[own], y[own], alpha=alpha, markersize=markersize, zorder=4, **style)
            self.handles.append(_line(label, markersize=5, **style))

    def tracks(self, tracks: Tracks, name: str, colour: str, style: Any) -> None:
        """Ways, thin where the tracks coast; in a frame boxes and ellipses."""
        inside = self._inside(tracks)
        if self.frame is not None:
            first = self.frame - round(TRAIL / tracks.dt)
            inside &= (tracks.frame > first) & (tracks.frame <= self.frame)
        a, b = consecutive(tracks, inside)
        widths = np.where(tracks.coasted[b], 0.7, 1.8)
        ways = segments(tracks, a, b)
        self.axes.add_collection(
            LineCollection(ways, colors=colour, linewidths=widths, linestyles=style, zorder=5)
        )
        rows = self._rows(tracks)
        if self.frame is not None:
            self._boxes(tracks, rows, colour, style)
        ids, last = np.unique(tracks.track_id[rows][::-1], return_index=True)
        if len(ids) <= FEW:
            for identifier, row in zip(ids, rows[::-1][last], strict=True):
                self.axes.annotate(
                    str(identifier),
                    (tracks.x[row], tracks.y[row]),
                    textcoords="offset points",
                    xytext=(5, 5),
                    fontsize=8,
                    color=colour,
                    zorder=7,
                )
        self.handles.append(_line(f"{name} (thin: coasting)", color=colour, linestyle=style))

    def _boxes(self, tracks: Tracks, rows: IntArray, colour: str, style: Any) -> None:
        boxes = list(outlines(tracks, rows))
        common: dict[str, Any] = {"facecolors": "none", "edgecolors": colour, "zorder": 6}
        widths = np.where(tracks.coasted[rows], 0.8, 1.8)
        self.axes.add_collection(
            PolyCollection(boxes, linewidths=widths, linestyles=style, **common)
        )
        covariance = (getattr(tracks, name)[rows] for name in ("cov_xx", "cov_xy", "cov_yy"))
        major, minor, angle = confidence_ellipse(*covariance)
        centres = np.column_stack([tracks.x[rows], tracks.y[rows]])
        ellipses = EllipseCollection(
            *(2 * major, 2 * minor, np.degrees(angle)),
            units="xy",
            offsets=centres,
            offset_transform=self.axes.transData,
            linewidths=0.8,
            **common,
        )
        self.axes.add_collection(ellipses)

    def _inside(self, table: Trace | Detections | Tracks) -> Any:
        left, right, low, high = self.view
        return (table.x >= left) & (table.x <= right) & (table.y >= low) & (table.y <= high)

    def _rows(self, table: Detections | Tracks) -> IntArray:
        """The rows in view, of the frame or of all."""
        inside = self._inside(table)
        if self.frame is not None:
            inside &= table.frame == self.frame
        return np.flatnonzero(inside)


def _line(label: str, **style: Any) -> Line2D:
    """A line of the legend."""
    return Line2D([], [], label=label, **style)


def _view(
    trace: Trace | None,
    detections: Detections | None,
    filters: Mapping[str, Tracks],
    frame: int | None,
) -> View:
    """60 m around the sensor, less far to its sides; without a sensor all there is."""
    if trace is not None and trace.n_frames:
        at = slice(None) if frame is None else slice(frame, frame + 1)
        x, y = trace.ego.x[at], trace.ego.y[at]
        return _around(x, y, SCORED_RANGE, SCORED_RANGE if frame is None else 35.0)
    tables = [table for table in (detections, *filters.values()) if table is not None]
    rows = [slice(None) if frame is None else table.frame_rows(frame) for table in tables]
    x, y = (
        np.concatenate([[], *(getattr(t, c)[r] for t, r in zip(tables, rows, strict=True))])
        for c in ("x", "y")
    )
    return _around(x, y, MARGIN, MARGIN)


def _checked(view: View) -> View:
    """The view, if there is something between its ends that a picture can show."""
    left, right, low, high = view
    if not (np.abs(view).max() <= FARTHEST and left < right and low < high):
        raise ValueError(
            f"the view goes from x = {left:g} to {right:g} m and from y = {low:g} to {high:g} m,"
            f" expected ascending numbers up to {FARTHEST:g}"
        )
    return view


def _around(x: FloatArray, y: FloatArray, along: float, across: float) -> View:
    """The points' bounds and so many metres around them, no thin strip."""
    if not len(x):
        return (-along, along, -across, across)
    with np.errstate(over="ignore", invalid="ignore"):  # `_checked` tells of what comes of it
        left, right, low, high = (
            x.min() - along,
            x.max() + along,
            y.min() - across,
            y.max() + across,
        )
        wide = max(right - left, 0.8 * (high - low))
        tall = max(high - low, 0.3 * (right - left))
        x0, y0 = (left + right) / 2, (low + high) / 2
        return x0 - wide / 2, x0 + wide / 2, y0 - tall / 2, y0 + tall / 2
