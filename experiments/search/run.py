"""A plan into what was found, and its files.

Files in the output folder: `jobs/` (every world's scores, a file for each), `trials.parquet` (a row
for each point that was tried), `checks.parquet` (a row for each candidate, and one for the
control), `worlds.parquet` (their fresh seeds: a row for each world and filter), and for each worst
case that is confirmed `worst-K.yaml` (a sweep that replays it), `worst-K.svg` and `.png`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from experiments import jobs
from experiments.engine import RunFailed
from experiments.jobs import Store
from experiments.search.check import Checks, candidates, check
from experiments.search.evaluation import Evaluation
from experiments.search.optimise import Trial, trials
from experiments.search.plan import Plan
from experiments.warm_up import compile_sensing, compile_tracking
from sim_bridge import SimulationError, check_detector, check_inputs, simulate

KEPT = "jobs"
"""Folder of what was done, in the output folder."""


@dataclass(frozen=True)
class Found:
    """trials: those that were done. proposed: the candidates. checks: on fresh seeds; None if it
    did not come to that. refused, failed: worlds that are not there, of all. reason: of the first
    that failed. interrupted, failure: what ended the search early."""

    plan: Plan
    trials: tuple[Trial, ...]
    proposed: tuple[Trial, ...] = ()
    checks: Checks | None = None
    refused: int = 0
    failed: int = 0
    reason: str | None = None
    interrupted: bool = False
    failure: str | None = None


def search(
    plan: Plan,
    out: Path,
    workers: int | None = None,
    progress: Callable[[int, int], None] = lambda done, of: None,
) -> Found:
    """Search, check, and tell; a second time with what is kept in `out`.

    workers: processes, the machine's cores if None; their number changes no result. progress is
    told how many worlds of how many are done. Ctrl-C and the death of a worker end the search: what
    was found before is told, and the same call goes on from there.

    Raises what `simulate` raises for bad input, and `RunFailed` if no world has a value.
    """
    check_inputs(plan.space.defaults)
    check_detector(plan.detector, plan.space.defaults)
    store = Store(out / KEPT)
    total = plan.trials * plan.seeds + (plan.candidates + 1) * plan.check_seeds
    warm_up: list[Callable[[], object]] = [
        compile_sensing,
        partial(compile_tracking, plan.goal.filters),
    ]
    before = 0

    def do(worlds: Sequence[Evaluation]) -> None:
        nonlocal before
        jobs.do(worlds, store, workers, lambda done: progress(before + done, total), warm_up)
        warm_up.clear()  # it is compiled for good
        before += len(worlds)

    done: list[Trial] = []
    checks, interrupted, failure = None, False, None
    try:
        for batch in trials(plan, store, do):
            done += batch
        if not any(one.values.n for one in done):
            raise RunFailed(_nothing(plan, done))
        checks = check(plan, candidates(done, plan.space, plan.candidates), store, do)
        progress(total, total)
    except KeyboardInterrupt:
        interrupted = True
    except RunFailed as error:
        if not any(one.values.n for one in done):
            raise
        failure = str(error)
    values = [one.values for one in done]
    if checks is not None:
        values += [checks.control, *(one.values for one in checks.candidates)]
    failed = sum(one.failed for one in values)
    return Found(
        plan,
        tuple(done),
        tuple(candidates(done, plan.space, plan.candidates)),
        checks,
        sum(one.refused for one in values),
        failed,
        _reason(plan, done) if failed else None,
        interrupted,
        failure,
    )


def _nothing(plan: Plan, done: Sequence[Trial]) -> str:
    """Why no world has a value."""
    told = f"no world of {len(done)} trials has a value of {plan.goal.metric}"
    refused, failed = (sum(getattr(one.values, name) for one in done) for name in _MISSING)
    if not refused + failed:
        return f"{told}: nothing to measure there (with --occlusion none there are no gaps)"
    return f"{told}: {refused} seeds refused, {failed} failed: {_reason(plan, done)}"


_MISSING = ("refused", "failed")


def _reason(plan: Plan, done: Sequence[Trial]) -> str | None:
    """What the simulator says of the first world that is not there, asked once more."""
    for missing in reversed(_MISSING):
        for trial in done:
            if not getattr(trial.values, missing):
                continue
            for seed in plan.search_seeds:
                try:
                    simulate(plan.space.at(trial.point), seed)
                except SimulationError as error:
                    return str(error)
    return None
