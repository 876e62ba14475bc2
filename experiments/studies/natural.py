"""A trace and its detections into natural occlusions (`experiments.natural`) of cars: those that
traffic hides from the sensor, and those that leave its view, hidden in most of the frames after
their last detection.
"""

from dataclasses import replace

import numpy as np

from experiments.gaps import Gap, Gaps
from experiments.natural import mostly_hidden, natural_occlusions, sightings
from mdkf.tables import KINDS, Detections, FloatArray, IntArray, Trace

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
    return natural_occlusions(trace, detections, _cars(trace), WARMUP)


def leaving_gaps(trace: Trace, detections: Detections) -> Gaps:
    """The first `LEFT` frames after the last detection of a car that was detected at least `WARMUP`
    times and moves as they begin; nobody sees it again."""
    found = []
    for car, rows, hidden, seen in sightings(trace, detections, _cars(trace)):
        first = int(seen[-1]) + 1 if len(seen) >= WARMUP else trace.n_frames
        own = (trace.frame[rows] >= first) & (trace.frame[rows] < first + LEFT)
        if (
            own.sum() == LEFT
            and mostly_hidden(hidden[own])
            and _speed(trace, rows[own])[0] >= MOVING
        ):
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


def _cars(trace: Trace) -> IntArray:
    """The ids of the cars, ascending."""
    return np.unique(trace.object_id[trace.kind == KINDS.index("car")])


def _speed(trace: Trace, rows: IntArray) -> FloatArray:
    """Of each row [m/s]."""
    speed: FloatArray = np.hypot(trace.vx[rows], trace.vy[rows])
    return speed
