"""A trace into detections: what a LiDAR detector on the ego vehicle would report.

Every object has a random stream of its own, drawn for all of its frames before anything is
dropped, so hiding or removing one object changes no number of another's.
"""

import operator
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator
from scipy.signal import lfilter
from scipy.special import expit

from mdkf.tables import CLUTTER, WALL, Detections, FloatArray, IntArray, Trace
from sim_bridge.profile import Correlation, Noise, Profile, load_profile
from sim_bridge.randomness import stream
from sim_bridge.recorded import is_recorded, recorded_detections

_SMALLEST = 0.3
"""Smallest side of a reported box [m]: size noise must not turn a bicycle inside out."""


def detect(trace: Trace, detector: str | Path = "pointrcnn", seed: int = 0) -> Detections:
    """The detections of a trace by the profile `detector` (a name or a YAML file).

    The same trace, profile and seed give the same bytes. `source` holds the objects' ids and
    `CLUTTER` for false boxes. `recorded:NAME` are the recorded detections of a recorded trace, to
    which the seed does nothing. Raises `ProfileError` for a bad profile.
    """
    if is_recorded(detector):
        return recorded_detections(trace, str(detector))
    profile = load_profile(detector)
    seed = operator.index(seed)
    key = (trace.provenance.get("identity", ""), trace.provenance.get("seed", ""), seed)
    distance = trace.sensor_distance()
    parts = []
    # Far objects cannot be seen, but what they draw must not depend on that.
    for identifier in trace.ids():
        rows = trace.rows_of(int(identifier))
        if trace.kind[rows[0]] != WALL and distance[rows].min() <= profile.max_range:
            rng = stream("detect", *key, int(identifier))
            parts.append(_detect_object(trace, rows, distance[rows], profile, rng))
    parts.append(_clutter(trace, profile, stream("clutter", *key)))
    columns = {name: np.concatenate([p[name] for p in parts]) for name in parts[0]}
    provenance = {
        **trace.provenance,
        "detector": profile.name,
        "detector_seed": str(seed),
        "trace": trace.content_hash(),
    }
    return Detections.from_columns(
        columns, n_frames=trace.n_frames, dt=trace.dt, provenance=provenance
    )


def _detect_object(
    trace: Trace, rows: IntArray, distance: FloatArray, profile: Profile, rng: Generator
) -> Mapping[str, Any]:
    """Detections of one object in its rows; all noise is drawn before the first row is dropped."""
    n, dt = len(rows), trace.dt
    luck = _persistent_uniform(rng, n, profile.detection.persistence)
    standard = {
        name: _correlated(rng, n, dt, getattr(profile, name))
        for name in ("radial", "lateral", "vertical", "yaw", "score")
    }
    sizes = {
        name: deviation.fixed * rng.standard_normal() + deviation.white * rng.standard_normal(n)
        for name in ("length", "width", "height")
        for deviation in (getattr(profile.size, name),)
    }
    visible = trace.visible[rows]
    noise = {
        name: standard[name] * _deviation(getattr(profile, name), distance, visible)
        for name in ("radial", "lateral", "vertical", "yaw")
    }
    frame = trace.frame[rows]
    x, y = trace.x[rows], trace.y[rows]
    bearing = np.arctan2(y - trace.ego.y[frame], x - trace.ego.x[frame])
    yaw = trace.yaw[rows] + noise["yaw"]
    columns = {
        "frame": frame,
        "x": x + noise["radial"] * np.cos(bearing) - noise["lateral"] * np.sin(bearing),
        "y": y + noise["radial"] * np.sin(bearing) + noise["lateral"] * np.cos(bearing),
        "z": trace.z[rows] + noise["vertical"],
        "yaw": np.arctan2(np.sin(yaw), np.cos(yaw)),
        **{s: np.maximum(getattr(trace, s)[rows] + sizes[s], _SMALLEST) for s in sizes},
        "score": _score(profile, distance, visible, standard["score"]),
        "source": trace.object_id[rows],
    }
    seen = luck < detection_probability(profile, distance, visible)
    return {name: values[seen] for name, values in columns.items()}


def detection_probability(
    profile: Profile, distance: FloatArray, visible: FloatArray
) -> FloatArray:
    """Probability of detection (n,) by distance (n,) [m] and visible fraction (n,)."""
    law = profile.detection
    reach = law.range + law.range_visible * (visible - 0.9)
    near = expit((reach - distance) / law.range_width)
    probability: FloatArray = near * np.minimum(visible / law.visible_floor, 1.0)
    return np.where(distance <= profile.max_range, probability, 0.0)


def _deviation(noise: Noise, distance: FloatArray, visible: FloatArray) -> FloatArray:
    return noise.constant + noise.per_range * distance + noise.hidden * (1.0 - visible)


def _score(
    profile: Profile, distance: FloatArray, visible: FloatArray, standard: FloatArray
) -> FloatArray:
    law = profile.score
    by_range = np.minimum(law.ceiling, law.constant - law.per_range * distance)
    hidden = law.hidden * (1.0 - visible) * np.minimum(1.0, distance / law.hidden_range)
    score: FloatArray = np.abs(by_range - hidden + law.noise * standard)
    return score


def _correlated(rng: Generator, n: int, dt: float, law: Correlation) -> FloatArray:
    """Standard normal noise (n,) in time: white + drifting + fixed, by their shares of variance."""
    white, drive, fixed = rng.standard_normal(n), rng.standard_normal(n), rng.standard_normal()
    keep = np.exp(-dt / law.drift_time)
    # The first value is stationary already; each later one forgets by `keep`.
    drive[1:] *= np.sqrt(1.0 - keep**2)
    drift = lfilter([1.0], [1.0, -keep], drive)
    white_share = 1.0 - law.drift_share - law.fixed_share
    noise: FloatArray = (
        np.sqrt(max(white_share, 0.0)) * white
        + np.sqrt(law.drift_share) * drift
        + np.sqrt(law.fixed_share) * fixed
    )
    return noise


def _persistent_uniform(rng: Generator, n: int, persistence: float) -> FloatArray:
    """Uniform numbers (n,), each repeating the one before with probability `persistence`."""
    values, again = rng.random(n), rng.random(n) < persistence
    again[:1] = False
    latest = np.maximum.accumulate(np.where(again, 0, np.arange(n)))
    return values[latest]


def _clutter(trace: Trace, profile: Profile, rng: Generator) -> Mapping[str, Any]:
    """False boxes of all frames."""
    law = profile.clutter
    area = np.pi * (profile.max_range**2 - law.min_range**2)
    counts = rng.poisson(law.density * area, trace.n_frames)
    n = int(counts.sum())
    frame = np.repeat(np.arange(trace.n_frames), counts)
    # Uniform over the area of the ring.
    distance = np.sqrt(law.min_range**2 + rng.random(n) * area / np.pi)
    bearing = rng.uniform(-np.pi, np.pi, n)
    size = {
        name: np.maximum(rng.normal(of.mean, of.deviation, n), _SMALLEST)
        for name, of in (("length", law.length), ("width", law.width), ("height", law.height))
    }
    return {
        "frame": frame,
        "x": trace.ego.x[frame] + distance * np.cos(bearing),
        "y": trace.ego.y[frame] + distance * np.sin(bearing),
        "z": size["height"] / 2,
        "yaw": rng.uniform(-np.pi, np.pi, n),
        **size,
        "score": rng.exponential(law.score_mean, n),
        "source": np.full(n, CLUTTER),
    }
