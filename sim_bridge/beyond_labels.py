"""Where labelled cars are before their first and after their last label.

People label what they make out in the picture; a LiDAR on the roof sees cars earlier, and longer.
So a detector reports boxes of cars that have no label yet, or any more. How often was measured on
the ten training sequences of KITTI's tracking data: of 328 cars whose labels begin in view, and 31
whose labels end there, three recorded detectors (pointrcnn, pvcnn, second_iou) have a box within
`GATE` of where the car would be t seconds beyond its label as often as their profiles say, times

    share exp(-t / TIME), share `BEFORE` the first label and `AFTER` the last,

the numbers being those under which their 7074 boxes within `LONGEST` are likeliest. Many lie where
KITTI says that nothing is labelled, and none of its scores counts them.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from mdkf.tables import CLUTTER, BoolArray, Detections, FloatArray, IntArray, Trace
from sim_bridge.frames import frames_of
from sim_bridge.kitti import GATE, VIEW
from sim_bridge.line_of_sight import visible_fractions
from sim_bridge.randomness import stream

BEFORE, AFTER = 0.82, 0.22
"""Shares of cars that are there just before their first and just after their last label."""
TIME = 3.4
"""Mean time for which they are [s]."""
LONGEST = 5.0
"""Time beyond a label in which a car is there at most [s]: no farther was measured."""
STANDING = 0.5
"""Speed below which a labelled car stands [m/s]: labels jump by some centimetres."""
LABELS = 10
"""Labels at an end of which the velocity there is taken: a second."""


def has_labels(trace: Trace) -> bool:
    """Whether a trace's rows are people's labels: other traces hold all that is there."""
    return trace.provenance.get("kinematics") == "labels"


def with_unlabelled(trace: Trace, key: tuple[object, ...]) -> tuple[Trace, BoolArray]:
    """A trace of labels with its cars beyond their labels too, drawn by the law above, and which
    of its rows (rows,) are labels.

    key: of the random streams, of which every car has its own. A car goes on at the velocity that
    it has at its label's end, is never more visible than there, nor than by the line of sight past
    all other cars, and is there no more where it leaves the recording or the view.
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
    ends, frame, shift = [], [], []
    for identifier in trace.ids():
        rows = trace.rows_of(int(identifier))
        for row, near, side in ((rows[0], rows[:LABELS], -1), (rows[-1], rows[-LABELS:], 1)):
            here = trace.frame[row] + side * np.arange(1, 1 + frames(int(identifier), side))
            here = here[(here >= 0) & (here < trace.n_frames)]
            place = np.column_stack([trace.x, trace.y])[row]
            moved = np.outer((here - trace.frame[row]) * trace.dt, _velocity(trace, near))
            in_view = np.logical_and.accumulate(_in_view(trace, here, place + moved, int(row)))
            ends.append(np.full(int(in_view.sum()), row))
            frame.append(here[in_view])
            shift.append(moved[in_view])
    row = np.concatenate([np.empty(0, dtype=np.int64), *ends])
    columns = {name: values[row] for name, values in trace.columns().items()}
    dx, dy = np.concatenate([np.empty((0, 2)), *shift]).T
    columns |= {"frame": np.concatenate([np.empty(0, dtype=np.int64), *frame])}
    return columns | {"x": columns["x"] + dx, "y": columns["y"] + dy}


def _velocity(trace: Trace, rows: IntArray) -> FloatArray:
    """Velocity (2,) [m/s] of the straight line through an object's places in some rows."""
    time = trace.frame[rows] * trace.dt
    time = time - time.mean()
    place = np.column_stack([trace.x[rows], trace.y[rows]])
    velocity: FloatArray = time @ place / max(float(time @ time), trace.dt**2)
    return velocity if np.hypot(*velocity) >= STANDING else np.zeros(2)


def _in_view(trace: Trace, frame: IntArray, place: FloatArray, row: int) -> BoolArray:
    """Whether the object of a row would be in the picture's direction at places (n, 2) [m], and
    farther than its own length: a sensor within its box sees nothing of it."""
    ego = trace.ego
    dx, dy = place[:, 0] - ego.x[frame], place[:, 1] - ego.y[frame]
    bearing = np.angle(np.exp(1j * (np.arctan2(dy, dx) - ego.yaw[frame])))
    in_view: BoolArray = (np.abs(bearing) < VIEW / 2) & (np.hypot(dx, dy) > trace.length[row])
    return in_view
