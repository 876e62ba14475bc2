"""False boxes: flashes of one frame, and ghosts that stay where they are for a while."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.random import Generator
from scipy.special import expit

from mdkf.tables import CLUTTER, EgoPath, FloatArray, IntArray
from sim_bridge.profile import Clutter, Profile

SMALLEST = 0.3
"""Smallest side of a reported box [m]: size noise must not turn a bicycle inside out."""

CELL = 50.0
"""Side of the squares in which ghosts are drawn [m]."""

_NODES = 1025
"""Distances between which the area's distribution is interpolated."""


def flashes(ego: EgoPath, profile: Profile, rng: Generator) -> Mapping[str, Any]:
    """Columns of detections, source `CLUTTER`: a Poisson number in every frame."""
    law = profile.clutter.flashes
    distances, up_to = effective_area(profile.clutter, profile.max_range)
    counts = rng.poisson(law.density * up_to[-1], ego.n_frames)
    frame = np.repeat(np.arange(ego.n_frames), counts)
    n = len(frame)
    distance = np.interp(rng.random(n) * up_to[-1], up_to, distances)
    bearing = rng.uniform(-np.pi, np.pi, n)
    place = {
        "x": ego.x[frame] + distance * np.cos(bearing),
        "y": ego.y[frame] + distance * np.sin(bearing),
    }
    score = profile.score.lowest + rng.exponential(law.score_mean, n)
    return _columns(frame, place | _shapes(profile.clutter, n, rng), score)


def ghosts(ego: EgoPath, profile: Profile, rng: Generator) -> Mapping[str, Any]:
    """Columns of detections, source `CLUTTER`, of false boxes that stay where they are.

    They come and go all over the world, as many alive at any time, and end after a time of
    exponential distribution; each is seen from where the sensor is near enough for it.
    """
    law = profile.clutter.ghosts
    cell, first, last = _cells(ego, profile.max_range)
    # Cells of the world have ghosts from the frame in which they come within range.
    in_cell = law.density * CELL**2
    survival = np.exp(-ego.dt / law.life)
    at_first = rng.poisson(in_cell, len(cell))
    later = rng.poisson(in_cell * (1.0 - survival) * (last - first), len(cell))
    home = np.repeat(np.arange(len(cell)), at_first + later)
    n = len(home)
    order = np.arange(n) - np.repeat(
        np.cumsum(at_first + later) - at_first - later, at_first + later
    )
    born = first[home] + np.where(
        order < at_first[home], 0, 1 + np.floor(rng.random(n) * (last - first)[home])
    ).astype(np.int64)
    frames = 1 + np.floor(rng.exponential(law.life, n) / ego.dt).astype(np.int64)
    lives = np.minimum(frames, last[home] + 1 - born)
    place = CELL * (cell[home] + rng.random((n, 2)))
    boxes = {"x": place[:, 0], "y": place[:, 1], **_shapes(profile.clutter, n, rng)}
    score = profile.score.lowest + rng.exponential(law.score_mean, n)
    farthest = rng.random(n)

    ghost = np.repeat(np.arange(n), lives)
    frame = born[ghost] + np.arange(len(ghost)) - np.repeat(np.cumsum(lives) - lives, lives)
    seen = rng.random(len(ghost)) < law.reported
    x, y = law.jitter * rng.standard_normal((2, len(ghost)))
    x, y = boxes["x"][ghost] + x, boxes["y"][ghost] + y
    distance = np.hypot(x - ego.x[frame], y - ego.y[frame])
    seen &= farthest[ghost] < nearness(profile.clutter, distance)
    seen &= (distance >= profile.clutter.min_range) & (distance <= profile.max_range)
    ghost, frame = ghost[seen], frame[seen]
    columns = {name: values[ghost] for name, values in boxes.items()}
    columns |= {"x": x[seen], "y": y[seen]}
    return _columns(frame, columns, score[ghost])


def _cells(ego: EgoPath, max_range: float) -> tuple[IntArray, IntArray, IntArray]:
    """Squares (n, 2) of side `CELL` that come within range, and their first and last frames so."""
    reach = int(np.ceil(max_range / CELL))
    near = np.arange(-reach, reach + 1)
    around = np.stack(np.meshgrid(near, near, indexing="ij"), axis=-1).reshape(-1, 2)
    here = np.floor(np.column_stack([ego.x, ego.y]) / CELL).astype(np.int64)
    # Only frames in which the sensor enters a square change what is near.
    changes = np.flatnonzero(np.any(np.diff(here, axis=0, prepend=here[:1] - 1) != 0, axis=1))
    until = np.append(changes, ego.n_frames)[1:] - 1
    every = (here[changes][:, None] + around).reshape(-1, 2)
    cell, index = np.unique(every, axis=0, return_inverse=True)
    index = index.reshape(-1)
    first = np.full(len(cell), ego.n_frames, dtype=np.int64)
    last = np.full(len(cell), -1, dtype=np.int64)
    np.minimum.at(first, index, np.repeat(changes, len(around)))
    np.maximum.at(last, index, np.repeat(until, len(around)))
    return cell, first, last


def effective_area(law: Clutter, max_range: float) -> tuple[FloatArray, FloatArray]:
    """Distances [m], from min_range to max_range, and the area [m2] around the sensor up to each,
    every part of it counted with sigmoid((reach - r) / reach_width)."""
    distance = np.linspace(law.min_range, max_range, _NODES)
    # Exact for the area of each ring; the weight is that of its middle.
    middle = (distance[1:] + distance[:-1]) / 2
    rings = np.pi * np.diff(distance**2) * nearness(law, middle)
    return distance, np.concatenate([[0.0], np.cumsum(rings)])


def nearness(law: Clutter, distance: FloatArray) -> FloatArray:
    """Weight (n,) of clutter at distances (n,) [m]: 1 near the sensor, 0 far away."""
    weight: FloatArray = expit((law.reach - distance) / law.reach_width)
    return weight


def _shapes(law: Clutter, n: int, rng: Generator) -> dict[str, FloatArray]:
    """Heights of the centres [m], headings [rad] and sizes [m] of n false boxes."""
    sizes = {
        name: np.maximum(rng.normal(of.mean, of.deviation, n), SMALLEST)
        for name, of in (("length", law.length), ("width", law.width), ("height", law.height))
    }
    return {"z": sizes["height"] / 2, "yaw": rng.uniform(-np.pi, np.pi, n), **sizes}


def _columns(
    frame: IntArray, boxes: Mapping[str, FloatArray], score: FloatArray
) -> Mapping[str, Any]:
    return {"frame": frame, **boxes, "score": score, "source": np.full(len(frame), CLUTTER)}
