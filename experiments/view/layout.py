"""How a scene's recording is laid out in the viewer."""

from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from experiments.gaps import Gap
from experiments.playback.scene import played_frames
from experiments.view.scene import Scene
from mdkf.tables import KINDS

PATHS = 4.0
"""How long a path is shown [s]."""
BEHIND = (-24.0, 0.0, 20.0), (14.0, 0.0, 0.0)
"""Where the moving view is and what it looks at, as seen from the sensor [m]."""
ABOVE = 60.0
"""Height of the view from above [m]."""

GROUND = (30, 33, 40)
"""Colour behind the world."""


def layout(scene: Scene, focus: Gap | None) -> rrb.Blueprint:
    """Views from behind the sensor and from above; of the focus, error, sight and diagnostics.

    Played is, again and again, the time around the gap that is looked at; all if there is none.
    """
    told = rrb.TextDocumentView(origin="legend", name="what is what")
    plots = [] if focus is None else _plots(scene, focus)
    beside = rrb.Vertical(*plots, told, row_shares=[1.0] * len(plots) + [1.4])
    return rrb.Blueprint(
        rrb.Horizontal(_views(scene, focus), beside, column_shares=[2, 1]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline="time", **_selected(scene, focus)),
    )


def described(scene: Scene, focus: Gap) -> str:
    """The object of a gap: its kind and number."""
    trace = scene.trace
    return f"{KINDS[trace.kind[trace.rows_of(focus[0])[0]]]} {focus[0]}"


def _views(scene: Scene, focus: Gap | None) -> rrb.Tabs:
    """The world in space, moving with the sensor, and standing still."""
    since = rrb.VisibleTimeRanges(
        [
            rr.VisibleTimeRange(
                "time",
                start=rr.TimeRangeBoundary.cursor_relative(seconds=-PATHS),
                end=rr.TimeRangeBoundary.cursor_relative(),
            ),
            rr.VisibleTimeRange(
                "frame",
                start=rr.TimeRangeBoundary.cursor_relative(seq=-round(PATHS / scene.trace.dt)),
                end=rr.TimeRangeBoundary.cursor_relative(),
            ),
        ]
    )
    paths = ["world/truth/paths", *(f"world/tracks/{name}/paths" for name in scene.tracks)]
    common: dict[str, Any] = {
        "contents": "world/**",
        "overrides": dict.fromkeys(paths, since),
        "background": GROUND,  # or it would be the theme's, white or black
    }
    position, target = BEHIND
    x, y = _middle(scene, focus)
    return rrb.Tabs(
        rrb.Spatial3DView(
            origin="world/sensor",
            name="moving with the sensor",
            eye_controls=rrb.EyeControls3D(position=position, look_target=target),
            **common,
        ),
        rrb.Spatial3DView(
            origin="world",
            name="from above",
            eye_controls=rrb.EyeControls3D(position=(x, y - 1.0, ABOVE), look_target=(x, y, 0.0)),
            **common,
        ),
    )


def _middle(scene: Scene, focus: Gap | None) -> tuple[float, float]:
    """Where the object is half-way through its gap, or the sensor half-way through all [m]."""
    if focus is None:
        ego = scene.trace.ego
        half = len(ego) // 2
        return float(ego.x[half]), float(ego.y[half])
    object_id, start, stop = focus
    rows = scene.trace.rows_of(object_id)
    row = rows[np.argmin(np.abs(scene.trace.frame[rows] - (start + stop) // 2))]
    return float(scene.trace.x[row]), float(scene.trace.y[row])


def _plots(scene: Scene, focus: Gap) -> list[Any]:
    """What happens to the object around its gap, and what the estimators make of it."""
    path, name = f"objects/{focus[0]}", described(scene, focus)
    begin, end = _around(scene, focus)
    seconds = rr.TimeRange(
        start=rr.TimeRangeBoundary.absolute(seconds=begin),
        end=rr.TimeRangeBoundary.absolute(seconds=end),
    )

    def plot(of: str, title: str) -> rrb.TimeSeriesView:
        axis = rrb.TimeAxis(view_range=seconds)
        return rrb.TimeSeriesView(origin=f"{path}/{of}", name=title, axis_x=axis)

    own = [
        plot(each, f"{name}: diagnostics of {each}")
        for each in scene.tracks
        if scene.diagnostics(each)
    ]
    return [
        plot("error", f"{name}: error of each filter [m]"),
        plot("visible", f"{name}: visible, and in the gap"),
        *([rrb.Tabs(*own)] if own else []),
    ]


def _around(scene: Scene, focus: Gap) -> tuple[float, float]:
    """The time around the gap that is looked at [s]."""
    played = played_frames(scene.trace, focus[1:])
    return played.start * scene.trace.dt, (played.stop - 1) * scene.trace.dt


def _selected(scene: Scene, focus: Gap | None) -> dict[str, Any]:
    """The time that is played again and again."""
    if focus is None:
        return {}
    nanoseconds = (round(1e9 * seconds) for seconds in _around(scene, focus))
    selection = rrb.components.AbsoluteTimeRange(*nanoseconds)
    return {"time_selection": selection, "loop_mode": "selection"}
