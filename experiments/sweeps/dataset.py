"""The folder of a sweep's results: every file whole, every run in one of them.

    runs/scenario=NAME/ADDRESS.parquet      a row for each run (`experiments.sweeps.task.RUNS`)
    growth/scenario=NAME/ADDRESS.parquet    error growth of the same runs (`GROWN`)

A file holds the runs that were done together, and its name is made of theirs: doing them twice
writes the same file. One that is damaged is no file. Runs that failed are in files of their own.
"""

import errno
import fcntl
import hashlib
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

import polars as pl

from experiments.sweeps.sweep import SweepError
from experiments.sweeps.task import FAILED, GROWN, RUNS, Rows
from sim_bridge.parquet import read_frame, write_frame

LOCK = ".lock"

AT_A_TIME = 64
"""Files that are read together."""

KINDS = {"runs": RUNS, "growth": GROWN}
"""Kinds of rows and their columns."""


@dataclass(frozen=True)
class Dataset:
    """The results in a folder."""

    folder: Path

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Nobody else writes here; `SweepError` if somebody does. A process that is killed no
        longer does."""
        self.folder.mkdir(parents=True, exist_ok=True)
        with (self.folder / LOCK).open("w") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                if error.errno not in (errno.EAGAIN, errno.EACCES):
                    raise
                raise SweepError(f"{self.folder}: another sweep is writing there") from None
            yield

    def clear(self) -> None:
        """Delete all results."""
        for kind in KINDS:
            shutil.rmtree(self.folder / kind, ignore_errors=True)

    def add(self, rows: Rows) -> None:
        """Keep what came of a task: growth first, so that a run that is there is there whole."""
        failures = rows.runs["status"] == FAILED
        for failed in (False, True):
            runs = rows.runs.filter(failures == failed)
            if runs.is_empty():
                continue
            name, scenario = _name(runs), runs["scenario"][0]
            if not failed:
                self._write(rows.growth, "growth", scenario, name)
            self._write(runs, "runs", scenario, name)

    def finished(self, retry: bool = False) -> tuple[set[str], int]:
        """The runs that are there, and how many damaged files there were; these are deleted, as is
        what a writer that was killed left behind. With `retry` so are the runs that failed."""
        found, damaged = set[str](), 0
        for left in self.folder.glob("*/*/.*.part"):
            left.unlink()
        for path in sorted(self.folder.glob("runs/*/*.parquet")):
            runs = read_frame(path, RUNS)
            beside = self.folder / "growth" / path.parent.name / path.name
            failed = runs is not None and (runs["status"] == FAILED).all()
            whole = runs is not None and (failed or read_frame(beside, GROWN) is not None)
            if runs is not None and whole and not (failed and retry):
                found.update(runs["run"])
                continue
            damaged += not whole
            # The runs' file first: growth alone is nothing.
            path.unlink()
            beside.unlink(missing_ok=True)
        for path in self._of("growth"):
            if not (self.folder / "runs" / path.parent.name / path.name).exists():
                path.unlink()
        return found, damaged

    def files(self) -> dict[str, str]:
        """SHA-256 of every file of results by its name within the folder."""
        paths = sorted(path for kind in KINDS for path in self._of(kind))
        return {
            path.relative_to(self.folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in paths
        }

    def rows(
        self,
        kind: str,
        runs: pl.DataFrame,
        needed: Callable[[pl.LazyFrame], pl.LazyFrame] = lambda rows: rows,
    ) -> pl.DataFrame:
        """The rows of a kind, `runs` or `growth`, that are of some runs (a column `run`), or what
        is needed of them. Some files are read at a time: thousands at once take many times the
        memory of what is in them."""
        paths = sorted(self._of(kind))
        parts = [needed(pl.LazyFrame(schema=KINDS[kind])).collect()]
        for first in range(0, len(paths), AT_A_TIME):
            files = pl.scan_parquet(paths[first : first + AT_A_TIME], hive_partitioning=False)
            parts.append(needed(files.join(runs.lazy(), on="run", how="semi")).collect())
        return pl.concat(parts)

    def _of(self, kind: str) -> Iterator[Path]:
        return self.folder.glob(f"{kind}/*/*.parquet")

    def _write(self, rows: pl.DataFrame, kind: str, scenario: str, name: str) -> None:
        folder = self.folder / kind / f"scenario={quote(scenario)}"
        folder.mkdir(parents=True, exist_ok=True)
        write_frame(rows, folder / f"{name}.parquet")


def _name(runs: pl.DataFrame) -> str:
    """The name of the file of some runs."""
    return hashlib.sha256("".join(sorted(runs["run"])).encode()).hexdigest()[:32]
