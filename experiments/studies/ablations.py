"""Simulated traffic with gaps into rows of scores, for every value of MD's free choices."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import polars as pl

import sim_bridge
from experiments.drift import drift
from experiments.jobs import ROWS, as_rows
from experiments.occlusion import OcclusionProtocol
from experiments.score import score
from experiments.studies import worlds
from experiments.studies.scale import Scale
from experiments.studies.variants import variants
from mdkf import DETECTORS, Tracker

STUDY = "ablations"
DETECTOR = "virconv"
OCCLUSION = "mid:20"
MOST_SEEDS = 12
"""Of a scenario; 216 worlds in all."""

SCORES = ("hota", "mota", "lost", "deleted")


@dataclass(frozen=True)
class Ablation:
    """One seed of a scenario, tracked by every variant."""

    scenario: str
    seed: int

    @property
    def group(self) -> str:
        """Shares its simulation with the studies of the same seed."""
        return worlds.group(self.scenario, self.seed)

    def key(self) -> Mapping[str, Any]:
        """All that decides the rows."""
        return {
            "study": STUDY,
            "scenario": worlds.identity(self.scenario),
            "seed": self.seed,
            "variants": [[one.name, repr(one.estimator), dict(one.rules)] for one in variants()],
        }

    def rows(self) -> pl.DataFrame:
        """Scores, `drift` [m] of all gaps and by true regime as they begin; none if the seed was
        refused."""
        try:
            trace = worlds.simulated(self.scenario, self.seed)
        except sim_bridge.SeedRefused:
            return pl.DataFrame(schema=ROWS)
        protocol = OcclusionProtocol.parse(OCCLUSION)
        occluded = protocol.apply(worlds.detected(self.scenario, self.seed, DETECTOR))
        measured: list[dict[str, Any]] = []
        for one in {one.name: one for one in variants()}.values():
            settings = replace(DETECTORS[DETECTOR], **one.rules)
            scores = score(trace, Tracker(one.estimator, settings).run(occluded), protocol)
            summary = scores.summary()
            found = [{"metric": name, "value": summary[name]} for name in SCORES]
            # A filter alone knows no bound in a gap: its drift is the default's.
            if not one.rules and len(scores.gaps):
                alone = drift(trace, occluded, scores.gaps, one.estimator, settings)
                found += worlds.drifts(trace, alone, scores.gaps, protocol.length)
            measured += [{"filter": one.name, **row} for row in found]
        return as_rows(
            measured,
            study=STUDY,
            scenario=self.scenario,
            seed=self.seed,
            detector=DETECTOR,
            occlusion=OCCLUSION,
        )


def jobs(scale: Scale) -> list[Ablation]:
    """A few seeds of every scenario."""
    seeds = min(scale.worlds, MOST_SEEDS)
    return [Ablation(name, seed) for seed in range(seeds) for name in worlds.traffic()]
