"""Closed-form journeys, several seeds at once, measured with white noise: each seed a single car
that speeds up, slows down and stands at random, seen in every frame."""

from dataclasses import dataclass

import numpy as np

import scenarios
import sim_bridge
from mdkf import Trace, TrackerSettings
from mdkf.tables import FloatArray
from sim_bridge.randomness import stream

SCENARIO = "journey"


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
