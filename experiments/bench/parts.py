"""The parts of the benchmark by name, and a run of some of them."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType

from experiments.bench import (
    filters,
    recordings,
    scoring,
    sensing,
    simulation,
    start_up,
    sweeps,
    trackers,
)
from experiments.bench.measure import Block, Case, Clock, measure
from experiments.bench.plan import Plan
from experiments.bench.results import Results
from mdkf.tables import FloatArray


@dataclass(frozen=True)
class Part:
    """What is measured under a name, and with which clock; processes: each case starts one."""

    blocks: Callable[[Plan], list[Block]]
    clock: Clock = time.process_time
    processes: bool = False


PARTS: Mapping[str, Part] = MappingProxyType(
    {
        filters.WHAT: Part(filters.blocks),
        trackers.WHAT: Part(trackers.blocks),
        recordings.WHAT: Part(recordings.blocks),
        scoring.WHAT: Part(scoring.blocks),
        sensing.WHAT: Part(sensing.blocks),
        simulation.WHAT: Part(simulation.blocks, simulation.cpu_time, processes=True),
        start_up.WHAT: Part(start_up.blocks, start_up.children, processes=True),
        sweeps.WHAT: Part(sweeps.blocks, simulation.cpu_time, processes=True),
        sweeps.SCALING: Part(sweeps.scaling, time.perf_counter, processes=True),
    }
)


def run(
    plan: Plan,
    names: Sequence[str],
    progress: Callable[[str, float], None] = lambda part, done: None,
) -> Results:
    """The named parts, one after another; progress is told which one and how much of it is done."""
    blocks: list[Block] = []
    samples: dict[Case, FloatArray] = {}
    for name in names:
        part = PARTS[name]
        progress(name, 0.0)
        own = part.blocks(plan)
        samples |= measure(
            own,
            plan.processes if part.processes else plan.rounds,
            0.0 if part.processes else plan.shortest,
            part.clock,
            partial(progress, name),
        )
        blocks += own
    return Results(tuple(blocks), samples)
