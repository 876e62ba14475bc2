"""A plan into trials: a design that fills the space, then Optuna's tree-structured Parzen
estimator.

Trials are asked for and told in batches of a fixed size, so that neither the number of processes
nor their timing changes which points are tried. Worlds are kept by what decides them: a search that
was interrupted tries the same points again, finds them done, and goes on.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from experiments.jobs import Store
from experiments.search.evaluation import FAILED, REFUSED, Evaluation, Measured, measured
from experiments.search.plan import Plan
from mdkf.tables import FloatArray

BATCH = 8
"""Trials asked for at once."""
DESIGN = 0.5
"""Share of the trials that the optimiser does not choose: what is wrong in a twentieth of an axis'
width has to be hit before anything can climb to it."""

Done = Callable[[Sequence[Evaluation]], None]
"""Does the worlds that are missing."""


@dataclass(frozen=True)
class Values:
    """The goal's value of each world, by seed (n,), NaN for "no value", and the metric's by filter.

    refused, failed: worlds that are not there.
    """

    goal: FloatArray
    by_filter: Mapping[str, FloatArray]
    refused: int
    failed: int

    @property
    def n(self) -> int:
        """Worlds with a value."""
        return int(np.isfinite(self.goal).sum())

    @property
    def mean(self) -> float:
        """Over the worlds with a value; NaN if there is none."""
        return _mean(self.goal)

    def means(self) -> dict[str, float]:
        """Of the metric, by filter, over the same worlds."""
        there = np.isfinite(self.goal)
        return {name: _mean(values[there]) for name, values in self.by_filter.items()}


@dataclass(frozen=True)
class Trial:
    """A point that was tried on the search's seeds."""

    number: int
    chosen_by: str
    point: Mapping[str, float]
    values: Values

    @property
    def value(self) -> float:
        """What the optimiser climbs; NaN where most worlds have no value: the mean of the few that
        do is their luck."""
        counts = 2 * self.values.n >= len(self.values.goal)
        return self.values.mean if counts else math.nan


def trials(plan: Plan, store: Store, do: Done) -> Iterator[list[Trial]]:
    """Batches of trials, each done before the next is chosen."""
    import optuna  # a second that other commands need not wait for

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    # Several are asked for before any is told: without the liar they would crowd in one place.
    sampler = optuna.samplers.TPESampler(seed=plan.sampler_seed, constant_liar=True)
    study = optuna.create_study(sampler=sampler, direction="maximize")
    # One axis for the optimiser is from 0 to 1 whatever its unit.
    axes: dict[str, optuna.distributions.BaseDistribution] = {
        axis.name: optuna.distributions.FloatDistribution(0.0, 1.0) for axis in plan.space.axes
    }
    design = _design(plan)
    for unit in design:
        study.enqueue_trial(dict(zip(axes, map(float, unit), strict=True)))
    for first in range(0, plan.trials, BATCH):
        asked = [study.ask(axes) for _ in range(first, min(first + BATCH, plan.trials))]
        points = [plan.space.point([one.params[name] for name in axes]) for one in asked]
        worlds = [plan.worlds(plan.space.at(point), plan.search_seeds) for point in points]
        do([world for own in worlds for world in own])
        batch = []
        for k, (one, point, own) in enumerate(zip(asked, points, worlds, strict=True)):
            number = first + k
            chosen_by = "design" if number < len(design) else "optimiser"
            trial = Trial(number, chosen_by, point, values_of(plan, store, own))
            if math.isnan(trial.value):
                study.tell(one, state=optuna.trial.TrialState.FAIL)
            else:
                study.tell(one, trial.value)
            batch.append(trial)
        yield batch


def values_of(plan: Plan, store: Store, worlds: Sequence[Evaluation]) -> Values:
    """What the worlds, which are done, have given."""
    found: list[Measured] = measured(store, worlds, plan.goal.metric)
    return Values(
        np.array([plan.goal.value(one.by_filter) for one in found]),
        {
            name: np.array([one.by_filter.get(name, math.nan) for one in found])
            for name in plan.goal.filters
        },
        refused=sum(one.missing == REFUSED for one in found),
        failed=sum(one.missing == FAILED for one in found),
    )


def _design(plan: Plan) -> FloatArray:
    """Places (n, axes) between 0 and 1 of a scrambled Sobol sequence: along every axis evenly."""
    n = math.ceil(DESIGN * plan.trials)
    random = np.random.default_rng(plan.sampler_seed)
    sequence = qmc.Sobol(len(plan.space.axes), seed=random)
    places: FloatArray = sequence.random_base2(max(math.ceil(math.log2(n)), 0))[:n]
    return places


def _mean(values: FloatArray) -> float:
    kept = values[np.isfinite(values)]
    return float(kept.mean()) if len(kept) else math.nan
