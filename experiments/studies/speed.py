"""Filters and tracker into rows of CPU times, measured by the machinery of `mdkf bench`.

All filters of one size are measured in interleaved rounds, so that they can be compared round by
round. A round's number stands in the place of the seed. Only the CPU time of the thread counts.
"""

import ctypes
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from typing import Any, ClassVar

import polars as pl

from experiments.bench import filters, recordings, trackers
from experiments.bench.measure import Block, Samples, measure
from experiments.bench.plan import Plan
from experiments.jobs import Job, as_rows
from experiments.studies import worlds
from experiments.studies.scale import Scale
from experiments.studies.seeds import detected

STUDY = "speed"
NAMES = worlds.ORDER_2

FILTERS = "filters"
TRACKER, TRAFFIC, RECORDED = "tracker", "tracker on traffic", "tracker on KITTI val"
"""Parts: the filters alone in all tiers of `experiments.bench.filters`, and the whole tracker on
objects in lanes, on simulated traffic, and on recorded detections. Scenarios of the rows are the
tiers and the other parts."""

LATENCY = "latency"
"""CPU time of a frame with all its objects [us]."""
TO_CA, TO_MD = "ratio to ca", "ratio to md"
"""CPU time over that of another filter, formed within the round."""

FEW = (1, 5, 20)
"""Numbers of objects in all tiers; KITTI's frames have up to some 20 cars."""
MANY = (*FEW, 100, 500)
"""Numbers for what is compiled; one track at a time, each costs as much as among few."""
DETECTORS = ("virconv", "casa", "pointrcnn", "second", "pvrcnn")
"""The paper's five, in its order."""
WORLDS = ("city_grid", "intersection", "merge", "roundabout")
"""Simulated traffic, of the first seed, with 7 to 20 detections in a frame."""

PLAN = Plan(shortest=0.005, reference=FEW, steps=30, updates=20_000)
"""30 steps: MD's window is full in most of them."""


@dataclass(frozen=True)
class Timing(Job):
    """What is measured together: a part, with so many objects or of a detector."""

    part: str
    of: int | str
    rounds: int
    alone: ClassVar[bool] = True

    @property
    def group(self) -> str:
        """Nothing else is measured at the same time."""
        return f"speed of {self.part}, {self.of}"

    def key(self) -> Mapping[str, Any]:
        """What is measured; the machine's part in the times is in no key."""
        return {"study": STUDY, "plan": asdict(PLAN), "worlds": WORLDS, **asdict(self)}

    def rows(self) -> pl.DataFrame:
        """`latency` [us], `ratio to ca` and `ratio to md` by filter and round. Bin or detector:
        what it is of."""
        block = _BLOCKS[self.part](self.of)
        with memory_kept():
            # A progress bar's thread is not on this clock.
            samples = measure([block], self.rounds, PLAN.shortest, clock=time.thread_time)
        return as_rows(self.measured(samples), study=STUDY)

    def measured(self, samples: Samples) -> Iterator[dict[str, Any]]:
        """Rows of the times per unit of work [s], (rounds,) for each case."""
        by_name = {(case.tier, case.name): times for case, times in samples.items()}
        of = {"bin": objects(self.of)} if isinstance(self.of, int) else {"detector": self.of}
        for case, times in samples.items():
            # A unit of work is a frame; of the filters it is a step of one of the tracks.
            of_frame = case.size if self.part == FILTERS else 1
            metrics = {
                LATENCY: times * of_frame * 1e6,
                TO_CA: times / by_name[case.tier, "ca"],
                TO_MD: times / by_name[case.tier, "md"],
            }
            own = {"scenario": scenario(self.part, case.tier), "filter": case.name, "n": 1, **of}
            for metric, values in metrics.items():
                for number, value in enumerate(values.tolist()):
                    yield {**own, "metric": metric, "seed": number, "value": value}


def jobs(part: str, of: Iterable[int | str], scale: Scale) -> list[Timing]:
    """A part with each number of objects, or detector."""
    return [Timing(part, one, scale.rounds) for one in of]


def scenario(part: str, tier: str) -> str:
    """Of the rows of a part and, where it is the filters, of a tier."""
    return tier if part == FILTERS else part


def objects(number: int) -> str:
    """The bin of a number of objects."""
    return f"{number} object{'s' * (number != 1)}"


@contextmanager
def memory_kept() -> Iterator[None]:
    """Within it glibc keeps what is freed for the next run, where glibc is the C library.

    Otherwise it gives memory back to the system between runs and gets it anew page by page, or
    does not, by what else the process did before: up to twice the time, for one filter or another.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform == "linux" else None
    if mallopt is None:
        yield
        return
    for parameter in _KEPT:
        mallopt(parameter, _ALL)
    try:
        yield
    finally:
        for parameter, usual in _KEPT.items():
            mallopt(parameter, usual)


_KEPT: Mapping[int, int] = {-1: 128 * 1024, -3: 128 * 1024}
"""glibc's M_TRIM_THRESHOLD and M_MMAP_THRESHOLD, with their usual values [bytes] (malloc.h)."""
_ALL = 2**31 - 1


def _filters(tracks: int) -> Block:
    (block,) = filters.blocks(replace(PLAN, tracks=(tracks,)))
    return Block(tuple(case for case in block.cases if case.name in NAMES))


def _tracker(number: int) -> Block:
    (block,) = trackers.blocks(replace(PLAN, objects=(number,)))
    return block


def _traffic(detector: str) -> Block:
    return recordings.block(detector, [detected(name, 0, detector) for name in WORLDS])


def _recorded(detector: str) -> Block:
    return recordings.block(detector, recordings.recorded(detector))


_BLOCKS: Mapping[str, Callable[[Any], Block]] = {
    FILTERS: _filters,
    TRACKER: _tracker,
    TRAFFIC: _traffic,
    RECORDED: _recorded,
}
