"""What a tracker tells of each frame: rows that become a `Tracks` table."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mdkf.batch import N_MOMENTS
from mdkf.compiled import inlined
from mdkf.life_cycle import BOX, YAW, Book
from mdkf.settings import TrackerSettings
from mdkf.tables import BoolArray, Detections, FloatArray, IntArray, Tracks

VALUES = ("x", "y", "vx", "vy", "cov_xx", "cov_xy", "cov_yy", *BOX)
"""Columns of a report, of which the first are `mdkf.batch.Moments`; the estimator's
diagnostics follow."""


class Report(NamedTuple):
    """Rows of estimates: frame, track_id, coasted, confirmed (at that time), each (r,), and values
    (columns, r); filled (1,): rows in use."""

    frame: IntArray
    track_id: IntArray
    coasted: BoolArray
    confirmed: BoolArray
    values: FloatArray
    filled: IntArray

    @classmethod
    def empty(cls, rows: int, diagnostics: int) -> "Report":
        """A report of no rows yet, with room for `rows`, and for so many diagnostics."""
        numbers, flags = np.empty((2, rows), dtype=np.int64), np.empty((2, rows), dtype=np.bool_)
        values = np.empty((len(VALUES) + diagnostics, rows))
        none = np.zeros(1, dtype=np.int64)
        return cls(numbers[0], numbers[1], flags[0], flags[1], values, none)


@inlined
def write(book: Book, k: int, measured: bool, report: Report) -> None:
    """A row for each live track in frame k, from the moments in the book; measured: a position
    that was seen is told as it was measured.

    A track looks where most of its detections did: one that looks backwards does not turn it.
    """
    first = report.filled[0]
    for i in range(book.totals[0]):
        row, slot = first + i, book.place[i]
        seen = book.missed[slot] == 0
        report.frame[row], report.track_id[row] = k, book.track_id[slot]
        report.coasted[row], report.confirmed[row] = not seen, book.confirmed[slot]
        for column in range(N_MOMENTS):
            report.values[column, row] = book.moments[i, column]
        for column in range(len(BOX)):
            report.values[N_MOMENTS + column, row] = book.box[slot, column]
        if seen and measured:
            report.values[0, row] = book.measured[slot, 0]
            report.values[1, row] = book.measured[slot, 1]
        elif book.sense[slot] < 0:
            yaw = book.box[slot, YAW]
            report.values[N_MOMENTS + YAW, row] = yaw - np.pi if yaw > 0.0 else yaw + np.pi
    report.filled[0] = first + book.totals[0]


def table(
    reports: Sequence[Report],
    diagnostics: Sequence[str],
    settings: TrackerSettings,
    detections: Detections,
    estimator: str,
) -> Tracks:
    """The tracks that the settings report, of the frames of the detections."""
    frame, track_id, coasted, told, values = (
        np.concatenate([part[k][..., : part.filled[0]] for part in reports], axis=-1)
        for k in range(5)
    )
    if settings.confirmation == "retrospective":
        ever = np.zeros(int(track_id.max(initial=-1)) + 1, dtype=np.bool_)
        ever[track_id[told]] = True
        told = ever[track_id]
    if not settings.coasting:
        told &= ~coasted
    columns = dict(zip((*VALUES, *diagnostics), values[:, told], strict=True))
    own = {name: columns.pop(name) for name in diagnostics}
    return Tracks.from_columns(
        {"frame": frame[told], "track_id": track_id[told], "coasted": coasted[told], **columns},
        n_frames=detections.n_frames,
        dt=detections.dt,
        provenance={
            **detections.provenance,
            "estimator": estimator,
            "settings": repr(settings),
            "position": settings.position,
        },
        diagnostics=own,
    )
