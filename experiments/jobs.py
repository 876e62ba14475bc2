"""Jobs into rows of results, each kept in a file named by all that decides it.

A file is named by the SHA-256 of the job's key and of the sources that make its rows, so that a run
that was interrupted, or asks for more, does what is missing and nothing twice. A file is whole or
not there; one that cannot be read is made anew.
"""

import hashlib
import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from inspect import getfile
from itertools import groupby
from pathlib import Path
from typing import Any, ClassVar

import polars as pl

import sim_bridge
from experiments import engine
from experiments.engine import RunFailed
from experiments.sources import deciding
from sim_bridge.parquet import read_frame, write_frame

ROWS = {
    "study": pl.String,
    "scenario": pl.String,
    "seed": pl.Int64,
    "detector": pl.String,
    "occlusion": pl.String,
    "filter": pl.String,
    "bin": pl.String,
    "metric": pl.String,
    "value": pl.Float64,
    "n": pl.Int64,
}
"""Columns of what jobs give: one measured value of one seed, and what it was measured of. bin:
`all`, or the part that the value is of. value: null is "no value". n: what is behind it."""


class Job(ABC):
    """What is done in one piece and kept in one file. Plain data, as it goes to other processes.

    alone: whether it measures the machine, and is done when nothing else runs.
    """

    alone: ClassVar[bool] = False

    @property
    @abstractmethod
    def group(self) -> str:
        """Jobs of one group are done by one process, one after the other, and may share work."""

    @abstractmethod
    def key(self) -> Mapping[str, Any]:
        """All that decides the rows beside the sources, as JSON takes it."""

    @abstractmethod
    def rows(self) -> pl.DataFrame:
        """The work: rows with the columns `ROWS`; the same key gives the same rows."""


@dataclass(frozen=True)
class Store:
    """A folder with a file for each finished job."""

    folder: Path

    def path(self, job: Job) -> Path:
        """Where the job's rows are, once it is done."""
        key = json.dumps(job.key(), sort_keys=True, separators=(",", ":"))
        digest = hashlib.sha256(f"{key}\n{deciding(_source(type(job)))}".encode()).hexdigest()
        return self.folder / f"{digest}.parquet"

    def read(self, job: Job) -> pl.DataFrame | None:
        """The job's rows; None if there are none, or none that can be read."""
        return read_frame(self.path(job), ROWS)

    def rows(self, jobs: Iterable[Job]) -> pl.DataFrame:
        """The rows of the finished ones of some jobs, in the order of the jobs."""
        found = [rows for job in jobs if (rows := self.read(job)) is not None]
        return pl.concat(found) if found else pl.DataFrame(schema=ROWS)


def as_rows(measured: Iterable[Mapping[str, Any]], **everywhere: str | int) -> pl.DataFrame:
    """Rows with the columns `ROWS` of what was measured, and of what is the same in all of them; a
    column that is not named is `all` (bin), empty, or null, and NaN is null."""
    given = pl.DataFrame(list(measured), infer_schema_length=None)
    if given.is_empty():
        return pl.DataFrame(schema=ROWS)
    given = given.with_columns(pl.lit(value).alias(name) for name, value in everywhere.items())
    missing = [pl.lit(None).alias(name) for name in ROWS if name not in given.columns]
    whole = given.with_columns(missing).select(*ROWS).cast(ROWS)  # type: ignore[arg-type]
    empty = pl.col(pl.String).exclude("bin").fill_null("")
    return whole.with_columns(empty, pl.col("bin").fill_null("all"), pl.col("value").fill_nan(None))


def do(
    jobs: Sequence[Job],
    store: Store,
    workers: int | None = None,
    progress: Callable[[int], None] = lambda done: None,
    warm_up: Sequence[Callable[[], object]] = (),
) -> None:
    """Do the jobs that the store does not have yet; `progress` is told how many of all are done.

    Jobs that must be `alone` come last, in this process, one at a time.

    Ctrl-C and the death of a worker (`RunFailed`) lose only what was under way.
    """
    store.folder.mkdir(parents=True, exist_ok=True)
    missing = [job for job in jobs if store.read(job) is None]
    done = len(jobs) - len(missing)
    progress(done)
    together = [job for job in missing if not job.alone]
    groups = [tuple(own) for _, own in groupby(together, key=lambda job: job.group)]
    for count in engine.outcomes(partial(_do_group, store), groups, workers, warm_up):
        done += count
        progress(done)
    for job in (job for job in missing if job.alone):
        done += _do_group(store, (job,))
        progress(done)


def _do_group(store: Store, jobs: Sequence[Job]) -> int:
    """Do some jobs, one after the other; how many."""
    for job in jobs:
        try:
            rows = job.rows()
        except (sim_bridge.SimulationError, OSError) as error:
            raise RunFailed(f"{job.group}: {' '.join(str(error).split())}") from None
        write_frame(rows, store.path(job))
    return len(jobs)


@cache
def _source(job: type) -> Path:
    """The module that the job is of."""
    return Path(getfile(job))
