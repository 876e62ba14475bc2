"""One seed of a scenario into rows: simulated, and detected, once for all jobs that ask for it."""

from abc import abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any

import polars as pl

import scenarios
import sim_bridge
from experiments.jobs import ROWS, Job, as_rows
from experiments.named import detector_named
from mdkf import Detections, Trace


@dataclass(frozen=True)
class SeedJob(Job):
    """What is done with one seed of a scenario; all jobs of the seed share its simulation."""

    scenario: str
    seed: int

    @property
    @abstractmethod
    def labels(self) -> Mapping[str, str]:
        """What all rows have in common beside the seed: study, and detector and occlusion."""

    @property
    def decisions(self) -> Mapping[str, Any]:
        """What else decides the rows, as JSON takes it."""
        return {}

    @abstractmethod
    def measured(self, trace: Trace) -> Iterable[Mapping[str, Any]]:
        """The rows of the seed's trace, by their own columns."""

    @property
    def group(self) -> str:
        """All jobs of one seed."""
        return f"{self.scenario}, seed {self.seed}"

    def key(self) -> Mapping[str, Any]:
        """All that decides the rows."""
        own = {"scenario": identity(self.scenario), "seed": self.seed}
        return {**own, **self.labels, **self.decisions}

    def rows(self) -> pl.DataFrame:
        """What is measured; nothing if the seed was refused."""
        try:
            trace = simulated(self.scenario, self.seed)
        except sim_bridge.SeedRefused:
            return pl.DataFrame(schema=ROWS)
        measured = self.measured(trace)
        return as_rows(measured, scenario=self.scenario, seed=self.seed, **self.labels)

    def detected(self, profile: str) -> Detections:
        """What a simulated detector sees of the seed."""
        return detected(self.scenario, self.seed, profile)


def of_traffic(seeds: int) -> list[tuple[str, int]]:
    """So many seeds of each scenario of the population, seeds first: what is interrupted has a few
    seeds of all scenarios."""
    return [(name, seed) for seed in range(seeds) for name in traffic()]


@cache
def traffic() -> tuple[str, ...]:
    """The population: every scenario of the catalogue in which a simulator drives."""
    known = (name for name in scenarios.list() if not name.startswith("kitti-"))
    driven = ("sumo", "highway-env")
    return tuple(name for name in known if scenarios.load(name).source in driven)


@cache
def identity(scenario: str) -> str:
    """All that decides a scenario, as text: a run of many jobs asks for it thousands of times."""
    return scenarios.load(scenario).identity()


@lru_cache(maxsize=1)
def simulated(scenario: str, seed: int) -> Trace:
    """The trace of a scenario's seed; the last one asked for is kept. Raises `SeedRefused`."""
    cache = sim_bridge.user_cache()
    make = sim_bridge.simulate if cache is None else cache.simulate
    return make(scenarios.load(scenario), seed)


@lru_cache(maxsize=1)
def detected(scenario: str, seed: int, profile: str) -> Detections:
    """Its detections, by a profile's name; the last ones asked for are kept."""
    return sim_bridge.detect(simulated(scenario, seed), detector_named(profile), seed)
