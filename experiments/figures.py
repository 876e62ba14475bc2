"""Results into pictures: one gap from above, its errors over time, mean errors over all gaps.

Every function returns a matplotlib figure; `as_svg` makes it a string for a page, `write_figure` a
file.
"""

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from experiments.statistics import mean_interval
from mdkf.tables import KINDS, Detections, FloatArray, Trace, Tracks
from sim_bridge.parquet import replacing

_COLOURS = {"ca": "#e07b00", "imm": "#2a9d3a", "imm-zero": "#8fce5a", "md": "#1f5fd0"}
_OTHERS = ("#7b3fb5", "#c2185b", "#00838f", "#6d4c41", "#546e7a")
FOOTPRINT = ("x", "y", "yaw", "length", "width")
"""What a box is from above."""
CONFIDENCE_SCALE = float(np.sqrt(-2 * np.log(1 - 0.95)))
"""Semi-axes of the 95 % ellipse of two dimensions, in standard deviations."""

DOTS_PER_INCH = 150
"""Of pictures in pixels."""

_CONTEXT = 30
"""Frames before and after a gap that the picture shows."""


def colours(filters: Sequence[str]) -> dict[str, str]:
    """A colour for each filter, the same in every figure."""
    others = [name for name in filters if name not in _COLOURS]
    spare = {name: _OTHERS[k % len(_OTHERS)] for k, name in enumerate(others)}
    return {name: _COLOURS.get(name) or spare[name] for name in filters}


def line_style(name: str) -> str:
    """Variants of a filter are dashed: where they agree, both can be seen."""
    return "--" if "-" in name else "-"


def as_svg(figure: Figure) -> str:
    """The figure as an SVG element; equal figures give equal text."""
    text = _svg(figure)
    return text[text.index("<svg") :]


def write_figure(figure: Figure, path: Path) -> None:
    """Write the figure, whole or not at all, as `.svg` or `.png`, by the file's name; equal figures
    give equal files. `OSError` as `sim_bridge.parquet.replacing`."""
    with replacing(path) as temporary:
        if path.suffix == ".svg":
            temporary.write_text(_svg(figure), encoding="utf-8")
        else:
            figure.savefig(temporary, format="png", dpi=DOTS_PER_INCH)


def _svg(figure: Figure) -> str:
    """The figure as an SVG document; its text is text, which can be searched and edited."""
    buffer = io.StringIO()
    settings: Any = {"svg.fonttype": "none", "svg.hashsalt": "mdkf", "font.family": "sans-serif"}
    with matplotlib.rc_context(settings):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return buffer.getvalue()


def gap_figure(
    trace: Trace,
    detections: Detections,
    occluded: Detections,
    tracks: Mapping[str, Tracks],
    errors: pl.DataFrame,
    gap: tuple[int, int, int],
) -> Figure:
    """One gap (object, first frame, first frame after it): from above, and error over time.

    detections, occluded: before and after those in the gaps were removed. errors: rows
    of `gap_errors` of this gap with a column `filter`.
    """
    figure = Figure(figsize=(11, 4.6), layout="constrained")
    above, over_time = figure.subplots(1, 2, width_ratios=(1.35, 1))
    _draw_above(above, trace, detections, occluded, tracks, errors, gap)
    _, start, stop = gap
    for name, colour in colours(list(tracks)).items():
        own = errors.filter(pl.col("filter") == name).sort("frame")
        seconds = (own["frame"].to_numpy() - start) * trace.dt
        values = own["error"].to_numpy().astype(np.float64)
        over_time.plot(seconds, values, line_style(name), color=colour, label=name, linewidth=1.8)
    _finish_time_axis(over_time, (stop - start) * trace.dt)
    over_time.set_ylabel("error of the followed track [m]")
    return figure


def mean_drift_figure(
    errors: pl.DataFrame, filters: Sequence[str], length: int, dt: float, natural: bool = False
) -> Figure | None:
    """Mean drift over time around all gaps of exactly `length` frames, one panel a scenario.

    natural: before and in all gaps, each as long as it lasts, up to `length` frames. The band is
    the 95 % interval over seeds of the seeds' means. None without such a gap.
    """
    of_length = pl.col("gap_stop") - pl.col("gap_start") == length
    shown = pl.col("phase") != "after" if natural else of_length
    exact = errors.filter(shown & pl.col("drift").is_not_null())
    if exact.is_empty():
        return None
    scenarios = exact["scenario"].unique(maintain_order=True).to_list()
    figure = Figure(figsize=(5.5 * len(scenarios), 4.2), layout="constrained")
    panels = figure.subplots(1, len(scenarios), sharey=True, squeeze=False)[0]
    for axes, scenario in zip(panels, scenarios, strict=True):
        own = exact.filter(scenario=scenario)
        n_gaps = own.select("seed", "object_id", "gap_start").n_unique()
        for name, colour in colours(filters).items():
            by_seed = (
                own.filter(filter=name)
                .group_by("offset", "seed")
                .agg(pl.col("drift").mean())
                .sort("offset", "seed")
            )
            offsets = by_seed["offset"].unique(maintain_order=True).to_numpy()
            intervals = [mean_interval(by_seed.filter(offset=k)["drift"]) for k in offsets]
            seconds = offsets * dt
            mean = [interval.mean for interval in intervals]
            axes.plot(seconds, mean, line_style(name), color=colour, label=name, linewidth=1.8)
            low = [interval.low for interval in intervals]
            high = [interval.high for interval in intervals]
            axes.fill_between(seconds, low, high, color=colour, alpha=0.15, linewidth=0)
        axes.set_title(f"{scenario}: {n_gaps} gaps", fontsize=10)
    for axes in panels:
        _finish_time_axis(axes, length * dt)
    panels[0].set_ylabel("mean drift [m], band: 95 % over seeds")
    panels[0].legend(frameon=False, fontsize=9, loc="upper left")
    return figure


def footprint(x: Any, y: Any, yaw: Any, length: Any, width: Any) -> FloatArray:
    """Corners (..., 4, 2) of boxes from above [m], from their middles [m], yaw [rad] and size [m],
    each (...)."""
    x, y, yaw, length, width = (np.asarray(a)[..., None] for a in (x, y, yaw, length, width))
    along = length * np.array([0.5, -0.5, -0.5, 0.5])
    across = width * np.array([0.5, 0.5, -0.5, -0.5])
    c, s = np.cos(yaw), np.sin(yaw)
    return np.stack([x + along * c - across * s, y + along * s + across * c], axis=-1)


def outlines(table: Trace | Detections | Tracks, rows: Any) -> FloatArray:
    """Corners of a row's box (4, 2), or of several rows' (n, 4, 2) [m]."""
    return footprint(*(getattr(table, name)[rows] for name in FOOTPRINT))


def confidence_ellipse(
    xx: FloatArray, xy: FloatArray, yy: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The 95 % ellipses of covariances, each (...) [m2]: larger and smaller semi-axis [m], and
    angle of the larger one [rad]."""
    middle, reach = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    major = CONFIDENCE_SCALE * np.sqrt(middle + reach)
    minor = CONFIDENCE_SCALE * np.sqrt(np.maximum(middle - reach, 0.0))
    return major, minor, np.arctan2(2 * xy, xx - yy) / 2


def _finish_time_axis(axes: Axes, gap_seconds: float) -> None:
    axes.set_ylim(0, axes.get_ylim()[1])
    if gap_seconds > 0:
        axes.axvspan(0, gap_seconds, color="#888888", alpha=0.15, linewidth=0)
        axes.text(
            gap_seconds / 2,
            0.985,
            "no detections",
            transform=axes.get_xaxis_transform(),
            ha="center",
            va="top",
            fontsize=8,
        )
    axes.set_xlabel("time since the gap began [s]")
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)


def _draw_above(
    axes: Axes,
    trace: Trace,
    detections: Detections,
    occluded: Detections,
    tracks: Mapping[str, Tracks],
    errors: pl.DataFrame,
    gap: tuple[int, int, int],
) -> None:
    object_id, start, stop = gap
    shown = range(max(start - _CONTEXT, 0), min(stop + _CONTEXT, trace.n_frames))
    own = trace.rows_of(object_id)
    own = own[np.isin(trace.frame[own], shown)]
    middle = (start + stop) // 2
    _draw_surroundings(axes, trace, object_id, middle)
    axes.plot(trace.x[own], trace.y[own], color="black", linewidth=1.2, label="truth")
    seen = detections.rows_of(object_id)
    seen = seen[np.isin(detections.frame[seen], shown)]
    removed = ~np.isin(detections.frame[seen], occluded.frame[occluded.rows_of(object_id)])
    style = {"s": 14, "linewidths": 0.8, "zorder": 3}
    x, y = detections.x[seen], detections.y[seen]
    axes.scatter(x[~removed], y[~removed], color="#444444", label="detections", **style)  # type: ignore[arg-type]
    hollow = {"facecolors": "none", "edgecolors": "#999999", "label": "removed detections"}
    axes.scatter(x[removed], y[removed], **hollow, **style)  # type: ignore[arg-type]
    last = own[trace.frame[own] == min(stop, shown[-1]) - 1]
    corners = [outlines(trace, row) for row in last]
    for box in corners:
        axes.add_patch(Polygon(box, fill=False, linestyle="--", color="black", linewidth=1.2))
    everything = [np.column_stack([trace.x[own], trace.y[own]]), *corners]
    for name, colour in colours(list(tracks)).items():
        followed = errors.filter(pl.col("filter") == name)["track_id"]
        if followed.is_empty() or followed[0] < 0:
            continue
        table = tracks[name]
        rows = table.rows_of(int(followed[0]))
        inside = rows[(table.frame[rows] >= start - 1) & (table.frame[rows] < stop)]
        axes.plot(
            table.x[inside], table.y[inside], color=colour, marker=".", markersize=4, label=name
        )
        for row in inside[-1:]:
            axes.add_patch(Polygon(outlines(table, row), fill=False, color=colour, linewidth=1.5))
            everything.append(outlines(table, row))
    _frame_view(axes, np.concatenate(everything))
    kind = KINDS[trace.kind[own[0]]]
    axes.set_title(
        f"a {kind} in its gap; boxes at the gap's last frame, grey: others at its middle",
        fontsize=9,
    )
    axes.legend(frameon=False, fontsize=8, ncols=4, loc="upper center", bbox_to_anchor=(0.5, -0.14))


def _draw_surroundings(axes: Axes, trace: Trace, object_id: int, frame: int) -> None:
    """All other boxes of a frame, and the sensor."""
    rows = np.arange(len(trace))[trace.frame_rows(frame)]
    for row in rows[trace.object_id[rows] != object_id]:
        large = trace.height[row] > 2.0
        axes.add_patch(
            Polygon(outlines(trace, row), color="#9aa3ad" if large else "#d5dade", zorder=0)
        )
    ego = trace.ego
    axes.plot(ego.x[frame], ego.y[frame], marker="^", color="#c62828", markersize=9, zorder=4)
    axes.annotate(
        "sensor",
        (ego.x[frame], ego.y[frame]),
        textcoords="offset points",
        xytext=(6, 6),
        fontsize=8,
        color="#c62828",
        annotation_clip=True,
    )


def _frame_view(axes: Axes, points: FloatArray) -> None:
    """Equal metres on both axes around the points, neither cramped nor a thin strip."""
    low, high = points.min(axis=0), points.max(axis=0)
    middle, span = (low + high) / 2, np.maximum((high - low) * 1.15, 5.0) + 4.0
    span = np.maximum(span, span.max() * np.array([0.6, 0.45]))
    axes.set_xlim(middle[0] - span[0] / 2, middle[0] + span[0] / 2)
    axes.set_ylim(middle[1] - span[1] / 2, middle[1] + span[1] / 2)
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.grid(alpha=0.25)
