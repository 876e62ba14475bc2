"""What a sensor model is given: a sensor and boxes, frame by frame."""

import numpy as np
from numpy.typing import ArrayLike

from mdkf.tables import FloatArray, IntArray, Trace

BOX = ("x", "y", "z", "yaw", "length", "width", "height")
"""Columns of a box: its centre [m], yaw [rad] and size [m]."""


def frames_of(trace: Trace) -> tuple[FloatArray, IntArray, FloatArray]:
    """Sensor (n_frames, 3), offsets (n_frames + 1,) and boxes (rows, 7) of a trace."""
    ego = trace.ego
    boxes = np.column_stack([getattr(trace, name) for name in BOX])
    return np.column_stack([ego.x, ego.y, ego.z]), trace.frame_start, boxes


def checked_frames(
    sensor: ArrayLike, frame_start: ArrayLike, boxes: ArrayLike
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Sensor (n_frames, 3), offsets (n_frames + 1,) and boxes (rows, 7), contiguous.

    Raises `ValueError` for wrong shapes, offsets that do not cover the rows in order, values that
    are not finite and sizes that are not positive.
    """
    positions = np.ascontiguousarray(sensor, dtype=np.float64)
    if positions.ndim != 2 or positions.shape[1] != 3:
        raise ValueError(f"sensor: expected shape (n_frames, 3), got {positions.shape}")
    wrong = ~np.isfinite(positions).all(axis=1)
    if wrong.any():
        frame = int(np.argmax(wrong))
        raise ValueError(f"sensor: frame {frame} is not finite: {positions[frame].tolist()}")
    table = checked_boxes(boxes)
    offsets = np.asarray(frame_start)
    if (
        offsets.shape != (len(positions) + 1,)
        or offsets.dtype.kind not in "iu"
        or (offsets[0], offsets[-1]) != (0, len(table))
        or np.any(offsets[1:] < offsets[:-1])
    ):
        raise ValueError(
            f"frame_start: expected {len(positions) + 1} integer offsets rising from 0 to "
            f"{len(table)} rows, got {offsets.tolist()}"
        )
    return positions, offsets.astype(np.int64), table


def checked_boxes(boxes: ArrayLike) -> FloatArray:
    """Boxes (n, 7) as a contiguous table; `ValueError` names the row that is no box."""
    table = np.ascontiguousarray(boxes, dtype=np.float64)
    if table.size == 0 and table.ndim <= 2:
        table = table.reshape(0, len(BOX))
    if table.ndim != 2 or table.shape[1] != len(BOX):
        raise ValueError(f"boxes: expected shape (n, {len(BOX)}), got {table.shape}")
    for wrong, what in (
        (~np.isfinite(table).all(axis=1), "a value that is not finite"),
        ((table[:, 4:] <= 0.0).any(axis=1), "a length, width or height that is not positive"),
    ):
        if wrong.any():
            row = int(np.argmax(wrong))
            raise ValueError(f"boxes: row {row} has {what}: {table[row].tolist()}")
    return table
