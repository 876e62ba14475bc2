"""A trace into detections: what a LiDAR detector on the ego vehicle would report.

Every object has a random stream of its own, drawn for all of its frames before anything is
dropped, so hiding or removing one object changes no noise of another's.
"""

import operator
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import ndtr

from mdkf.tables import CLUTTER, WALL, Detections, FloatArray, IntArray, Trace
from sim_bridge.beyond_labels import has_labels, with_unlabelled
from sim_bridge.clutter import SMALLEST, flashes, ghosts
from sim_bridge.frames import BOX, frames_of
from sim_bridge.laws import detection_probability, error_scale, flip_probability, mean_score
from sim_bridge.line_of_sight import visible_sides
from sim_bridge.noise import correlated, drifting, heavy_tailed
from sim_bridge.point_count import lone_point_counts
from sim_bridge.profile import Correlation, Error, Profile, load_profile
from sim_bridge.randomness import stream
from sim_bridge.recorded import is_recorded, recorded_detections

BATCH = 100_000
"""Rows that are worked on at a time: their noise is many times as large as what becomes of it."""

_SIZE = ("length", "width", "height")


def detect(trace: Trace, detector: str | Path | Profile = "pointrcnn", seed: int = 0) -> Detections:
    """The detections of a trace by the profile `detector` (a name, a YAML file, or itself).

    The same trace, profile and seed give the same bytes. `source` holds the objects' ids and
    `CLUTTER` for false boxes, and for those of cars in frames in which a trace of labels does not
    hold them (`sim_bridge.beyond_labels`). `recorded:NAME` are the recorded detections of a
    recorded trace, to which the seed does nothing. Raises `ProfileError` for a bad profile.
    """
    if isinstance(detector, str) and is_recorded(detector):
        return recorded_detections(trace, detector)
    profile = detector if isinstance(detector, Profile) else load_profile(detector)
    seed = operator.index(seed)
    key = (trace.provenance.get("identity", ""), trace.provenance.get("seed", ""), seed)
    scene = _Scene.of(trace, profile, key)
    parts = [_detect_objects(scene, *batch, profile, key) for batch in _batches(scene, profile)]
    parts.append(flashes(trace.ego, profile, stream("clutter", *key)))
    parts.append(ghosts(trace.ego, profile, stream("ghosts", *key)))
    columns = {name: np.concatenate([p[name] for p in parts]) for name in parts[0]}
    if profile.pose is not None:
        columns |= _misplaced(trace, profile, columns, key)
    provenance = {
        **trace.provenance,
        "detector": profile.name,
        "detector_seed": str(seed),
        "trace": trace.content_hash(),
    }
    return Detections.from_columns(
        columns, n_frames=trace.n_frames, dt=trace.dt, provenance=provenance
    )


@dataclass(frozen=True, eq=False)
class _Scene:
    """A trace, and what its rows (rows,) are to the sensor: distance [m], LiDAR returns, how far
    the middle of what is visible is from the box's, to the left [m], and the source that the
    detections of each are said to have.

    What hides an object is known by its visible fraction alone, so that rows which were taken out
    of a trace still hide what they hid; only the side on which they hid it is then lost.
    """

    trace: Trace
    distance: FloatArray
    points: FloatArray
    side: FloatArray
    source: IntArray

    @staticmethod
    def of(trace: Trace, profile: Profile, key: tuple[object, ...]) -> "_Scene":
        source = trace.object_id
        if has_labels(trace):
            trace, labelled = with_unlabelled(trace, key)
            source = np.where(labelled, trace.object_id, CLUTTER)
        distance, seen = trace.sensor_distance(), frames_of(trace)
        side = visible_sides(*seen) if profile.side_share else np.zeros(len(trace))
        return _Scene(
            trace, distance, lone_point_counts(*seen) * trace.visible, side * distance, source
        )


def _batches(scene: _Scene, profile: Profile) -> Iterator[tuple[IntArray, IntArray]]:
    """Rows of the trace, object by object, and how many each object has.

    Walls, and objects that never come within reach, are left out.
    """
    trace = scene.trace
    if not len(trace):
        return
    rows = np.lexsort((trace.frame, trace.object_id))
    begins = np.flatnonzero(np.diff(trace.object_id[rows], prepend=-1))
    counts = np.diff(begins, append=len(rows))
    reported = np.minimum.reduceat(scene.distance[rows], begins) <= profile.max_range
    reported &= trace.kind[rows[begins]] != WALL
    rows, counts = rows[np.repeat(reported, counts)], counts[reported]
    ends = np.cumsum(counts)
    first = 0
    while first < len(counts):
        begin = ends[first] - counts[first]
        last = max(first + 1, int(np.searchsorted(ends, begin + BATCH, side="right")))
        yield rows[begin : ends[last - 1]], counts[first:last]
        first = last


def _detect_objects(
    scene: _Scene, rows: IntArray, counts: IntArray, profile: Profile, key: tuple[object, ...]
) -> Mapping[str, Any]:
    """Detections of some objects in their rows; noise is drawn before the first row is dropped."""
    trace, size = scene.trace, profile.size
    errors: dict[str, Error] = {
        "radial": profile.radial,
        "lateral": profile.lateral,
        "vertical": profile.vertical,
        "yaw": profile.yaw,
        **{name: getattr(size, name) for name in _SIZE},
    }
    laws: dict[str, Correlation] = {
        "luck": profile.detection,
        "flip": profile.flip,
        "score": profile.score,
        **errors,
    }
    ids = trace.object_id[rows[np.cumsum(counts) - counts]]
    streams = [stream("detect", *key, int(identifier)) for identifier in ids]
    noise = dict(zip(laws, correlated(streams, counts, list(laws.values()), trace.dt), strict=True))
    true = {name: getattr(trace, name)[rows] for name in BOX}
    frame, visible = trace.frame[rows], trace.visible[rows]
    dx, dy = true["x"] - trace.ego.x[frame], true["y"] - trace.ego.y[frame]
    distance = scene.distance[rows]
    off = {
        name: law.bias_per_range * distance
        + error_scale(law, distance, visible) * heavy_tailed(noise[name], law.tail)
        for name, law in errors.items()
    }
    off["lateral"] += profile.side_share * scene.side[rows]
    flipped = ndtr(noise["flip"]) < flip_probability(profile.flip, distance, visible)
    yaw = true["yaw"] + off["yaw"] + np.pi * flipped
    lowest, raw = profile.score.lowest, mean_score(profile.score, distance, visible)
    cosine, sine = dx / distance, dy / distance
    columns = {
        "frame": frame,
        "x": true["x"] + off["radial"] * cosine - off["lateral"] * sine,
        "y": true["y"] + off["radial"] * sine + off["lateral"] * cosine,
        "z": true["z"] + off["vertical"],
        "yaw": np.arctan2(np.sin(yaw), np.cos(yaw)),
        **{name: np.maximum(true[name] + off[name], SMALLEST) for name in _SIZE},
        "score": lowest + np.abs(raw + profile.score.noise * noise["score"] - lowest),
        "source": scene.source[rows],
    }
    chance = detection_probability(profile.detection, distance, visible, scene.points[rows])
    seen = (distance <= profile.max_range) & (ndtr(noise["luck"]) < chance)
    return {name: values[seen] for name, values in columns.items()}


def _misplaced(
    trace: Trace, profile: Profile, columns: Mapping[str, Any], key: tuple[object, ...]
) -> dict[str, FloatArray]:
    """x, y [m] and yaw [rad] of detections that a wrong pose of the sensor puts into the world."""
    assert profile.pose is not None
    pose, rng, ego = profile.pose, stream("pose", *key), trace.ego
    wrong = [drifting(rng, ego.n_frames, ego.dt, pose.drift_time) for _ in range(3)]
    frame = columns["frame"]
    turn = pose.yaw * wrong[2][frame]
    dx, dy = columns["x"] - ego.x[frame], columns["y"] - ego.y[frame]
    yaw = columns["yaw"] + turn
    return {
        "x": ego.x[frame] + pose.position * wrong[0][frame] + np.cos(turn) * dx - np.sin(turn) * dy,
        "y": ego.y[frame] + pose.position * wrong[1][frame] + np.sin(turn) * dx + np.cos(turn) * dy,
        "yaw": np.arctan2(np.sin(yaw), np.cos(yaw)),
    }
