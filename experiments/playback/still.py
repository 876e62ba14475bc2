"""A playback that stands still, for paper: three moments from above, a close-up, the errors."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse, Patch, Polygon

from experiments.figures import FOOTPRINT, footprint
from experiments.playback.scene import scene
from mdkf.tables import Detections, FloatArray, Trace, Tracks

_FAR = 1000.0
"""How far a shadow reaches [m]: out of the picture."""
_SHADOW: dict[str, Any] = {"color": "#3a4659", "alpha": 0.14, "linewidth": 0, "zorder": 1}


def still(
    trace: Trace,
    detections: Detections,
    tracks: Mapping[str, Tracks],
    *,
    focus: int,
    gap: tuple[int, int],
) -> Figure:
    """What `experiments.playback.playback` plays, in five pictures: the gap's first frame, the one
    half-way and its last from above, the last one again as a close-up with 95 % ellipses, and the
    error of each filter over time. Arguments and errors are those of `playback`."""
    told = scene(trace, detections, tracks, focus, gap, None, "")
    begin, last = told["gap"][0], told["still"]
    figure = Figure(figsize=(12, 7), layout="constrained")
    panels = figure.subplot_mosaic("AABBCC;DDDEEE", height_ratios=(1, 1.2))
    moments = (begin, (begin + last) // 2, last)
    for letter, axes, k in zip(
        "abc", (panels["A"], panels["B"], panels["C"]), moments, strict=True
    ):
        view = told["view"]
        _draw(axes, told, k)
        _look_at(axes, (view["x"], view["y"]), view["width"], view["height"])
        axes.set_title(f"({letter}) {told['state']} for {_seconds(told, k):.1f} s", fontsize=10)
    close = panels["D"]
    _draw(close, told, last, ellipses=True)
    own = next(one for one in told["objects"] if one["id"] == focus)
    reach = max(told["close"], 0.75 * max(_at(one["major"], last) or 0 for one in told["filters"]))
    _look_at(close, (_at(own["x"], last), _at(own["y"], last)), 3.2 * reach, 2 * reach)
    close.set_title("(d) as (c), with the 95 % ellipses", fontsize=10)
    _draw_errors(panels["E"], told)
    handles = [
        Line2D([], [], color="black", linestyle="--", label="truth"),
        *(
            Line2D([], [], color=one["colour"], linestyle=_style(one), label=one["name"])
            for one in told["filters"]
        ),
        Line2D([], [], color="#c62828", marker="^", linestyle="", label="sensor"),
        Patch(facecolor="#3a4659", alpha=0.14, label="out of its sight"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)
    return figure


def _at(column: Any, k: int) -> Any:
    """A column's value in a frame; None where there is none."""
    return column[k] if isinstance(column, list) else column


def _box(one: Mapping[str, Any], k: int) -> FloatArray | None:
    """Corners of an object or estimate; None where there is none."""
    values = [_at(one[name], k) for name in FOOTPRINT]
    return None if values[0] is None else footprint(*values)


def _seconds(told: Mapping[str, Any], k: int) -> float:
    return float((k - told["gap"][0]) * told["dt"])


def _style(one: Mapping[str, Any]) -> Any:
    return "--" if one["dashed"] else "-"


def _draw(axes: Axes, told: Mapping[str, Any], k: int, ellipses: bool = False) -> None:
    """One moment from above."""
    sensor = np.array([_at(told["sensor"][name], k) for name in ("x", "y")])
    for one in told["objects"]:
        box = _box(one, k)
        if box is None:
            continue
        if one["id"] == told["focus"]:
            axes.add_patch(Polygon(box, facecolor="#ffffffcc", edgecolor="none", zorder=2))
            axes.add_patch(Polygon(box, fill=False, linestyle="--", linewidth=1.4, zorder=5))
            continue
        colour = "#6a7686" if one["tall"] else "#cfd6de"
        axes.add_patch(Polygon(box, facecolor=colour, edgecolor="white", zorder=3))
        if one["tall"]:
            axes.add_patch(Polygon(_shadow(sensor, box), **_SHADOW))
    for one in told["filters"]:
        box = _box(one, k)
        if box is None:
            continue
        style = {"edgecolor": one["colour"], "linestyle": _style(one), "fill": False, "zorder": 4}
        axes.add_patch(Polygon(box, linewidth=1.4, **style))
        x, y = _at(one["x"], k), _at(one["y"], k)
        axes.plot(x, y, "o", color=one["colour"], markersize=4 if ellipses else 2.5, zorder=5)
        if ellipses:
            size = 2 * _at(one["major"], k), 2 * _at(one["minor"], k)
            turn = float(np.degrees(_at(one["angle"], k)))
            axes.add_patch(Ellipse((x, y), *size, angle=turn, linewidth=0.8, **style))
    axes.plot(*sensor, "^", color="#c62828", markersize=7, zorder=6, clip_on=True)


def _shadow(sensor: FloatArray, box: FloatArray) -> FloatArray:
    """The ground (4, 2) behind a box [m]."""
    middle = box.mean(axis=0) - sensor
    away = box - sensor
    turn = np.arctan2(middle[0] * away[:, 1] - middle[1] * away[:, 0], away @ middle)
    sides = box[[np.argmin(turn), np.argmax(turn)]]
    far = sensor + (sides - sensor) * _FAR / np.linalg.norm(sides - sensor, axis=1)[:, None]
    ground: FloatArray = np.array([sides[0], far[0], far[1], sides[1]])
    return ground


def _look_at(axes: Axes, middle: tuple[float, float], width: float, height: float) -> None:
    axes.set_xlim(middle[0] - width / 2, middle[0] + width / 2)
    axes.set_ylim(middle[1] - height / 2, middle[1] + height / 2)
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.grid(alpha=0.25, zorder=0)


def _draw_errors(axes: Axes, told: Mapping[str, Any]) -> None:
    seconds = np.array([_seconds(told, k) for k in range(told["frames"])])
    for one in told["filters"]:
        errors = [_at(one["error"], k) for k in range(told["frames"])]
        values = np.array(errors, dtype=np.float64)  # NaN for None
        axes.plot(seconds, values, _style(one), color=one["colour"], linewidth=1.8)
    begin, end = (_seconds(told, k) for k in told["gap"])
    axes.axvspan(begin, end, color="#888888", alpha=0.15, linewidth=0)
    middle = (begin + end) / 2
    axes.annotate(
        told["state"],
        (middle, 1),
        xycoords=axes.get_xaxis_transform(),
        textcoords="offset points",
        xytext=(0, -12),
        ha="center",
        fontsize=9,
    )
    axes.set_ylim(bottom=0)
    axes.set_xlim(seconds[0], seconds[-1])
    axes.set_title("(e) error of each filter", fontsize=10)
    axes.set_xlabel("time since the gap began [s]")
    axes.set_ylabel("distance from the truth [m]")
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
