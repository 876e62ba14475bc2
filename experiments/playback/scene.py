"""Tables into the scene that is played: plain data, only what is near and drawn.

A column is a list with a value for each frame, null where there is none, or the value alone where
it never changes. What is drawn alone is rounded to `DRAWN` decimals, what is told to `TOLD`.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from experiments.figures import colours, confidence_ellipse, line_style
from experiments.gaps import Gaps
from experiments.phases import gap_errors
from experiments.population import MATCH_DISTANCE, SCORED_VISIBLE
from mdkf.tables import KINDS, REGIMES, Detections, FloatArray, IntArray, Trace, Tracks

DRAWN, TOLD = 3, 6
"""Decimals: a picture needs millimetres; a number is rounded once more as it is shown."""

BEFORE, AFTER = 3.0, 2.5
"""Played before and after the gap, unless told otherwise [s]."""

ASPECT = 1.6
"""Width of the view by its height."""
MARGIN = 6.0
"""Around sensor and object [m]."""
LEAST_VIEW = 36.0
"""Width of the view, at least [m]."""
CLOSE_UP = 4.5, 10.0
"""From the object to the upper and lower edge of the close-up [m]: at least, and at most."""

_INNOVATION = ("innovation_", "nis")
"""Beginnings of diagnostics that are not shown: there are none of them in a gap."""


def scene(
    trace: Trace,
    detections: Detections,
    tracks: Mapping[str, Tracks],
    focus: int,
    gap: tuple[int, int],
    frames: range | None,
    title: str,
) -> dict[str, Any]:
    """What `experiments.playback.fragment.playback` plays, as JSON takes it."""
    played = played_frames(trace, gap, frames)
    own = _object(trace, focus, played)
    there = np.isfinite(own["x"][gap[0] - 1 - played.start : gap[1] - played.start])
    if not there.all():
        raise ValueError(
            f"playback: object {focus} is not in every frame from {gap[0] - 1} to {gap[1] - 1}"
        )
    colour = colours(list(tracks))
    filters = [
        {
            **{"name": name, "colour": colour[name], "dashed": line_style(name) == "--"},
            **estimates(trace, table, focus, gap, played),
        }
        for name, table in tracks.items()
    ]
    view = _view(trace, own, played, gap)
    ego = {name: getattr(trace.ego, name)[played.start : played.stop] for name in ("x", "y", "yaw")}
    hidden = (own["visible"][gap[0] - played.start : gap[1] - played.start] < SCORED_VISIBLE).all()
    missed = np.setdiff1d(np.arange(*gap), detections.frame[detections.rows_of(focus)])
    still = int(missed[-1]) if len(missed) else gap[1] - 1
    return {
        "title": title,
        "dt": trace.dt,
        "frames": len(played),
        "gap": [gap[0] - played.start, gap[1] - played.start],
        "first": played.start,
        "still": still - played.start,
        "state": "hidden" if hidden else "without detections",
        "in_view": SCORED_VISIBLE,
        "focus": focus,
        "view": view,
        "close": _close_up(filters, gap, played),
        "sensor": {name: _column(values, DRAWN) for name, values in ego.items()},
        "objects": _objects(trace, played, view, focus),
        "detections": _detections(detections, played, view, focus),
        "filters": [_told(one) for one in filters],
    }


def estimates(
    trace: Trace, tracks: Tracks, focus: int, gap: tuple[int, int], played: range
) -> dict[str, Any]:
    """One filter's estimates of an object, by frame (played,), NaN where there is none.

    They are those of the track that follows the object into the gap; where that one has ended, or
    has not begun, of the track nearest to the object, if one is on it. `followed` is the first
    one's id, -1 if there is none. track_id; x, y [m], yaw, length, width, vx, vy, coasted as in
    `Tracks`; error, the distance from the object [m]; major, minor [m] and angle [rad], the
    semi-axes of the 95 % ellipse of the position; `diagnostics` by name.
    """
    own = _object(trace, focus, played)
    followed = int(gap_errors(trace, tracks, Gaps.of([(focus, *gap)]))["track_id"][0])
    by_frame = (
        _row_of(tracks, followed, *one) for one in zip(played, own["x"], own["y"], strict=True)
    )
    rows = np.array([row for row in by_frame if row is not None], dtype=np.int64)
    diagnostics = inner_diagnostics(tracks)
    names = ("track_id", "x", "y", "yaw", "length", "width", "vx", "vy", "coasted")
    shape = ("cov_xx", "cov_xy", "cov_yy")
    found = _by_frame(tracks, rows, played, *names, *shape, *diagnostics)
    major, minor, angle = confidence_ellipse(*(found[name] for name in shape))
    return {
        **{name: found[name] for name in names},
        "major": major,
        "minor": minor,
        "angle": angle,
        "error": np.hypot(found["x"] - own["x"], found["y"] - own["y"]),
        "followed": followed,
        "diagnostics": {name: found[name] for name in diagnostics},
    }


def inner_diagnostics(tracks: Tracks) -> list[str]:
    """Names of the diagnostics that have a value in every frame: weights, mode probabilities."""
    return [name for name in tracks.diagnostics if not name.startswith(_INNOVATION)]


def played_frames(trace: Trace, gap: tuple[int, int], frames: range | None = None) -> range:
    """The frames that are played: those given, or some around the gap.

    Raises `ValueError` if they or the gap are not in the trace.
    """
    start, stop = gap
    if not 1 <= start < stop <= trace.n_frames:
        raise ValueError(
            f"playback: gap {start}..{stop}, expected frames in 1..{trace.n_frames}, ascending"
        )
    if frames is None:
        before, after = max(round(BEFORE / trace.dt), 1), round(AFTER / trace.dt)
        return range(max(start - before, 0), min(stop + after, trace.n_frames))
    if frames.step != 1 or not 0 <= frames.start < start < stop <= frames.stop <= trace.n_frames:
        raise ValueError(
            f"playback: {frames}, expected one frame after the other in"
            f" 0..{trace.n_frames}, with the gap {start}..{stop} and the frame before it"
        )
    return frames


def _by_frame(
    table: Trace | Tracks, rows: IntArray, played: range, *names: str
) -> dict[str, FloatArray]:
    """Columns by name, a value for each played frame, NaN where there is none."""
    place = table.frame[rows] - played.start
    inside = (place >= 0) & (place < len(played))
    columns = {}
    for name in names:
        columns[name] = np.full(len(played), np.nan)
        columns[name][place[inside]] = table.columns()[name][rows[inside]]
    return columns


def _object(trace: Trace, object_id: int, played: range) -> dict[str, FloatArray]:
    names = ("x", "y", "yaw", "vx", "vy", "length", "width", "visible", "regime")
    return _by_frame(trace, trace.rows_of(object_id), played, *names)


def _row_of(tracks: Tracks, followed: int, frame: int, x: float, y: float) -> int | None:
    """The row of the followed track in a frame, or of the nearest that is on the object."""
    there = tracks.frame_rows(frame)
    same = np.flatnonzero(tracks.track_id[there] == followed)
    if len(same):
        return int(there.start + same[0])
    distance = np.hypot(tracks.x[there] - x, tracks.y[there] - y)
    if not len(distance) or not distance.min() < MATCH_DISTANCE:
        return None
    return int(there.start + np.argmin(distance))


def _view(
    trace: Trace, own: Mapping[str, FloatArray], played: range, gap: tuple[int, int]
) -> dict[str, float]:
    """What is seen from above: the object, and the sensor while the object is hidden. x, y: the
    middle [m]; width, height [m]."""
    hidden = slice(gap[0] - played.start, gap[1] - played.start)
    ego = slice(*gap)
    x = np.concatenate([own["x"][hidden], trace.ego.x[ego]])
    y = np.concatenate([own["y"][hidden], trace.ego.y[ego]])
    width, height = np.ptp(x) + 2 * MARGIN, np.ptp(y) + 2 * MARGIN
    width = max(width, height * ASPECT, LEAST_VIEW)
    view = {"x": x.min() + np.ptp(x) / 2, "y": y.min() + np.ptp(y) / 2}
    return {**view, "width": width, "height": width / ASPECT}


def _close_up(filters: list[dict[str, Any]], gap: tuple[int, int], played: range) -> float:
    """From the object to the edge of the close-up [m], so that the filters stay in it."""
    hidden = slice(gap[0] - played.start, gap[1] - played.start)
    errors = np.concatenate([one["error"][hidden] for one in filters] or [np.zeros(1)])
    reach = float(np.max(errors, initial=0.0, where=np.isfinite(errors)))
    return float(np.clip(reach + 1.5, *CLOSE_UP))


def _near(x: FloatArray, y: FloatArray, view: Mapping[str, float]) -> Any:
    """Which points are in the view, or just outside."""
    return (np.abs(x - view["x"]) < 0.5 * view["width"] + 2 * MARGIN) & (
        np.abs(y - view["y"]) < 0.5 * view["height"] + 2 * MARGIN
    )


def _objects(
    trace: Trace, played: range, view: Mapping[str, float], focus: int
) -> list[dict[str, Any]]:
    """Everything that is ever in the view, and the object itself; tall: taller than the sensor."""
    rows = np.arange(int(trace.frame_start[played.start]), int(trace.frame_start[played.stop]))
    near = _near(trace.x[rows], trace.y[rows], view)
    top = trace.z + trace.height / 2
    found = []
    for object_id in np.union1d(trace.object_id[rows[near]], [focus]).tolist():
        first = rows[trace.object_id[rows] == object_id][0]
        columns = _object(trace, object_id, played)
        regime = columns.pop("regime")
        found.append(
            {
                "id": object_id,
                "kind": KINDS[trace.kind[first]],
                "tall": bool(top[first] > trace.ego.z[trace.frame[first]]),
                "regime": _constant(
                    [
                        None if np.isnan(code) else REGIMES[int(code)].replace("_", " ")
                        for code in regime
                    ]
                ),
                **{name: _column(values, DRAWN) for name, values in columns.items()},
            }
        )
    return found


def _detections(
    detections: Detections, played: range, view: Mapping[str, float], focus: int
) -> list[list[list[float]]]:
    """By frame the detections in the view: x, y, and 1 for the object's own."""
    found = []
    for frame in played:
        rows = detections.frame_rows(frame)
        x, y, source = (getattr(detections, name)[rows] for name in ("x", "y", "source"))
        near = _near(x, y, view)
        columns = (np.round(x[near], 3), np.round(y[near], 3), (source[near] == focus).astype(int))
        found.append([list(row) for row in zip(*(c.tolist() for c in columns), strict=True)])
    return found


def _told(one: Mapping[str, Any]) -> dict[str, Any]:
    """A filter as JSON takes it."""
    told = {
        name: _column(value, TOLD) if isinstance(value, np.ndarray) else value
        for name, value in one.items()
        if name != "diagnostics"
    }
    told["diagnostics"] = {
        name: _column(values, TOLD) for name, values in one["diagnostics"].items()
    }
    return told


def _column(values: FloatArray, decimals: int) -> Any:
    """Values as JSON takes them: null for NaN, one for all where all are the same."""
    rounded = np.round(values, decimals).tolist()
    return _constant([None if np.isnan(value) else value for value in rounded])


def _constant(values: list[Any]) -> Any:
    return values[0] if values and all(value == values[0] for value in values) else values
