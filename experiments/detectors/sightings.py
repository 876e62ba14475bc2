"""What a detector made of each labelled car, and what it reported where there was none.

Both for recorded and for simulated detections of recorded truth, so that they can be compared.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl

from mdkf.tables import CLUTTER, BoolArray, Detections, FloatArray, IntArray, Trace
from sim_bridge.beyond_labels import has_labels, of_unlabelled
from sim_bridge.frames import BOX, frames_of
from sim_bridge.kitti import in_view
from sim_bridge.line_of_sight import visible_sides
from sim_bridge.point_count import lone_point_counts

ERRORS = ("radial", "lateral", "vertical", "yaw", "length", "width", "height")
"""In metres, the yaw's in radians: detected less labelled, a box that looks backwards turned."""


@dataclass(frozen=True, eq=False)
class Sightings:
    """Sightings of a detector in some sequences.

    cars: one row per labelled car and frame: sequence, frame, object_id, distance [m], visible,
    points, side [m] (how far to the left the middle of what is visible is), occlusion (KITTI's
    level), hit, and, NaN where there is no hit, `ERRORS`, flip, score.
    clutter: one row per false box in view that is of no labelled car just before or after its
    labels: sequence, frame, x, y [m], distance [m], length, width, height [m], score. frames: how
    many each sequence has; dt: time between them [s].
    """

    cars: pl.DataFrame
    clutter: pl.DataFrame
    frames: Mapping[str, int]
    dt: float

    @staticmethod
    def joined(parts: Sequence["Sightings"]) -> "Sightings":
        """Those of several sequences, each of another name."""
        return Sightings(
            pl.concat([part.cars for part in parts]),
            pl.concat([part.clutter for part in parts]),
            {name: n for part in parts for name, n in part.frames.items()},
            parts[0].dt,
        )

    @property
    def n_frames(self) -> int:
        """Frames of all sequences."""
        return sum(self.frames.values())


def sightings(
    name: str, trace: Trace, detections: Detections, occlusion: IntArray, scored: BoolArray
) -> Sightings:
    """The sightings in a sequence called `name`; `detections` are of `trace`.

    occlusion (rows,): level of each row of the trace; scored (rows,): the rows that count.
    """
    found = _found(trace, detections)
    hit = found >= 0
    at = np.where(hit, found, 0)
    cars = {
        "sequence": np.full(len(trace), name),
        "frame": trace.frame,
        "object_id": trace.object_id,
        "distance": trace.sensor_distance(),
        "visible": trace.visible,
        **_seen_by_sensor(trace),
        "occlusion": occlusion,
        "hit": hit,
        **{
            error: np.where(hit, values, np.nan)
            for error, values in _errors(trace, detections, at).items()
        },
    }
    return Sightings(
        pl.DataFrame({column: values[scored] for column, values in cars.items()}),
        _false_boxes(name, trace, detections),
        {name: trace.n_frames},
        trace.dt,
    )


def _found(trace: Trace, detections: Detections) -> IntArray:
    """For each row of the trace the row of its detection, -1 for none."""
    base = int(max(trace.object_id.max(initial=0), detections.source.max(initial=0))) + 1
    true = np.flatnonzero(detections.source != CLUTTER)
    keys = detections.frame[true] * base + detections.source[true]
    order = np.argsort(keys)
    wanted = trace.frame * base + trace.object_id
    at = np.searchsorted(keys[order], wanted)
    found = np.full(len(trace), -1, dtype=np.int64)
    inside = at < len(keys)
    same = inside.copy()
    same[inside] = keys[order][at[inside]] == wanted[inside]
    found[same] = true[order][at[same]]
    return found


def _seen_by_sensor(trace: Trace) -> dict[str, FloatArray]:
    seen = frames_of(trace)
    return {
        "points": lone_point_counts(*seen) * trace.visible,
        "side": visible_sides(*seen) * trace.sensor_distance(),
    }


def _errors(trace: Trace, detections: Detections, at: IntArray) -> dict[str, FloatArray]:
    """Errors, flip and score (rows,) of the detections `at` (rows,)."""
    if not len(detections):
        return {name: np.full(len(trace), np.nan) for name in (*ERRORS, "flip", "score")}
    off = {name: getattr(detections, name)[at] - getattr(trace, name) for name in BOX}
    dx, dy = trace.x - trace.ego.x[trace.frame], trace.y - trace.ego.y[trace.frame]
    distance = np.hypot(dx, dy)
    turned = np.angle(np.exp(1j * off["yaw"]))
    flip = np.abs(turned) > np.pi / 2
    return {
        "radial": (off["x"] * dx + off["y"] * dy) / distance,
        "lateral": (off["y"] * dx - off["x"] * dy) / distance,
        "vertical": off["z"],
        "yaw": np.where(flip, turned - np.copysign(np.pi, turned), turned),
        **{name: off[name] for name in ("length", "width", "height")},
        "flip": flip.astype(np.float64),
        "score": detections.score[at],
    }


def _false_boxes(name: str, trace: Trace, detections: Detections) -> pl.DataFrame:
    """Clutter in the direction of the picture: simulated clutter is all around."""
    frame = detections.frame
    dx, dy = detections.x - trace.ego.x[frame], detections.y - trace.ego.y[frame]
    rows = (detections.source == CLUTTER) & in_view(trace.ego, frame, detections.x, detections.y)
    if has_labels(trace):
        rows &= ~of_unlabelled(trace, detections)
    names = ("frame", "x", "y", "length", "width", "height", "score")
    columns = {name: getattr(detections, name)[rows] for name in names}
    return pl.DataFrame(
        {"sequence": np.full(rows.sum(), name), "distance": np.hypot(dx, dy)[rows], **columns}
    )
