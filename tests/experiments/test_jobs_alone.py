"""Claim: what measures the machine has it for itself."""

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import polars as pl

from experiments import jobs
from experiments.jobs import Store, as_rows


@dataclass(frozen=True)
class Stamped:
    """A job that tells when it was done, and by which process."""

    name: str
    alone: bool

    @property
    def group(self) -> str:
        return self.name

    def key(self) -> Mapping[str, Any]:
        return {"name": self.name, "alone": self.alone}

    def rows(self) -> pl.DataFrame:
        begun = time.monotonic()
        time.sleep(0.05)
        stamps = {"begun": begun, "ended": time.monotonic(), "process": os.getpid()}
        return as_rows(
            ({"metric": metric, "value": value} for metric, value in stamps.items()),
            scenario=self.name,
        )


def stamps(store: Store, *done: Stamped) -> list[dict[str, float]]:
    """What each job told."""
    return [dict(store.rows([job]).select("metric", "value").iter_rows()) for job in done]


def test_jobs_alone_come_last_in_this_process_one_at_a_time(tmp_path: Path) -> None:
    """Although they are asked for first, and two workers share the others."""
    alone = [Stamped(f"alone {k}", alone=True) for k in range(2)]
    together = [Stamped(f"together {k}", alone=False) for k in range(3)]
    store = Store(tmp_path / "jobs")
    told: list[int] = []
    jobs.do([*alone, *together], store, workers=2, progress=told.append)
    first, second = stamps(store, *alone)
    others = stamps(store, *together)
    assert max(one["ended"] for one in others) <= first["begun"]
    assert first["ended"] <= second["begun"]
    assert {first["process"], second["process"]} == {os.getpid()}
    assert os.getpid() not in {one["process"] for one in others}
    assert told == [0, 1, 2, 3, 4, 5]


def test_what_is_there_is_not_measured_again(tmp_path: Path) -> None:
    """The stamps of a second run are those of the first."""
    job = Stamped("alone", alone=True)
    store = Store(tmp_path / "jobs")
    jobs.do([job], store)
    (before,) = stamps(store, job)
    jobs.do([job], store)
    assert stamps(store, job) == [before]
