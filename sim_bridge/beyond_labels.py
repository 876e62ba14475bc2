"""Where labelled cars are before their first and after their last label.

People label what they make out in the picture; a LiDAR on the roof sees cars earlier, and longer.
So a detector reports boxes of cars that have no label yet, or any more. How often was measured on
the ten training sequences of KITTI's tracking data: of 374 cars whose labels begin in view, and 38
whose labels end there, three recorded detectors (pointrcnn, pvcnn, second_iou) have a box within
`GATE` of where the car would be t seconds beyond its label as often as their profiles say, times

    share exp(-t / TIME), share `BEFORE` the first label and `AFTER` the last,

the numbers being those under which their 6617 boxes within `LONGEST` are likeliest. Many lie where
KITTI says that nothing is labelled, and none of its scores counts them.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from mdkf.tables import CLUTTER, BoolArray, Detections, FloatArray, IntArray, Trace
from sim_bridge.frames import frames_of
from sim_bridge.kitti import GATE, in_view
from sim_bridge.line_of_sight import visible_fractions
from sim_bridge.overlap import meets_any
from sim_bridge.randomness import stream

BEFORE, AFTER = 0.85, 0.22
"""Shares of cars that are there just before their first and just after their last label."""
TIME = 2.8
"""Mean time for which they are [s]."""
LONGEST = 5.0
"""Time beyond a label in which a car is there at most [s]: no farther was measured."""
STANDING = 0.5
"""Speed below which a labelled car stands [m/s]: labels jump by some centimetres."""
LABELS = 10
"""Labels at an end of which the velocity there is taken: a second."""

_PLAN = ("x", "y", "yaw", "length", "width")


def has_labels(trace: Trace) -> bool:
    """Whether a trace's rows are people's labels: other traces hold all that is there."""
    return trace.provenance.get("kinematics") == "labels"


def with_unlabelled(trace: Trace, key: tuple[object, ...]) -> tuple[Trace, BoolArray]:
    """A trace of labels with its cars beyond their labels too, drawn by the law above, and which
    of its rows (rows,) are labels.

    key: of the random streams, of which every car has its own. A car goes on at the velocity that
    it has at its label's end, is never more visible than there, nor than by the line of sight past
    all other cars, and is there no more where it leaves the recording or the view, or would drive
    into another car.
    """

    def frames(identifier: int, side: int) -> int:
        rng = stream("beyond-labels", *key, identifier, side)
        there = rng.random() < (BEFORE if side < 0 else AFTER)
        time = min(rng.exponential(TIME), LONGEST)
        return int(time / trace.dt) if there else 0

    beyond = _beyond(trace, frames)
    columns = {
        name: np.concatenate([values, beyond[name]]) for name, values in trace.columns().items()
    }
    labelled: BoolArray = np.lexsort((columns["object_id"], columns["frame"])) < len(trace)
    joined = Trace.from_columns(
        columns, n_frames=trace.n_frames, dt=trace.dt, ego=trace.ego, provenance=trace.provenance
    )
    by_sight = np.minimum(joined.visible, visible_fractions(*frames_of(joined)))
    return replace(joined, visible=np.where(labelled, joined.visible, by_sight)), labelled


def of_unlabelled(trace: Trace, detections: Detections) -> BoolArray:
    """Which clutter (detections,) is where a car of a trace of labels would be within `LONGEST` of
    its labels: most likely that car's."""
    beyond = _beyond(trace, lambda identifier, side: int(LONGEST / trace.dt))
    found: BoolArray = np.equal(detections.source, CLUTTER)
    for k in range(trace.n_frames):
        cars, mine = beyond["frame"] == k, detections.frame_rows(k)
        dx = detections.x[mine][:, None] - beyond["x"][cars]
        dy = detections.y[mine][:, None] - beyond["y"][cars]
        found[mine] &= (np.hypot(dx, dy) < GATE).any(axis=1)
    return found


def _beyond(trace: Trace, frames: Callable[[int, int], int]) -> dict[str, Any]:
    """Columns of a trace's cars beyond their labels, each for `frames(object_id, side)` at most,
    before the first label (side -1) and after the last (1)."""
    taken_frame, taken = trace.frame, np.column_stack([getattr(trace, name) for name in _PLAN])
    ends, frame, place = [np.empty(0, dtype=np.int64)], [trace.frame[:0]], [taken[:0, :2]]
    for identifier in trace.ids():
        rows = trace.rows_of(int(identifier))
        for row, near, side in ((rows[0], rows[:LABELS], -1), (rows[-1], rows[-LABELS:], 1)):
            here = trace.frame[row] + side * np.arange(1, 1 + frames(int(identifier), side))
            here = here[(here >= 0) & (here < trace.n_frames)]
            boxes = np.tile(taken[row], (len(here), 1))
            boxes[:, :2] += np.outer((here - trace.frame[row]) * trace.dt, _velocity(trace, near))
            there = _seen(trace, here, boxes) & ~meets_any(here, boxes, taken_frame, taken)
            there = np.logical_and.accumulate(there)
            ends.append(np.full(int(there.sum()), row))
            frame.append(here[there])
            place.append(boxes[there, :2])
            taken_frame = np.concatenate([taken_frame, here[there]])
            taken = np.concatenate([taken, boxes[there]])
    row = np.concatenate(ends)
    columns = {name: values[row] for name, values in trace.columns().items()}
    x, y = np.concatenate(place).T
    return columns | {"frame": np.concatenate(frame), "x": x, "y": y}


def _velocity(trace: Trace, rows: IntArray) -> FloatArray:
    """Velocity (2,) [m/s] of the straight line through an object's places in some rows."""
    time = trace.frame[rows] * trace.dt
    time = time - time.mean()
    place = np.column_stack([trace.x[rows], trace.y[rows]])
    velocity: FloatArray = time @ place / max(float(time @ time), trace.dt**2)
    return velocity if np.hypot(*velocity) >= STANDING else np.zeros(2)


def _seen(trace: Trace, frame: IntArray, boxes: FloatArray) -> BoolArray:
    """Whether boxes (n, 5) are in view, and farther than their own length: a sensor within a box
    sees nothing of it."""
    x, y, length = boxes[:, 0], boxes[:, 1], boxes[:, 3]
    away = np.hypot(x - trace.ego.x[frame], y - trace.ego.y[frame])
    return in_view(trace.ego, frame, x, y) & (away > length)
