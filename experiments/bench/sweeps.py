"""A sweep beside its bare work, and on two processes beside one: CPU time and time on the clock."""

import tempfile
from collections.abc import Callable

from experiments.bench.measure import Block, Case
from experiments.bench.plan import Plan
from experiments.sweeps import Sweep, run_sweep
from experiments.sweeps import task as tasks
from experiments.sweeps.run import tasks_of

WHAT, SCALING = "sweep", "scaling"
BARE, ONE, TWO = "bare work", "1 process", "2 processes"
TIER = "runs"
SCENARIOS = ("constant_velocity", "circle", "journey", "lane_change")
"""Closed forms: no simulator's time hides what the sweep itself costs."""
FILTERS = ("ca", "imm", "md", "md-keep")


def blocks(plan: Plan) -> list[Block]:
    """CPU time: the tasks alone, and as a sweep in this process."""
    own = _sweep(plan)
    work = tasks_of(own, None)
    bare = _case(WHAT, BARE, own, lambda: [tasks.do(one) for one in work])
    return [Block((bare, _case(WHAT, ONE, own, _run(own, 1))), bare)]


def scaling(plan: Plan) -> list[Block]:
    """Time on the clock: on two processes beside one."""
    own = _sweep(plan)
    one, two = (_case(SCALING, name, own, _run(own, n)) for name, n in ((ONE, 1), (TWO, 2)))
    return [Block((one, two), one)]


def _sweep(plan: Plan) -> Sweep:
    return Sweep.of(SCENARIOS, FILTERS, plan.seeds)


def _run(own: Sweep, workers: int) -> Callable[[], object]:
    def run() -> object:
        with tempfile.TemporaryDirectory() as out:
            return run_sweep(own, out, workers, cached=False).progress

    return run


def _case(what: str, name: str, own: Sweep, run: Callable[[], object]) -> Case:
    runs = len(own)
    return Case(what, name, TIER, runs, runs, "ms", 1e3, lambda: None, lambda _: run())
