"""Kernels compiled before they are needed, on the smallest inputs that reach them.

Compiled kernels are cached on disk; with a warm cache these functions cost milliseconds.
"""

from collections.abc import Sequence

import numpy as np

from experiments.metrics import clear, hota, identity, sequence_from_rows
from experiments.states import gospa
from mdkf import Detections, Tracker, estimator, filter_sequence
from mdkf.tables import FloatArray, IntArray
from sim_bridge.kinematics import smooth_motion
from sim_bridge.line_of_sight import visible_fractions
from sim_bridge.overlap import first_overlap


def compile_sensing() -> None:
    """What simulating a world needs: smooth motion, line of sight, overlap."""
    smooth_motion(0, np.arange(14.0).reshape(7, 2), np.zeros(7), 4.5, 10)
    visible_fractions([[0.0, 0.0, 1.7]], [0, 1], [[10.0, 0.0, 0.75, 0.0, 4.5, 1.8, 1.5]])
    first_overlap(np.array([0, 1]), np.array([[0.0, 0.0, 0.0, 4.5, 1.8]]))


def compile_tracking(filters: Sequence[str]) -> None:
    """What tracking with these filters and scoring needs."""
    frames = np.repeat(np.arange(3), 2)
    columns: dict[str, FloatArray | IntArray] = dict.fromkeys(Detections.column_types(), np.ones(6))
    columns |= {"frame": frames, "source": np.tile([0, 1], 3), "x": np.tile([0.0, 9.0], 3)}
    seen = Detections.from_columns(columns, n_frames=3, dt=0.1)
    for name in filters:
        Tracker(estimator(name)).run(seen)
        filter_sequence(estimator(name), np.ones((1, 1, 2)), np.eye(2), 0.1)
    rows = (frames, seen.source, np.column_stack([seen.x, seen.y]))
    sequence = sequence_from_rows(*rows, *rows, n_frames=3)
    for metric in (hota, clear, identity):
        metric(sequence)
    gospa(*rows[::2], *rows[::2], n_frames=3)
