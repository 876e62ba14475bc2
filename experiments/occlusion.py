"""The paper's occlusion protocol: remove consecutive detections of objects, keep the truth.

Paper, section "Simulated Occlusion Scenarios": an object is eligible when its n detections
satisfy n >= s_occ + l_occ; l_occ consecutive ones are removed after at least s_occ were observed,
from the middle of its trajectory (`mid`: it reappears) or from the end (`late`: it does not).
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from mdkf.tables import CLUTTER, BoolArray, Detections, IntArray, TableError, Tracks

Kind = Literal["mid", "late", "none"]

WARMUP = 35
"""s_occ of the paper: detections before a gap."""

PROVENANCE_KEY = "occlusion"

Gap = tuple[int, int, int]
"""Object, first frame, first frame after it."""


@dataclass(frozen=True, eq=False)
class Gaps:
    """Where detections were removed, all (n,): object_id, and the frames start..stop-1 in which
    the object has none. A natural miss at its edge belongs to the gap. `reappear`: whether the
    objects are detected again afterwards (mid) or never (late)."""

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


@dataclass(frozen=True)
class OcclusionProtocol:
    """Which detections to remove.

    kind: `mid`, `late` or `none`. length: l_occ, detections removed from each eligible object.
    warmup: s_occ, detections that come before.
    """

    kind: Kind = "mid"
    length: int = 20
    warmup: int = WARMUP

    def __post_init__(self) -> None:
        if self.kind not in get_args(Kind):
            raise ValueError(f"occlusion {self.kind!r}, expected one of {get_args(Kind)}")
        if self.length < 1 or self.warmup < 1:
            raise ValueError(
                f"occlusion of {self.length} after {self.warmup} detections, expected counts > 0"
            )

    @classmethod
    def parse(cls, text: str) -> "OcclusionProtocol":
        """From `mid:20`, `late:10`, `mid:20:35` (with the warm-up) or `none`."""
        kind, *numbers = text.split(":")
        try:
            if len(numbers) > 2 or (kind == "none" and numbers):
                raise ValueError
            return cls(kind, *(int(number) for number in numbers))  # type: ignore[arg-type]
        except ValueError:
            raise ValueError(
                f"occlusion {text!r}, expected KIND:LENGTH[:WARMUP], such as mid:20, late:10:35,"
                " or none"
            ) from None

    def __str__(self) -> str:
        return "none" if self.kind == "none" else f"{self.kind}:{self.length}:{self.warmup}"

    def gaps(self, detections: Detections) -> Gaps:
        """One gap for every eligible object, by object.

        `mid` takes, of all places that leave `warmup` detections before and one after, the one
        nearest to the middle; where the frames allow it, one without a natural miss, so that the
        gap is exactly `length` frames long.
        """
        found: list[Gap] = []
        for identifier in detections.ids() if self.kind != "none" else []:
            if identifier == CLUTTER:
                continue
            frames = detections.frame[detections.rows_of(int(identifier))]
            first = self._first_removed(frames)
            if first is not None:
                last = first + self.length - 1
                reappears = frames[last + 1] if self.kind == "mid" else frames[last] + 1
                found.append((int(identifier), int(frames[first - 1]) + 1, int(reappears)))
        return Gaps.of(found, reappear=self.kind == "mid")

    def _first_removed(self, frames: IntArray) -> int | None:
        """Index of the first detection to remove, None if the object is not eligible."""
        spare = len(frames) - self.length
        if self.kind == "late":
            return spare if spare >= self.warmup else None
        if spare < self.warmup + 1:
            return None
        places = np.arange(self.warmup, spare)
        span = frames[places + self.length] - frames[places - 1]
        unbroken = span == self.length + 1
        if unbroken.any():
            places = places[unbroken]
        return int(places[np.argmin(np.abs(places - spare // 2))])

    def apply(self, detections: Detections) -> Detections:
        """The detections without those in the gaps; all others keep every number.

        The gaps are written into the provenance, from where they travel to tracks and scores.
        """
        gaps = self.gaps(detections)
        kept = detections.take(~gaps.covers(detections.source, detections.frame))
        described = {
            "protocol": str(self),
            "gaps": gaps.rows(),
        }
        provenance = {**detections.provenance, PROVENANCE_KEY: json.dumps(described)}
        return replace(kept, provenance=provenance)


def recorded_gaps(table: Detections | Tracks, expected: OcclusionProtocol | None = None) -> Gaps:
    """The gaps that were applied to these detections, or to those behind these tracks.

    Raises `TableError` if the table tells of another protocol than the expected one, or of gaps
    that cannot be read.
    """
    name = type(table).__name__.lower()
    protocol, rows = _told(name, table.provenance)
    if expected is not None and str(expected) != protocol:
        raise TableError(f"the {name} come from occlusion {protocol}, expected {expected}")
    return Gaps(rows[:, 0], rows[:, 1], rows[:, 2], reappear=not protocol.startswith("late"))


def _told(name: str, provenance: Mapping[str, str]) -> tuple[str, IntArray]:
    """The protocol and its gaps, (n, 3)."""
    if PROVENANCE_KEY not in provenance:
        return "none", np.empty((0, 3), dtype=np.int64)
    text = provenance[PROVENANCE_KEY]
    try:
        told = json.loads(text)
        gaps = np.array([(o, a, b) for o, a, b in told["gaps"]], dtype=np.int64).reshape(-1, 3)
        return str(told["protocol"]), gaps
    except (ValueError, TypeError, KeyError, OverflowError):
        raise TableError(
            f"the {name}' provenance has occlusion {text!r}, expected a JSON object with the"
            " protocol and its gaps of (object, start, stop)"
        ) from None
