"""A trace in numbers: objects by kind, shares of the regimes, natural occlusions by length."""

from collections import Counter
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from experiments.population import SCORED_RANGE, SCORED_VISIBLE
from mdkf.tables import KINDS, REGIMES, UNKNOWN_REGIME, BoolArray, Trace

LENGTHS = (5, 10, 20, 50)
"""Upper ends of the classes of an occlusion's length [frames]; longer ones are the last class."""


@dataclass(frozen=True)
class Description:
    """What a trace holds within the range in which truth counts.

    objects: how many by kind, standing ones among them; regimes: shares of the rows that are seen;
    turning: the share of those that turn; occlusions: how many by their length in frames. Who
    stands or turns is None where nobody knows: labels have no derivatives.
    """

    objects: dict[str, int]
    standing: int | None
    regimes: dict[str, float]
    turning: float | None
    occlusions: dict[str, int]


def describe(trace: Trace) -> Description:
    """Count the road users within 60 m of the sensor.

    An occlusion is an unbroken run of frames in which less than 15 % of an object is visible, while
    it was and will be seen better: what the sensor loses for a while, nobody having removed it.
    """
    near = trace.road_users() & (trace.sensor_distance() <= SCORED_RANGE)
    seen = near & (trace.visible >= SCORED_VISIBLE)
    ids, first = np.unique(trace.object_id[near], return_index=True)
    kinds = Counter(KINDS[k] for k in trace.kind[near][first].tolist())
    moving = np.unique(trace.object_id[near & (np.hypot(trace.vx, trace.vy) > 0)])
    codes = trace.regime[seen]
    known = bool((trace.regime[near] != UNKNOWN_REGIME).all())
    turning = float(trace.turning[seen].mean()) if len(codes) else 0.0
    return Description(
        objects={kind: kinds[kind] for kind in KINDS if kinds[kind]},
        standing=len(ids) - len(moving) if known else None,
        regimes={
            name: float((codes == code).mean()) if len(codes) else 0.0
            for code, name in enumerate(REGIMES)
            if (codes == code).any()
        },
        turning=turning if known else None,
        occlusions=_by_length(occlusion_lengths(trace, near, seen)),
    )


def occlusion_lengths(trace: Trace, near: BoolArray, seen: BoolArray) -> list[int]:
    """Lengths of all natural occlusions [frames], object by object.

    near, seen: rows within range, and those of them that are seen.
    """
    lengths: list[int] = []
    for identifier in np.unique(trace.object_id[near]):
        rows = trace.rows_of(int(identifier))
        hidden = near[rows] & ~seen[rows]
        # A frame in which the object is not there breaks a run as one out of range does.
        changed = np.diff(hidden, prepend=~hidden[:1])
        starts = np.flatnonzero(changed | (np.diff(trace.frame[rows], prepend=-2) > 1))
        for start, stop in pairwise([*starts, len(hidden)]):
            bounded = start > 0 and stop < len(hidden)
            if hidden[start] and bounded and seen[rows][start - 1] and seen[rows][stop]:
                lengths.append(int(stop - start))
    return lengths


def _by_length(lengths: list[int]) -> dict[str, int]:
    edges = (0, *LENGTHS)
    names = [f"{low + 1}-{high}" for low, high in pairwise(edges)]
    counts = dict.fromkeys([*names, f"over {LENGTHS[-1]}"], 0)
    for length in lengths:
        place = int(np.searchsorted(LENGTHS, length))
        counts[list(counts)[place]] += 1
    return counts
