"""Truth and tracks into bins: by phase, regime, range and level, and by several at once.

phase   where in an occlusion: before, in (also by frames since it began) and after a protocol's
        gap, in a natural occlusion, or in view
regime  the object's true motion, and whether it turns
range   ground distance from the sensor in that frame: 0-30, 30-50 and 50+ m (as far as truth
        counts at all)
level   how hard it is to see, as Waymo's two levels; the definition is ours (no point counts in a
        trace): LEVEL_1 at least half visible, LEVEL_2 all that counts, LEVEL_1 included

A truth row belongs to a bin, and with it the track that is on it. A track on nothing belongs to the
bin of its own range and to both levels; of its phase or regime nobody can say.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import reduce
from itertools import product
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from experiments.gaps import Gaps
from experiments.phases import WINDOW
from experiments.population import naturally_occluded
from mdkf.tables import REGIMES, UNKNOWN_REGIME, BoolArray, IntArray, Trace, Tracks

RANGES = (("0-30 m", 0.0, 30.0), ("30-50 m", 30.0, 50.0), ("50+ m", 50.0, np.inf))
"""Name, nearest (inclusive) and farthest (exclusive) distance from the sensor [m], as Waymo's."""

LEVEL_1_VISIBLE = 0.5
"""Visible fraction from which truth is of LEVEL_1."""

OFFSETS = ((1, 5), (6, 10), (11, 20), (21, 40), (41, None))
"""First and last frame of a part of a gap, counted from 1 in the gap's first frame."""

EVERYTHING = "all"
"""The bin of all rows, and its group."""


@dataclass(frozen=True, eq=False)
class Bin:
    """Rows of the truth, (n_truth_rows,), and the tracks' rows, (n_track_rows,), that are false in
    it where they are on nothing; None: no such track can be told to belong here.

    required: whether tracks must be on the truth; in a natural occlusion they need not.
    """

    name: str
    truth: BoolArray
    false: BoolArray | None
    required: bool = True

    def __and__(self, other: "Bin") -> "Bin":
        false = None if self.false is None or other.false is None else self.false & other.false
        both = self.truth & other.truth
        return Bin(f"{self.name}, {other.name}", both, false, self.required and other.required)


def everything(trace: Trace, tracks: Tracks) -> Bin:
    """The bin of all rows."""
    return Bin(
        EVERYTHING, np.ones(len(trace), dtype=np.bool_), np.ones(len(tracks), dtype=np.bool_)
    )


def bins(trace: Trace, tracks: Tracks, gaps: Gaps, group: str) -> list[Bin]:
    """The bins of a group, or the products of several groups' bins, as of `range,level`.

    Raises `ValueError` as `check_group` does.
    """
    check_group(group)
    several = (GROUPS[name](trace, tracks, gaps) for name in group.split(","))
    return [reduce(Bin.__and__, chosen) for chosen in product(*several)]


def check_group(group: str) -> None:
    """Raise `ValueError` for unknown groups, and for one that is named twice."""
    names = group.split(",")
    if set(names) - set(GROUPS) or len(set(names)) < len(names):
        raise ValueError(f"breakdown by {group!r}, expected different ones of {', '.join(GROUPS)}")


def _phases(trace: Trace, tracks: Tracks, gaps: Gaps) -> list[Bin]:
    place = around_gaps(trace, gaps)
    natural = naturally_occluded(trace, gaps)
    found = [("in view", (place.phase == "") & ~natural), ("before", place.phase == "before")]
    found.append(("gap", place.phase == "gap"))
    for first, last in OFFSETS:
        name = f"gap {first}+" if last is None else f"gap {first}-{last}"
        within = (place.nth >= first) & (place.nth <= (np.inf if last is None else last))
        found.append((name, within))
    found.append(("after", place.phase == "after"))
    return [*(Bin(*one, None) for one in found), Bin("occluded", natural, None, required=False)]


class Around(NamedTuple):
    """Of every truth row the phase, "" away from gaps, and in a gap which of its frames it is,
    counted from 1, else 0."""

    phase: NDArray[np.str_]
    nth: IntArray


def around_gaps(trace: Trace, gaps: Gaps) -> Around:
    """Where in the gaps, and around them, every truth row is: between two gaps of an object after
    the first one, if it has just ended, rather than before the second."""
    around = Around(np.full(len(trace), "", dtype="<U6"), np.zeros(len(trace), dtype=np.int64))
    for identifier, start, stop in gaps.rows():
        rows = trace.rows_of(identifier)
        frame = trace.frame[rows]
        end = stop + WINDOW if gaps.reappear else stop
        before = rows[(frame >= start - WINDOW) & (frame < start)]
        around.phase[before[around.phase[before] != "after"]] = "before"
        around.phase[rows[(frame >= stop) & (frame < end)]] = "after"
        own = rows[(frame >= start) & (frame < stop)]
        around.nth[own] = trace.frame[own] - start + 1
    # Last, as what is before or after one gap of an object may lie in another.
    around.phase[around.nth > 0] = "gap"
    return around


def _regimes(trace: Trace, tracks: Tracks, gaps: Gaps) -> list[Bin]:
    known = trace.regime != UNKNOWN_REGIME
    found = [(name.replace("_", " "), trace.regime == k) for k, name in enumerate(REGIMES)]
    found += [("turning", known & trace.turning), ("not turning", known & ~trace.turning)]
    return [Bin(name, rows, None) for name, rows in found]


def _ranges(trace: Trace, tracks: Tracks, gaps: Gaps) -> list[Bin]:
    distance = trace.sensor_distance()
    ego = trace.ego
    away = np.hypot(tracks.x - ego.x[tracks.frame], tracks.y - ego.y[tracks.frame])
    return [
        Bin(name, (distance >= near) & (distance < far), (away >= near) & (away < far))
        for name, near, far in RANGES
    ]


def _levels(trace: Trace, tracks: Tracks, gaps: Gaps) -> list[Bin]:
    everywhere = np.ones(len(tracks), dtype=np.bool_)
    easy = trace.visible >= LEVEL_1_VISIBLE
    return [Bin("LEVEL_1", easy, everywhere), Bin("LEVEL_2", np.ones_like(easy), everywhere)]


GROUPS: Mapping[str, Callable[[Trace, Tracks, Gaps], list[Bin]]] = MappingProxyType(
    {"phase": _phases, "regime": _regimes, "range": _ranges, "level": _levels}
)
"""The bins by name of their group."""
