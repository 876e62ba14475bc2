"""A trace and its detections into natural occlusions: cars that traffic hides from the sensor, and
cars that leave its view. Nothing is removed, the detector misses by itself what it cannot see.

A gap is the frames between two detections of a car, or after its last one, in most of which it is
hidden: in range, and less visible than what counts (`experiments.population`). In the others it was
missed, mostly at the edges, as the detector misses what is half hidden.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from experiments.occlusion import Gap, Gaps
from experiments.population import naturally_occluded
from mdkf.tables import KINDS, BoolArray, Detections, FloatArray, IntArray, Trace

SHORTEST = 4
"""Frames in which a car is hidden, at least: the paper's picture of a stationary car is of four."""
WARMUP = 10
"""Detections of a car before its gap."""
HORIZON = 20
"""First frames of a gap that are measured: as long as the paper's longest."""
LEFT = 10
"""Frames after a leaving car's last detection that are measured: a second at 10 Hz."""
STEADY = 12
"""Detections in a row that MD's longest window is formed of; it starts anew after a miss."""
MOVING = 1.0
"""Speed as a gap begins from which a car moves [m/s]; slower ones creep in a queue."""


def natural_gaps(trace: Trace, detections: Detections) -> Gaps:
    """The gaps between two detections of a car that was detected at least `WARMUP` times before."""
    found = []
    for car, rows, hidden, seen in _cars(trace, detections):
        for k in np.flatnonzero(np.diff(seen) > SHORTEST):
            own = (trace.frame[rows] > seen[k]) & (trace.frame[rows] < seen[k + 1])
            all_there = own.sum() == seen[k + 1] - seen[k] - 1
            if k + 1 >= WARMUP and all_there and _mostly(hidden[own]):
                found.append((car, int(seen[k]) + 1, int(seen[k + 1])))
    return Gaps.of(found)


def leaving_gaps(trace: Trace, detections: Detections) -> Gaps:
    """The first `LEFT` frames after the last detection of a car that was detected at least `WARMUP`
    times and moves as they begin; nobody sees it again."""
    found = []
    for car, rows, hidden, seen in _cars(trace, detections):
        first = int(seen[-1]) + 1 if len(seen) >= WARMUP else trace.n_frames
        own = (trace.frame[rows] >= first) & (trace.frame[rows] < first + LEFT)
        if own.sum() == LEFT and _mostly(hidden[own]) and _speed(trace, rows[own])[0] >= MOVING:
            found.append((car, first, first + LEFT))
    return Gaps.of(found, reappear=False)


def populations(trace: Trace, detections: Detections, gaps: Gaps) -> dict[str, list[Gap]]:
    """Gaps between two detections by what the car does; one may be in several, or in none.

    standing: since `WARMUP` detections before the gap, and as long as the gap is measured. moving:
    as the gap begins. parked: from the first frame of the trace to the last.
    """
    found: dict[str, list[Gap]] = {"standing": [], "moving": [], "parked": []}
    for car, start, stop in gaps.rows():
        rows, seen = trace.rows_of(car), detections.frame[detections.rows_of(car)]
        frame, speed = trace.frame[rows], _speed(trace, rows)
        since = seen[seen < start][-WARMUP]
        if not speed[(frame >= since) & (frame < min(stop, start + HORIZON))].any():
            found["standing"].append((car, start, stop))
        if speed[frame == start].item() >= MOVING:
            found["moving"].append((car, start, stop))
        if len(rows) == trace.n_frames and not speed.any():
            found["parked"].append((car, start, stop))
    return found


def steady(detections: Detections, gap: Gap) -> bool:
    """Whether the object was detected in each of the last `STEADY` frames before its gap."""
    car, start, _ = gap
    seen = detections.frame[detections.rows_of(car)]
    return int(((seen >= start - STEADY) & (seen < start)).sum()) == STEADY


def measured(gaps: Gaps) -> Gaps:
    """The gaps cut to their first `HORIZON` frames."""
    return replace(gaps, stop=np.minimum(gaps.stop, gaps.start + HORIZON))


def _cars(
    trace: Trace, detections: Detections
) -> Iterator[tuple[int, IntArray, BoolArray, IntArray]]:
    """Of each car: its id, its rows, whether it is hidden in each, the frames it is detected in."""
    hidden = naturally_occluded(trace, Gaps.of([]))
    for car in np.unique(trace.object_id[trace.kind == KINDS.index("car")]).tolist():
        rows = trace.rows_of(car)
        yield car, rows, hidden[rows], detections.frame[detections.rows_of(car)]


def _mostly(hidden: BoolArray) -> bool:
    """Whether frames are a gap, by whether the car is hidden in each."""
    count = int(hidden.sum())
    return count >= SHORTEST and 2 * count > len(hidden)


def _speed(trace: Trace, rows: IntArray) -> FloatArray:
    """Of each row [m/s]."""
    speed: FloatArray = np.hypot(trace.vx[rows], trace.vy[rows])
    return speed
