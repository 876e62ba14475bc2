"""A sweep into a folder of results: what is missing is done, and kept as it comes.

Files in the folder: `runs/` and `growth/` (`experiments.sweeps.dataset`), `manifest.json`
(`experiments.sweeps.manifest`), and of all that is there when it ends `summary.parquet`,
`differences.parquet` (`experiments.sweeps.summary`) and `growth.parquet`, `.svg`, `.png`
(`experiments.sweeps.growth_files`).
"""

import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import polars as pl

from experiments import engine
from experiments.sweeps import manifest, task
from experiments.sweeps.cluster import on_cluster
from experiments.sweeps.dataset import Dataset
from experiments.sweeps.growth_files import curves, on_curve, write_growth
from experiments.sweeps.progress import Progress
from experiments.sweeps.summary import differences, summarise
from experiments.sweeps.sweep import Sweep
from experiments.sweeps.task import Rows, Run, Task
from experiments.warm_up import compile_sensing, compile_tracking
from mdkf import ESTIMATORS
from sim_bridge import TraceCache, user_cache
from sim_bridge.parquet import write_frame


@dataclass(frozen=True)
class SweepResults:
    """The results of a sweep, as far as they are there, and what they say.

    runs: a row each (`experiments.sweeps.task.RUNS`). summary: means over seeds; differences: of
    the first filter from the others, paired. curves: of error growth
    (`experiments.sweeps.growth_files.CURVES`), pictures: of them; none of a sweep that is
    interrupted or failed. progress: what was done.
    """

    runs: pl.DataFrame
    summary: pl.DataFrame
    differences: pl.DataFrame
    curves: pl.DataFrame
    pictures: Sequence[Path]
    progress: Progress


def run_sweep(
    sweep: Sweep,
    out: str | Path,
    workers: int | None = None,
    dask: str | None = None,
    *,
    retry: bool = False,
    fresh: bool = False,
    first: bool = False,
    cached: bool = True,
    command: Sequence[str] = tuple(sys.argv),
    watch: Callable[[Progress], None] = lambda progress: None,
) -> SweepResults:
    """Do what of a sweep is not in the folder `out` yet.

    workers: processes, the machine's cores if None, 1 for this one. dask: address of a scheduler
    whose workers do it instead. retry: runs that failed are done again. fresh: what is there is
    deleted. first: only the first world of each scenario is done. cached: whether simulated worlds
    are kept in the user's cache. watch: called after each task.

    Raises `SweepError` where somebody else writes to the folder, or where its results are of other
    sources; `RunFailed` if the cluster cannot be reached or is lost. On Ctrl-C and then, what is
    done is kept, and the same call goes on from there.
    """
    out = Path(out)
    dataset = Dataset(out)
    with dataset.locked():
        if fresh:
            dataset.clear()
            (out / manifest.NAME).unlink(missing_ok=True)
        manifest.check(out)
        found, damaged = dataset.finished(retry)
        cache = user_cache() if cached else None
        everything = tasks_of(sweep, cache)
        missing = [one for each in everything if (one := _missing(each, found)) is not None]
        progress = _progress(everything, missing, damaged, workers or engine.cores())
        if first:
            missing = _firsts(missing)
        told = manifest.begin(out, sweep, command, dask or str(workers or engine.cores()))
        watch(progress)
        state = "failed"
        try:
            for rows in _outcomes(missing, workers, dask, progress):
                dataset.add(rows)
                progress.add(rows)
                watch(progress)
            state = "finished" if progress.there == progress.total else "incomplete"
        except KeyboardInterrupt:
            state = "interrupted"
            raise
        finally:
            own = pl.DataFrame({"run": [run.address for each in everything for run in each.runs]})
            drawn = state in ("finished", "incomplete")
            results = _ended(sweep, dataset, own, progress, drawn)
            status = results.runs["status"].value_counts().iter_rows()
            manifest.end(out, told, state, dict(status), dataset.files())
    return results


def tasks_of(sweep: Sweep, cache: TraceCache | None) -> list[Task]:
    """One for each world, with all of its runs."""
    made_by = task.sources()
    found = []
    for scenario, seed, setups in sweep.worlds():
        runs = tuple(Run(task.address(scenario, seed, made_by, one), one) for one in setups)
        found.append(Task(scenario, seed, runs, made_by, cache))
    return found


def _missing(whole: Task, found: set[str]) -> Task | None:
    """What of a task is to be done; None if it is all there."""
    left = tuple(run for run in whole.runs if run.address not in found)
    return replace(whole, runs=left) if left else None


def _firsts(missing: Sequence[Task]) -> list[Task]:
    """The first task of each scenario."""
    chosen: dict[str, Task] = {}
    for one in missing:
        chosen.setdefault(one.scenario.name, one)
    return list(chosen.values())


def _progress(
    everything: Sequence[Task], missing: Sequence[Task], damaged: int, workers: int
) -> Progress:
    runs, left = Counter[str](), Counter[str]()
    for counter, tasks in ((runs, everything), (left, missing)):
        for one in tasks:
            counter[one.scenario.name] += len(one.runs)
    done = {name: number - left[name] for name, number in runs.items()}
    return Progress(runs, done, sum(done.values()), damaged, workers)


def _outcomes(
    missing: Sequence[Task], workers: int | None, dask: str | None, progress: Progress
) -> Iterator[Rows]:
    """The rows of tasks as they come. Where a worker died, each run of its task is done again by
    itself: only that which is the death of its worker again has failed."""
    deadly: list[Task] = []

    def noted(one: Task) -> None:
        deadly.append(one)

    for rows in _done(missing, workers, dask, progress, noted):
        if rows is not None:
            yield rows
    alone = [replace(one, runs=(run,)) for one in deadly for run in one.runs]
    for rows in _done(alone, workers, dask, progress, task.died):
        if rows is not None:
            yield rows


def _done(
    tasks: Sequence[Task],
    workers: int | None,
    dask: str | None,
    progress: Progress,
    dead: Callable[[Task], Rows | None],
) -> Iterator[Rows | None]:
    if not tasks:
        return
    if dask is not None:
        yield from on_cluster(dask, tasks, progress, dead)
        return
    filters = {run.setup.filter.name for one in tasks for run in one.runs}
    known = sorted(name for name in filters if name in ESTIMATORS)
    # The first run on a machine compiles the kernels: each of two workers a half.
    warm_up = (compile_sensing, partial(compile_tracking, known))
    work: Callable[[Task], Rows | None] = task.do
    yield from engine.outcomes(work, tasks, workers, warm_up, dead)


def _ended(
    sweep: Sweep, dataset: Dataset, own: pl.DataFrame, progress: Progress, drawn: bool
) -> SweepResults:
    """The results of all that is there of a sweep's own runs, written beside them."""
    runs = dataset.rows("runs", own)
    found = summarise(runs, sweep), differences(runs, sweep)
    for name, frame in zip(("summary", "differences"), found, strict=True):
        write_frame(frame, dataset.folder / f"{name}.parquet")
    growth = own.clear() if not drawn else own
    curve = curves(dataset.rows("growth", growth, lambda rows: on_curve(rows, sweep)), sweep)
    pictures = write_growth(curve, dataset.folder) if drawn else []
    return SweepResults(runs, *found, curve, pictures, progress)
