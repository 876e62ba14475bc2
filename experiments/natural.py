"""A trace and its detections into natural occlusions: the frames between two detections of an
object in most of which it is hidden.

Nothing is removed, the detector misses by itself what it cannot see. Hidden is in range, and less
visible than what counts (`experiments.population`). In the others of its frames the object was
missed, mostly at the edges, as the detector misses what is half hidden.
"""

from collections.abc import Iterator

import numpy as np

from experiments.gaps import Gaps
from experiments.population import naturally_occluded
from mdkf.tables import BoolArray, Detections, IntArray, Trace

SHORTEST = 4
"""Frames in which an object is hidden, at least: the paper's picture of a stationary car is of
four."""


def natural_occlusions(
    trace: Trace, detections: Detections, objects: IntArray, warmup: int
) -> Gaps:
    """The gaps between two detections of some of the objects that were detected at least `warmup`
    times before, by object and frame."""
    found = []
    for own, rows, hidden, seen in sightings(trace, detections, objects):
        for k in np.flatnonzero(np.diff(seen) > SHORTEST):
            inside = (trace.frame[rows] > seen[k]) & (trace.frame[rows] < seen[k + 1])
            all_there = inside.sum() == seen[k + 1] - seen[k] - 1
            if k + 1 >= warmup and all_there and mostly_hidden(hidden[inside]):
                found.append((own, int(seen[k]) + 1, int(seen[k + 1])))
    return Gaps.of(found)


def sightings(
    trace: Trace, detections: Detections, objects: IntArray
) -> Iterator[tuple[int, IntArray, BoolArray, IntArray]]:
    """Of each object: its id, its rows, whether it is hidden in each, the frames it is detected
    in."""
    hidden = naturally_occluded(trace, Gaps.of([]))
    for own in objects.tolist():
        rows = trace.rows_of(own)
        yield own, rows, hidden[rows], detections.frame[detections.rows_of(own)]


def mostly_hidden(hidden: BoolArray) -> bool:
    """Whether frames are a gap, by whether the object is hidden in each."""
    count = int(hidden.sum())
    return count >= SHORTEST and 2 * count > len(hidden)
