"""One seed of a scenario into every filter's scores, kept by all that decides them."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import polars as pl

from experiments.engine import RunFailed
from experiments.jobs import Job, Store, as_rows
from experiments.named import detector_named, filter_named
from experiments.occlusion import OcclusionProtocol
from experiments.population import GapTruth
from experiments.sources import computing
from experiments.world import follow
from mdkf import DETECTORS
from scenarios import Scenario
from sim_bridge import SeedRefused, SimulationError, detect, simulate

STUDY = "search"
REFUSED, FAILED = "refused", "failed"
"""Metrics of a world that is not there: no valid truth of this seed, or the simulator failed."""


@dataclass(frozen=True)
class Evaluation(Job):
    """One world: `scenario` (with its parameters) and `seed`, tracked by every filter.

    settings: name of the tracker's settings. What one world has measured does for every goal.
    """

    scenario: Scenario
    seed: int
    filters: tuple[str, ...]
    detector: str
    settings: str
    occlusion: OcclusionProtocol
    gap_truth: GapTruth = "keep"

    @property
    def group(self) -> str:
        """Every world by itself."""
        chosen = ", ".join(f"{name} {value:g}" for name, value in self.scenario.parameters.items())
        return f"{self.scenario.name} ({chosen}), seed {self.seed}"

    def key(self) -> Mapping[str, Any]:
        """All that decides the scores."""
        return {
            "study": STUDY,
            "scenario": self.scenario.identity(),
            "seed": self.seed,
            "filters": [(name, computing(filter_named(name))) for name in self.filters],
            "detector": repr(detector_named(self.detector)),
            "settings": self.settings,
            "occlusion": str(self.occlusion),
            "gap_truth": self.gap_truth,
        }

    def rows(self) -> pl.DataFrame:
        """`experiments.world.Followed.summary` of each filter, but for the time it took; one row
        `REFUSED` or `FAILED` if there is no such world."""
        try:
            found = list(self._measured())
        except SeedRefused:
            found = [{"metric": REFUSED, "value": 1.0}]
        except SimulationError:
            found = [{"metric": FAILED, "value": 1.0}]
        return as_rows(
            found,
            study=STUDY,
            scenario=self.scenario.name,
            seed=self.seed,
            detector=self.detector,
            occlusion=str(self.occlusion),
        )

    def _measured(self) -> Iterator[dict[str, Any]]:
        # Parameters are tried once: a cache of traces would be filled with what nobody asks again.
        trace = simulate(self.scenario, self.seed)
        occluded = self.occlusion.apply(
            detect(trace, detector_named(self.detector), self.seed), trace
        )
        rules = (DETECTORS[self.settings], self.occlusion, self.gap_truth)
        for name in self.filters:
            summary = follow(trace, occluded, filter_named(name), *rules).summary()
            del summary["ms_per_frame"]
            for metric, value in summary.items():
                yield {"filter": name, "metric": metric, "value": value}


@dataclass(frozen=True)
class Measured:
    """What came of a world: by filter the metric's value, NaN for "no value"; `missing` is
    `REFUSED` or `FAILED` where there is no world."""

    by_filter: Mapping[str, float]
    missing: str | None = None


def measured(store: Store, worlds: Sequence[Evaluation], metric: str) -> list[Measured]:
    """What came of each world; all are done."""
    found = []
    for world in worlds:
        rows = store.read(world)
        if rows is None:  # another process has emptied the folder
            raise RunFailed(f"{store.folder}: the results of {world.group} are gone")
        found.append(_of_metric(rows, metric))
    return found


def _of_metric(rows: pl.DataFrame, metric: str) -> Measured:
    names = set(rows["metric"])
    for missing in (REFUSED, FAILED):
        if missing in names:
            return Measured({}, missing)
    own = rows.filter(metric=metric).select("filter", "value").iter_rows()
    return Measured({name: math.nan if value is None else value for name, value in own})
