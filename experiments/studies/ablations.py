"""Simulated traffic with gaps into rows of scores, for every value of MD's free choices."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from experiments.drift import drift
from experiments.occlusion import OcclusionProtocol
from experiments.scoring import score
from experiments.studies.scale import Scale
from experiments.studies.seeds import SeedJob, of_traffic
from experiments.studies.variants import variants
from experiments.studies.worlds import drifts
from mdkf import DETECTORS, Trace, Tracker

STUDY = "ablations"
DETECTOR = "virconv"
OCCLUSION = "mid:20"
MOST_SEEDS = 12
"""Of a scenario; 216 worlds in all."""

SCORES = ("hota", "mota", "lost", "deleted")


@dataclass(frozen=True)
class Ablation(SeedJob):
    """One seed of a scenario, tracked by every variant."""

    @property
    def labels(self) -> Mapping[str, str]:
        """The same for all."""
        return {"study": STUDY, "detector": DETECTOR, "occlusion": OCCLUSION}

    def measured(self, trace: Trace) -> Iterator[dict[str, Any]]:
        """Scores, `drift` [m] of all gaps and by true regime as they begin."""
        protocol = OcclusionProtocol.parse(OCCLUSION)
        occluded = protocol.apply(self.detected(DETECTOR))
        for one in {one.name: one for one in variants()}.values():
            settings = replace(DETECTORS[DETECTOR], **one.rules)
            scores = score(trace, Tracker(one.estimator, settings).run(occluded), protocol)
            summary = scores.summary()
            found = [{"metric": name, "value": summary[name]} for name in SCORES]
            # A filter alone knows no bound in a gap: its drift is the default's.
            if not one.rules and len(scores.gaps):
                alone = drift(trace, occluded, scores.gaps, one.estimator, settings)
                found += drifts(scores.errors, alone, protocol.length)
            yield from ({"filter": one.name, **row} for row in found)


def jobs(scale: Scale) -> list[Ablation]:
    """A few seeds of every scenario."""
    return [Ablation(*one) for one in of_traffic(min(scale.worlds, MOST_SEEDS))]
