"""The occlusion protocol: remove consecutive detections of objects, keep the truth.

Paper, section "Simulated Occlusion Scenarios": an object is eligible when its n detections
satisfy n >= s_occ + l_occ; l_occ consecutive ones are removed after at least s_occ were observed,
from the middle of its trajectory (`mid`: it reappears) or from the end (`late`: it does not).

Beside the paper: gaps that begin at a given time from a true switch of motion (`switch`), several
gaps of one object, and the occlusions that are there by nature (`natural`), of which nothing has to
be removed.
"""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np

from experiments.gaps import Gap, Gaps
from experiments.natural import natural_occlusions
from experiments.regime_switches import regime_switches
from mdkf.tables import CLUTTER, Detections, IntArray, TableError, Trace, Tracks

Kind = Literal["mid", "late", "switch", "natural", "none"]

WARMUP = 35
"""s_occ of the paper: detections before a gap."""

LONGEST = 100_000
"""Frames, nearly three hours: what is longer is a mistake, and would silently give no gaps."""

PROVENANCE_KEY = "occlusion"

FORM = "KIND:LENGTH[:WARMUP][:gaps=N][:start=N]"
"""Of a protocol as text."""

_TEXT = re.compile(r"(\w+)((?::-?\d{1,9}){0,2})((?::\w+=-?\d{1,9})*)")
_NAMED = {"gaps": "n_gaps", "start": "start"}
"""Settings that follow the numbers in the text, by their names there."""


@dataclass(frozen=True)
class OcclusionProtocol:
    """Which detections to remove.

    kind: `mid`, `late`, `switch`, `natural` or `none`. length: l_occ, detections removed for each
    gap; with 0 the gaps are empty, nothing is removed, and errors are measured all the same: the
    beginning of a curve over lengths. warmup: s_occ, detections that come before, since the
    beginning or the gap before. start: of `switch`, frames from a switch to the first frame of the
    gap, negative before it. n_gaps: of `mid` and `switch`, the gaps of one object, as many of them
    as fit.

    Of `natural`, which takes every occlusion that is there, length is the frames of each that are
    measured, and warmup counts from the beginning.

    Raises `ValueError` for settings that the kind does not have, and impossible ones.
    """

    kind: Kind = "mid"
    length: int = 20
    warmup: int = WARMUP
    start: int = 0
    n_gaps: int = 1

    def __post_init__(self) -> None:
        if self.kind not in get_args(Kind):
            raise ValueError(f"occlusion {self.kind!r}, expected one of {get_args(Kind)}")
        least = 1 if self.kind == "natural" else 0
        if self.length < least or self.warmup < 1 or self.n_gaps < 1:
            raise ValueError(
                f"{self.kind} occlusion, {self.n_gaps} of {self.length} after {self.warmup}"
                f" detections, expected a length from {least} and other counts from 1 on"
            )
        if max(self.length, self.warmup, self.n_gaps, abs(self.start)) > LONGEST:
            raise ValueError(f"{self.kind} occlusion, expected numbers of at most {LONGEST}")
        if self.start != 0 and self.kind != "switch":
            raise ValueError(f"{self.kind} occlusion with a start, expected it of switch alone")
        if self.n_gaps > 1 and self.kind not in ("mid", "switch"):
            raise ValueError(
                f"{self.kind} occlusion with gaps, expected it of mid and switch alone"
            )

    @classmethod
    def parse(cls, text: str) -> "OcclusionProtocol":
        """From `mid:20`, `late:10`, `mid:20:35` (with the warm-up), `mid:20:35:gaps=3`,
        `switch:20:start=-5`, `natural:20:10` or `none`."""
        try:
            return cls(**_settings(text))
        except ValueError as error:
            raise ValueError(
                f"occlusion {text!r}, expected {FORM}, such as mid:20, late:10:35,"
                f" switch:20:start=-5, natural:20, or none: {error}"
            ) from None

    def __str__(self) -> str:
        if self.kind == "none":
            return "none"
        named = "".join(
            f":{name}={getattr(self, field)}"
            for name, field in _NAMED.items()
            if getattr(self, field) != getattr(type(self), field)
        )
        return f"{self.kind}:{self.length}:{self.warmup}{named}"

    def gaps(self, detections: Detections, trace: Trace | None = None) -> Gaps:
        """The gaps of all eligible objects, by object and frame.

        `mid` takes, of all places that leave `warmup` detections before and one after, the one
        nearest to the middle, and of several gaps those nearest to where they would part the
        detections evenly; where the frames allow it, one without a natural miss, so that the gap is
        exactly `length` frames long. `switch` takes of these places alone those whose gap begins in
        the frame that is `start` frames from a switch (`experiments.regime_switches`).

        trace: that the detections are of; `switch` and `natural` need it. Raises `ValueError`
        without it, and `TableError` where it knows no switches.
        """
        if self.kind == "none":
            return Gaps.of([])
        if self.kind == "natural":
            known = self._of(trace)
            road_users = np.unique(known.object_id[known.road_users()])
            return natural_occlusions(known, detections, road_users, self.warmup)
        begins = regime_switches(self._of(trace)) if self.kind == "switch" else {}
        found: list[Gap] = []
        for identifier in detections.ids().tolist():
            if identifier == CLUTTER:
                continue
            frames = detections.frame[detections.rows_of(identifier)]
            for first in self._first_removed(frames, begins.get(identifier)):
                last = first + self.length - 1
                reappears = frames[last] + 1 if self.kind == "late" else frames[last + 1]
                found.append((identifier, int(frames[first - 1]) + 1, int(reappears)))
        return Gaps.of(found, reappear=self.kind != "late")

    def _of(self, trace: Trace | None) -> Trace:
        if trace is None:
            raise ValueError(f"occlusion {self}: expected the trace of the detections")
        return trace

    def _first_removed(self, frames: IntArray, switches: IntArray | None) -> list[int]:
        """Index of the first detection to remove, for each gap of an object.

        frames (n,): of its detections; switches: first frames of its new regimes, None without.
        """
        spare = len(frames) - self.length
        if self.kind == "late":
            return [spare] if spare >= self.warmup else []
        if spare <= self.warmup:
            return []
        places = np.arange(self.warmup, spare)
        if self.kind == "switch":
            known = np.empty(0, dtype=np.int64) if switches is None else switches
            places = places[np.isin(frames[places - 1] + 1 - self.start, known)]
        bounds: list[int] = []  # the last place of each gap that leaves room for those after it
        left = places
        while len(left) and len(bounds) < self.n_gaps:
            bounds.insert(0, int(left[-1]))
            left = left[left <= bounds[0] - self.length - self.warmup]
        unbroken = frames[places + self.length] - frames[places - 1] == self.length + 1
        seen = len(frames) - len(bounds) * self.length
        found: list[int] = []
        for k, bound in enumerate(bounds):
            earliest = found[-1] + self.length + self.warmup if found else self.warmup
            free = (places >= earliest) & (places <= bound)
            if (free & unbroken).any():
                free &= unbroken
            even = k * self.length + (k + 1) * seen // (len(bounds) + 1)
            found.append(int(places[free][np.argmin(np.abs(places[free] - even))]))
        return found

    def apply(self, detections: Detections, trace: Trace | None = None) -> Detections:
        """The detections without those in the gaps; all others keep every number.

        The gaps are written into the provenance, from where they travel to tracks and scores.
        Raises as `gaps` does.
        """
        gaps = self.gaps(detections, trace)
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


def recorded_protocol(detections: Detections) -> str:
    """The protocol that was applied to detections; `TableError` as `recorded_gaps`."""
    return _told("detections", detections.provenance)[0]


def _settings(text: str) -> dict[str, Any]:
    """Of a protocol's text; raises `ValueError` with what is wrong with it."""
    parts = _TEXT.fullmatch(text)
    if parts is None:
        raise ValueError("not of that form")
    kind, numbers, named = parts.groups()
    settings: dict[str, Any] = {"kind": kind}
    settings |= zip(("length", "warmup"), map(int, numbers.split(":")[1:]), strict=False)
    for name, value in (one.split("=") for one in named.split(":")[1:]):
        if name not in _NAMED or _NAMED[name] in settings:
            raise ValueError(f"{name}={value} is unknown or there twice")
        settings[_NAMED[name]] = int(value)
    if kind == "none" and len(settings) > 1:
        raise ValueError("none has no settings")
    return settings


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
