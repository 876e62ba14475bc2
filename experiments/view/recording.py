"""A scene into a rerun recording.

What is in it, in the world frame [m], by frame and by time [s]:

    world/sensor                    its pose, an arrow ahead
    world/truth/KIND                boxes; the darker, the less of them the sensor sees
    world/truth/in_gap              boxes, of any kind, whose detections the protocol removed
    world/detections/given          boxes; removed: those in the gaps; clutter: false ones
    world/tracks/FILTER/measured    boxes of tracks with a detection; coasted: without one
    world/tracks/FILTER/ellipses    95 % ellipses of the position, at the height of the roof
    world/truth/paths               from where an object was in the frame before; and so for tracks
    objects/ID/error                of an object with a gap: distance of each filter [m]
    objects/ID/visible              fraction that the sensor sees, and whether in the gap
    objects/ID/FILTER               the estimator's own diagnostics

Rerun keeps places in single precision: to a millimetre up to 8 km from the origin.
"""

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from experiments.figures import colours, confidence_ellipse
from experiments.gaps import Gap
from experiments.playback.scene import estimates
from experiments.view.layout import described, layout
from experiments.view.palette import (
    DETECTIONS,
    GAP,
    KINDS_SHOWN,
    SENSOR,
    SIGHT,
    TRUE_PATH,
    codes,
    legend,
)
from experiments.view.scene import Scene
from mdkf.tables import (
    CLUTTER,
    KINDS,
    REGIMES,
    Detections,
    FloatArray,
    IntArray,
    Trace,
    Tracks,
)

HIDDEN = 0.3
"""Brightness of what the sensor does not see at all."""
THIN, THICK = 1.0, 2.5
"""Widths of lines, in points of the screen."""
FLAT = 0.01
"""Half the height of an ellipse [m]."""


def identity(scene: Scene) -> str:
    """The recording's id: the same for the same tables, so that a viewer knows them again."""
    tables = [
        scene.trace,
        *scene.tracks.values(),
        *([scene.detections] if scene.detections else []),
    ]
    told = [*scene.tracks, *(table.content_hash() for table in tables)]
    return hashlib.sha256("\n".join(told).encode()).hexdigest()[:32]


def stream_of(scene: Scene) -> rr.RecordingStream:
    """An empty recording of a scene, to be connected to where `record` shall write."""
    # An application of its own: rerun keeps one layout for each. Its name takes no comma.
    application = re.sub(r"\W+", "-", f"mdkf {scene.name}")
    return rr.RecordingStream(application, recording_id=identity(scene), send_properties=False)


def record(scene: Scene, stream: rr.RecordingStream, focus: Gap | None) -> None:
    """Send a scene. focus: the gap that the layout looks at, and whose object it plots."""
    stream.send_blueprint(layout(scene, focus))
    stream.send_recording_name(scene.name)
    plotted = None if focus is None else described(scene, focus)
    text = rr.TextDocument(legend(scene, plotted), media_type="text/markdown")
    stream.log("legend", text, static=True)
    stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    into = _Frames(stream, scene.trace.n_frames, scene.trace.dt)
    _send_sensor(into, scene.trace)
    _send_truth(into, scene)
    if scene.detections is not None:
        _send_detections(into, scene, scene.detections)
    colour = colours(list(scene.tracks))
    for name, tracks in scene.tracks.items():
        _send_tracks(into, name, tracks, colour[name])
    for gap in scene.shown_gaps() if scene.tracks else []:
        _send_object(into, scene, gap, colour)


@dataclass(frozen=True)
class _Frames:
    """A recording of `n_frames` frames, `dt` [s] apart."""

    stream: rr.RecordingStream
    n_frames: int
    dt: float

    def send(self, path: str, frame: IntArray, columns: Any, style: rr.AsComponents) -> None:
        """Instances (n,), in order of their frames, into every frame those that it has: also
        none, or a viewer would go on showing the last ones."""
        lengths = np.bincount(frame, minlength=self.n_frames)
        self.stream.log(path, style, static=True)
        self._send(path, np.arange(self.n_frames), columns.partition(lengths))

    def plot(
        self, path: str, frame: IntArray, lines: Mapping[str, FloatArray], **style: Any
    ) -> None:
        """Lines by name, their values (n,) at frames (n,); NaN where there is none."""
        self.stream.log(path, rr.SeriesLines(names=list(lines), **style), static=True)
        values = np.column_stack(list(lines.values()))
        columns = rr.Scalars.columns(scalars=values.ravel())
        self._send(path, frame, columns.partition(np.full(len(frame), len(lines))))

    def _send(self, path: str, frame: IntArray, columns: Any) -> None:
        when = [
            rr.TimeColumn("frame", sequence=frame),
            rr.TimeColumn("time", duration=frame * self.dt),
        ]
        self.stream.send_columns(path, when, columns)


def _send_sensor(into: _Frames, trace: Trace) -> None:
    ego = trace.ego
    into.stream.log(
        "world/sensor",
        rr.Arrows3D(vectors=[[4.0, 0.0, 0.0]], colors=codes(SENSOR), radii=[0.12]),
        rr.Points3D([[0.0, 0.0, 0.0]], colors=codes(SENSOR), radii=[0.35]),
        static=True,
    )
    pose = rr.Transform3D.columns(
        translation=np.column_stack([ego.x, ego.y, ego.z]), quaternion=_turned(ego.yaw)
    )
    into._send("world/sensor", ego.frame, pose)


def _send_truth(into: _Frames, scene: Scene) -> None:
    trace = scene.trace
    in_gap = scene.gaps.covers(trace.object_id, trace.frame)
    names = [
        f"{KINDS[kind]} {own}: {visible:.0%} visible, {REGIMES[regime].replace('_', ' ')}"
        for kind, own, visible, regime in zip(
            *(getattr(trace, name).tolist() for name in ("kind", "object_id", "visible", "regime")),
            strict=True,
        )
    ]
    for kind in KINDS:
        rows = np.flatnonzero((trace.kind == KINDS.index(kind)) & ~in_gap)
        if len(rows):
            shade = HIDDEN + (1 - HIDDEN) * trace.visible[rows]
            colour = _shaded(KINDS_SHOWN[kind][1], shade)
            style = _style(rr.Boxes3D, fill=True, show_labels=False)
            labels = [names[row] for row in rows]
            columns = rr.Boxes3D.columns(**_boxes(trace, rows), colors=colour, labels=labels)
            into.send(f"world/truth/{kind}", trace.frame[rows], columns, style)
    rows = np.flatnonzero(in_gap)
    if len(rows):
        style = _style(rr.Boxes3D, GAP, THICK, fill=True, show_labels=True)
        labels = [f"{KINDS[trace.kind[row]]} {trace.object_id[row]} in its gap" for row in rows]
        columns = rr.Boxes3D.columns(**_boxes(trace, rows), labels=labels)
        into.send("world/truth/in_gap", trace.frame[rows], columns, style)
    _send_paths(into, "world/truth/paths", trace, trace.object_id, TRUE_PATH)


def _send_detections(into: _Frames, scene: Scene, detections: Detections) -> None:
    removed = scene.gaps.covers(detections.source, detections.frame)
    clutter = detections.source == CLUTTER
    parts = {"given": ~removed & ~clutter, "removed": removed, "clutter": clutter}
    for name, mask in parts.items():
        rows = np.flatnonzero(mask)
        if len(rows):
            style = _style(rr.Boxes3D, DETECTIONS[name], THIN, show_labels=False)
            labels = [f"score {score:.2f}" for score in detections.score[rows]]
            columns = rr.Boxes3D.columns(**_boxes(detections, rows), labels=labels)
            into.send(f"world/detections/{name}", detections.frame[rows], columns, style)


def _send_tracks(into: _Frames, name: str, tracks: Tracks, colour: str) -> None:
    path = f"world/tracks/{name}"
    for state, mask in (("measured", ~tracks.coasted), ("coasted", tracks.coasted)):
        rows = np.flatnonzero(mask)
        coasts = state == "coasted"
        style = _style(rr.Boxes3D, colour, THICK if coasts else THIN, coasts, show_labels=False)
        labels = [f"{name} {own}, {state}" for own in tracks.track_id[rows]]
        columns = rr.Boxes3D.columns(**_boxes(tracks, rows), labels=labels)
        into.send(f"{path}/{state}", tracks.frame[rows], columns, style)
    major, minor, angle = confidence_ellipse(tracks.cov_xx, tracks.cov_xy, tracks.cov_yy)
    columns = rr.Ellipsoids3D.columns(
        centers=np.column_stack([tracks.x, tracks.y, tracks.z + tracks.height / 2]),
        half_sizes=np.column_stack([major, minor, np.full(len(tracks), FLAT)]),
        quaternions=_turned(angle),
    )
    into.send(f"{path}/ellipses", tracks.frame, columns, _style(rr.Ellipsoids3D, colour, THIN))
    _send_paths(into, f"{path}/paths", tracks, tracks.track_id, colour)


def _send_paths(
    into: _Frames, path: str, table: Trace | Tracks, identifier: IntArray, colour: str
) -> None:
    """Of everything that moved, the way since the frame before; a layout that shows the last
    seconds of these shows paths."""
    before, now = _steps(table.frame, identifier)
    places = np.column_stack([table.x, table.y, table.z])
    moved = np.hypot(*(places[now] - places[before])[:, :2].T) > 0
    before, now = before[moved], now[moved]
    strips = np.stack([places[before], places[now]], axis=1)
    style = rr.LineStrips3D.from_fields(
        colors=codes(colour), radii=rr.Radius.ui_points(THIN), show_labels=False
    )
    into.send(path, table.frame[now], rr.LineStrips3D.columns(strips=strips), style)


def _send_object(into: _Frames, scene: Scene, gap: Gap, colour: Mapping[str, str]) -> None:
    """What is plotted of an object, as long as it is there."""
    object_id, start, stop = gap
    trace = scene.trace
    rows = trace.rows_of(object_id)
    frame = trace.frame[rows]
    played = range(int(frame[0]), int(frame[-1]) + 1)
    found = {
        name: estimates(trace, tracks, object_id, (start, stop), played)
        for name, tracks in scene.tracks.items()
    }
    path, every = f"objects/{object_id}", np.array(played)
    errors = {name: one["error"] for name, one in found.items()}
    into.plot(f"{path}/error", every, errors, colors=codes(*(colour[name] for name in errors)))
    hidden = ((frame >= start) & (frame < stop)).astype(np.float64)
    sight = {"visible fraction": trace.visible[rows], "in the gap": hidden}
    shades = codes(SIGHT, GAP)
    into.plot(f"{path}/visible", frame, sight, colors=shades)
    for name, one in found.items():
        if told := scene.diagnostics(name):
            into.plot(f"{path}/{name}", every, {each: one["diagnostics"][each] for each in told})


def _steps(frame: IntArray, identifier: IntArray) -> tuple[IntArray, IntArray]:
    """The rows of what is in two frames one after the other: before and now, in order of now."""
    order = np.lexsort((frame, identifier))
    before, now = order[:-1], order[1:]
    same = (identifier[before] == identifier[now]) & (frame[now] - frame[before] == 1)
    by_row = np.argsort(now[same])
    return before[same][by_row], now[same][by_row]


def _boxes(table: Trace | Detections | Tracks, rows: IntArray) -> dict[str, Any]:
    size = np.column_stack([table.length, table.width, table.height])[rows]
    return {
        "centers": np.column_stack([table.x, table.y, table.z])[rows],
        "half_sizes": size / 2,
        "quaternions": _turned(table.yaw[rows]),
    }


def _turned(yaw: FloatArray) -> FloatArray:
    """Quaternions (n, 4), x to w, of turns about the vertical."""
    zero = np.zeros_like(yaw)
    return np.column_stack([zero, zero, np.sin(yaw / 2), np.cos(yaw / 2)])


def _style(
    kind: Any, colour: str | None = None, width: float = THIN, fill: bool = False, **others: Any
) -> Any:
    """How all instances of an entity look."""
    modes = rr.components.FillMode
    if colour is not None:
        others["colors"] = codes(colour)
    thickness = "radii" if kind is rr.Boxes3D else "line_radii"
    others[thickness] = [rr.Radius.ui_points(width)]
    others["fill_mode"] = modes.TransparentFillMajorWireframe if fill else modes.MajorWireframe
    return kind.from_fields(**others)


def _shaded(colour: str, brightness: FloatArray) -> NDArray[np.uint32]:
    """Codes (n,) of a colour at brightnesses (n,) from 0 to 1."""
    (full,) = codes(colour)
    channels = (np.round((full >> shift & 0xFF) * brightness) for shift in (24, 16, 8))
    r, g, b = (channel.astype(np.uint32) for channel in channels)
    shaded: NDArray[np.uint32] = r << 24 | g << 16 | b << 8 | 0xFF
    return shaded
