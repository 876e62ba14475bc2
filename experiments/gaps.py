"""Gaps: in which frames which objects are hidden from the tracker."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl

from mdkf.tables import BoolArray, IntArray

Gap = tuple[int, int, int]
"""Object, first frame, first frame after it."""


@dataclass(frozen=True, eq=False)
class Gaps:
    """Where detections were removed, all (n,): object_id, and the frames start..stop-1 in which
    the object has none; an empty gap starts where it stops. A natural miss at its edge belongs to
    the gap. An object may have several, one after the other. `reappear`: whether the objects are
    detected again afterwards or never (late)."""

    object_id: IntArray
    start: IntArray
    stop: IntArray
    reappear: bool = True

    @classmethod
    def of(cls, rows: Sequence[Gap], reappear: bool = True) -> "Gaps":
        """Gaps of rows."""
        columns = np.array(rows, dtype=np.int64).reshape(-1, 3).T
        return cls(columns[0], columns[1], columns[2], reappear)

    def rows(self) -> list[Gap]:
        """One for each gap."""
        columns = (self.object_id, self.start, self.stop)
        return list(zip(*(column.tolist() for column in columns), strict=True))

    def to_polars(self) -> pl.DataFrame:
        """object_id, start and stop of each; `Gaps.of(frame.rows())` makes gaps of it again."""
        return pl.DataFrame({name: getattr(self, name) for name in ("object_id", "start", "stop")})

    def __len__(self) -> int:
        return len(self.object_id)

    def covers(self, object_id: IntArray, frame: IntArray) -> BoolArray:
        """Whether each (object, frame) lies in a gap."""
        inside = np.zeros(len(frame), dtype=np.bool_)
        rows = np.flatnonzero(np.isin(object_id, self.object_id))
        owner, when = object_id[rows], frame[rows]
        for identifier, start, stop in self.rows():
            inside[rows[(owner == identifier) & (when >= start) & (when < stop)]] = True
        return inside
