"""Closed-form journeys, several seeds at once, measured with white noise: each seed a single car
that speeds up, slows down and stands at random, seen in every frame."""

from abc import abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

import scenarios
import sim_bridge
from experiments.jobs import Job, as_rows
from experiments.studies.scale import Scale
from experiments.studies.seeds import identity
from mdkf import DETECTORS, Trace, TrackerSettings
from mdkf.tables import FloatArray
from sim_bridge.randomness import stream

SCENARIO = "journey"


BLOCK = 20
"""Journeys that are done at once: a filter takes as long for one as for all of them."""
MOST = 200


@dataclass(frozen=True)
class JourneyJob(Job):
    """What is done with some seeds of the journey, from `first` on. detector: whose variances the
    noise has, and the filters are told."""

    first: int
    seeds: int
    detector: str

    @property
    @abstractmethod
    def study(self) -> str:
        """Of the rows."""

    @abstractmethod
    def measured(self, driven: "Journeys") -> Iterable[Mapping[str, Any]]:
        """The rows of the journeys, by their own columns."""

    @property
    def numbers(self) -> range:
        """The seeds."""
        return range(self.first, self.first + self.seeds)

    @property
    def group(self) -> str:
        """Shares nothing."""
        return f"{SCENARIO}, {self.study}, seeds {self.first} to {self.numbers[-1]}"

    def key(self) -> Mapping[str, Any]:
        """All that decides the rows."""
        return {"study": self.study, "scenario": identity(SCENARIO), **vars(self)}

    def rows(self) -> pl.DataFrame:
        """What is measured."""
        driven = journeys(self.numbers, DETECTORS[self.detector])
        everywhere = {"study": self.study, "scenario": SCENARIO, "detector": self.detector}
        return as_rows(self.measured(driven), **everywhere)


def blocks(scale: Scale) -> list[tuple[int, int]]:
    """The first seed of each block of a scale, and how many there are in it."""
    count = min(scale.monte_carlo, MOST)
    return [(first, min(BLOCK, count - first)) for first in range(0, count, BLOCK)]


@dataclass(frozen=True, eq=False)
class Journeys:
    """Journeys of n seeds over T frames of dt [s]: true and measured positions (T, n, 2) [m]."""

    traces: tuple[Trace, ...]
    true: FloatArray
    measured: FloatArray
    dt: float


def journeys(seeds: range, settings: TrackerSettings) -> Journeys:
    """The journeys of some seeds, measured with white noise of the settings' variances."""
    scenario = scenarios.load(SCENARIO)
    traces = tuple(sim_bridge.simulate(scenario, seed) for seed in seeds)
    true = np.stack([np.column_stack([trace.x, trace.y]) for trace in traces], axis=1)
    draws = [
        stream("white-noise", SCENARIO, seed).standard_normal((len(true), 2)) for seed in seeds
    ]
    white = np.stack(draws, axis=1) * np.sqrt([settings.x_var, settings.y_var])
    return Journeys(traces, true, true + white, traces[0].dt)
