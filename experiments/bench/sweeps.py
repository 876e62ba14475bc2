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
FILTERS = ("ca", "imm", "md", "md-keep")
CLOSED_FORMS = ("constant_velocity", "circle", "journey", "lane_change")
"""No simulator's time hides what the sweep itself costs: the most that it can add."""


def blocks(plan: Plan) -> list[Block]:
    """CPU time: the tasks alone, and as a sweep in this process."""
    found = []
    for tier, own in _sweeps(plan):
        bare = _case(WHAT, BARE, tier, own, _bare(own))
        found.append(Block((bare, _case(WHAT, ONE, tier, own, _run(own, 1))), bare))
    return found


def scaling(plan: Plan) -> list[Block]:
    """Time on the clock: on two processes beside one."""
    found = []
    for tier, own in _sweeps(plan):
        one, two = (
            _case(SCALING, name, tier, own, _run(own, n)) for name, n in ((ONE, 1), (TWO, 2))
        )
        found.append(Block((one, two), one))
    return found


def _sweeps(plan: Plan) -> tuple[tuple[str, Sweep], ...]:
    """What is swept, by its tier."""
    return (
        ("closed forms", Sweep.of(CLOSED_FORMS, FILTERS, plan.seeds)),
        ("traffic", Sweep.of(plan.driven, FILTERS, plan.drives)),
    )


def _bare(own: Sweep) -> Callable[[], object]:
    work = tasks_of(own, None)
    return lambda: [tasks.do(one) for one in work]


def _run(own: Sweep, workers: int) -> Callable[[], object]:
    def run() -> object:
        with tempfile.TemporaryDirectory() as out:
            return run_sweep(own, out, workers, cached=False).progress

    return run


def _case(what: str, name: str, tier: str, own: Sweep, run: Callable[[], object]) -> Case:
    runs = len(own)
    return Case(what, name, tier, runs, runs, "ms", 1e3, lambda: None, lambda _: run())
