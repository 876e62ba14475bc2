"""Items into files: what has to be done is done, kept, and answered.

Files in the output folder: `jobs/` (what is done, a file for each job), `runs.parquet` (all
their rows), `results.parquet` (a row for each number that is shown: `experiments.paper.item`),
`claims.parquet` (a row for each claim and source: `experiments.claims.scoreboard`),
`figures/NAME.svg`, `.png` and `.parquet` (a figure and what is drawn in it).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import polars as pl

from experiments import jobs
from experiments.claims.scoreboard import judge
from experiments.figures import write_figure
from experiments.jobs import Job, Store
from experiments.paper.item import CELLS, Answer, Item
from experiments.studies import worlds
from experiments.studies.scale import Scale
from experiments.warm_up import compile_sensing, compile_tracking
from sim_bridge.parquet import write_frame


@dataclass(frozen=True)
class Results:
    """rows: of all jobs. cells: every number shown. answers: by item. verdicts: on the claims that
    there are rows for, and on all others that there are none."""

    rows: pl.DataFrame
    cells: pl.DataFrame
    answers: Mapping[str, Answer]
    verdicts: pl.DataFrame


def run(
    items: Sequence[Item],
    scale: Scale,
    out: Path,
    workers: int | None = None,
    progress: Callable[[int, int], None] = lambda done, of: None,
) -> Results:
    """Do what the items need and the folder does not have, answer them, write the files.

    progress is told how many jobs of how many are done. Raises `RunFailed` and on Ctrl-C
    `KeyboardInterrupt`; what was done is kept, and the same command goes on from there.
    """
    wanted = list(dict.fromkeys(job for item in items for job in item.jobs(scale)))
    wanted.sort(key=_first_of_group(wanted))
    store = Store(out / "jobs")
    warm_up = (compile_sensing, partial(compile_tracking, worlds.FILTERS))
    jobs.do(wanted, store, workers, lambda done: progress(done, len(wanted)), warm_up)
    rows = store.rows(wanted)
    answers = {item.id: item.answer(rows) for item in items}
    verdicts = judge(rows)
    cells = pl.concat([answer.cells for answer in answers.values()] or [pl.DataFrame(schema=CELLS)])
    write_frame(rows, out / "runs.parquet")
    write_frame(cells, out / "results.parquet")
    write_frame(verdicts, out / "claims.parquet")
    _draw(answers, out / "figures")
    return Results(rows, cells, answers, verdicts)


def _first_of_group(wanted: Sequence[Job]) -> Callable[[Job], int]:
    """Jobs of one group next to each other, groups in the order of their first jobs."""
    first: dict[str, int] = {}
    for place, job in enumerate(wanted):
        first.setdefault(job.group, place)
    return lambda job: first[job.group]


def _draw(answers: Mapping[str, Answer], folder: Path) -> None:
    """The figures' files."""
    folder.mkdir(exist_ok=True)
    for answer in answers.values():
        for picture in answer.pictures:
            figure = picture.draw()
            for kind in ("svg", "png"):
                write_figure(figure, folder / f"{picture.name}.{kind}")
            write_frame(picture.data, folder / f"{picture.name}.parquet")
