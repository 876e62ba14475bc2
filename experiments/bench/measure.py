"""Things to be timed into CPU times per unit of work, interleaved so that they can be compared.

A round runs every case once, in an order drawn anew; the machine may be slow in one round and
fast in the next, and a ratio of two cases is formed round by round. Only CPU time is counted.
"""

import gc
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from mdkf.tables import FloatArray

LOW, HIGH = 10, 90
"""Percentiles over rounds that tell the spread."""
SEED = 0
"""Of the order of the cases."""

Clock = Callable[[], float]
Samples = Mapping["Case", FloatArray]
"""Seconds per unit of work of each case, (rounds,)."""


@dataclass(frozen=True, eq=False)
class Case:
    """One thing to be timed.

    what, name, tier, size: which row of the results it is.
    work: units of work in one run. unit, per_second: what a unit's time is told in.
    prepare: makes the argument of `run`, anew for each run and off the clock.
    run: the work; returns what it computed.
    """

    what: str
    name: str
    tier: str
    size: int
    work: float
    unit: str
    per_second: float
    prepare: Callable[[], Any]
    run: Callable[[Any], Any]


@dataclass(frozen=True, eq=False)
class Block:
    """Cases that are run close to each other, because they are compared.

    anchor: what their `ratio` refers to; run with the block, and no row unless it is in `cases`.
    ratios: pairs whose ratio of costs, first over second, is a row of its own.
    """

    cases: tuple[Case, ...]
    anchor: Case | None = None
    ratios: tuple[tuple[Case, Case], ...] = ()

    def timed(self) -> tuple[Case, ...]:
        """All cases, the anchor too."""
        return tuple(dict.fromkeys((*self.cases, *((self.anchor,) if self.anchor else ()))))


class Summary(NamedTuple):
    """Median over rounds and the percentiles `LOW` and `HIGH`."""

    median: float
    low: float
    high: float


def measure(
    blocks: Sequence[Block],
    rounds: int,
    shortest: float,
    clock: Clock = time.process_time,
    progress: Callable[[float], None] = lambda done: None,
) -> Samples:
    """Times of all cases in each round.

    A measurement repeats the run until it lasts about `shortest` [s], not at all if that is 0; a
    first run of each case is not counted. progress is told after each block how much is done,
    from 0 to 1.
    """
    random = np.random.default_rng(SEED)
    times = {case: np.empty(rounds) for block in blocks for case in block.timed()}
    runs: dict[Case, int] = {}
    collecting = gc.isenabled()
    gc.disable()
    try:
        for k in range(-1, rounds):
            for place, block in enumerate(random.permutation(len(blocks))):
                cases = blocks[block].timed()
                for at in random.permutation(len(cases)):
                    case = cases[at]
                    if k < 0:
                        runs[case] = _calibrate(case, shortest, clock)
                    else:
                        times[case][k] = _seconds(case, runs[case], clock) / case.work
                progress((k + 1 + (place + 1) / len(blocks)) / (rounds + 1))
    finally:
        if collecting:
            gc.enable()
    return times


def summary(values: FloatArray) -> Summary:
    """Median and spread of values over rounds (rounds,)."""
    low, median, high = np.percentile(values, (LOW, 50, HIGH))
    return Summary(float(median), float(low), float(high))


def paired(first: FloatArray, second: FloatArray) -> Summary:
    """Median and spread of first / second, formed round by round."""
    return summary(first / second)


def _calibrate(case: Case, shortest: float, clock: Clock) -> int:
    """How many runs make a measurement; the first run, which may compile, does not count."""
    _seconds(case, 1, clock)
    if shortest == 0:
        return 1
    once = _seconds(case, 1, clock)
    return max(1, math.ceil(shortest / once)) if once > 0 else 1


def _seconds(case: Case, runs: int, clock: Clock) -> float:
    """Mean time of a run [s]."""
    total = 0.0
    for _ in range(runs):
        prepared = case.prepare()
        begun = clock()
        case.run(prepared)
        total += clock() - begun
    return total / runs
