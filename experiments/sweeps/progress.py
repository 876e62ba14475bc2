"""How far a sweep is, and what its filters' scores are so far."""

import math
import time
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field

from experiments.sweeps.task import FAILED, REFUSED, Rows

WATCHED = ("hota", "error_gap", "drift")
"""Scores whose means are watched while a sweep runs."""


@dataclass
class Mean:
    """A mean of values as they come; NaN of none."""

    total: float = 0.0
    n: int = 0

    def add(self, value: float | None) -> None:
        """One more value; None is no value."""
        if value is not None:
            self.total += value
            self.n += 1

    @property
    def value(self) -> float:
        """The mean so far."""
        return self.total / self.n if self.n else math.nan


@dataclass
class Progress:
    """How far a sweep is.

    runs: of the sweep, by scenario. done: of them there, by scenario. found: how many were there
    when it began; damaged: how many files of results were not whole. failed, refused: of the runs
    done since. watched: means of the scores `WATCHED` since, by filter.
    """

    runs: Mapping[str, int]
    done: dict[str, int]
    found: int
    damaged: int
    workers: int
    failed: int = 0
    refused: int = 0
    watched: dict[str, dict[str, Mean]] = field(default_factory=dict)
    _seconds: dict[str, Mean] = field(default_factory=lambda: defaultdict(Mean))
    _began: float = field(default_factory=time.monotonic)

    def add(self, rows: Rows) -> None:
        """A task is done."""
        runs = rows.runs
        scenario = runs["scenario"][0]
        self.done[scenario] += len(runs)
        took = self._seconds[scenario]
        took.total, took.n = took.total + rows.seconds, took.n + len(runs)
        self.failed += int((runs["status"] == FAILED).sum())
        self.refused += int((runs["status"] == REFUSED).sum())
        for name, *values in runs.select("filter", *WATCHED).iter_rows():
            own = self.watched.setdefault(name, {score: Mean() for score in WATCHED})
            for score, value in zip(WATCHED, values, strict=True):
                own[score].add(value)

    @property
    def total(self) -> int:
        """Runs of the sweep."""
        return sum(self.runs.values())

    @property
    def there(self) -> int:
        """Runs that are done."""
        return sum(self.done.values())

    @property
    def rate(self) -> float:
        """Runs a second, since it began."""
        return (self.there - self.found) / max(time.monotonic() - self._began, 1e-9)

    @property
    def remaining(self) -> float:
        """Time to the end [s], by what the runs of each scenario took so far; NaN before any."""
        known = [took for took in self._seconds.values() if took.n]
        if not known:
            return 0.0 if self.there == self.total else math.nan
        anywhere = sum(took.total for took in known) / sum(took.n for took in known)
        seconds = 0.0
        for scenario, runs in self.runs.items():
            took = self._seconds.get(scenario, Mean())
            seconds += (runs - self.done[scenario]) * (took.value if took.n else anywhere)
        return seconds / self.workers
