"""All that decides a search: what is sought, where, with how many worlds."""

from dataclasses import dataclass

from experiments.occlusion import OcclusionProtocol
from experiments.population import GapTruth
from experiments.search.evaluation import Evaluation
from experiments.search.goal import Goal
from experiments.search.space import Space
from scenarios import Scenario

TRIALS = 32
SEEDS = 3
CHECK_SEEDS = 20
CANDIDATES = 3


@dataclass(frozen=True)
class Plan:
    """trials: points that are tried. seeds: worlds of each, of the seeds 0 .. seeds - 1, the same
    for all. check_seeds: fresh worlds of each candidate, of the seeds that follow. candidates: how
    many are checked, at most. sampler_seed: of the optimiser's random numbers. settings: name of
    the tracker's settings."""

    goal: Goal
    space: Space
    occlusion: OcclusionProtocol
    detector: str = "pointrcnn"
    settings: str = "pointrcnn"
    gap_truth: GapTruth = "keep"
    trials: int = TRIALS
    seeds: int = SEEDS
    check_seeds: int = CHECK_SEEDS
    candidates: int = CANDIDATES
    sampler_seed: int = 0

    @property
    def search_seeds(self) -> range:
        """Those that the optimiser sees."""
        return range(self.seeds)

    @property
    def fresh_seeds(self) -> range:
        """Those that it does not."""
        return range(self.seeds, self.seeds + self.check_seeds)

    def worlds(self, scenario: Scenario, seeds: range) -> list[Evaluation]:
        """One world for each seed."""
        rules = (self.detector, self.settings, self.occlusion, self.gap_truth)
        return [Evaluation(scenario, seed, self.goal.filters, *rules) for seed in seeds]
