"""Motion models alone into rows of errors by true regime: over journeys in closed form, and of
every object of simulated traffic.

Errors of estimators alone (`experiments.alone`) in frames in which an object is detected, as it was
in the frame before: of the prediction, one step ahead, and of the posterior. What is counted is the
same for every filter.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

import sim_bridge
from experiments.alone import SETTLED, by_object, distance, run_lengths, steps
from experiments.jobs import ROWS, Job, as_rows
from experiments.studies import worlds
from experiments.studies.journeys import SCENARIO, journeys
from experiments.studies.scale import Scale
from mdkf import DETECTORS, estimator
from mdkf.tables import CLUTTER, REGIMES, UNKNOWN_REGIME, FloatArray

TRAFFIC = "alone"
JOURNEY = "journey"
"""Studies: objects of simulated traffic with a simulated detector; closed form, white noise."""

DETECTOR = "virconv"
FILTERS = ("cv", "ca", "cj", "imm", "imm-zero", "imm3", "imm3-zero", "md", "md3")
RETUNED = tuple(f"{name}-retuned" for name in ("cv", "ca", "cj", "imm", "imm-zero", "md"))
UNSETTLED = "detected for less than 1 s"
BINS = (*(name.replace("_", " ") for name in REGIMES[:UNKNOWN_REGIME]), UNSETTLED)
METRICS = ("predicted", "posterior")

BLOCK = 20
"""Journeys that are done at once: a filter takes as long for one as for all of them."""
MOST_JOURNEYS = 200
DRAWN_SEED = 0
DRAWN = ("cv", "ca", "cj", "md")
"""The seed and the filters whose errors are kept frame by frame."""


@dataclass(frozen=True)
class Alone:
    """One seed of a traffic scenario, each object's detections through filters of its own."""

    scenario: str
    seed: int
    detector: str = DETECTOR
    filters: tuple[str, ...] = (*FILTERS, *RETUNED)

    @property
    def group(self) -> str:
        """Shares its simulation with all that is done with the same world."""
        return worlds.group(self.scenario, self.seed)

    def key(self) -> Mapping[str, Any]:
        """All that decides the rows."""
        return {
            **{"study": TRAFFIC, "scenario": worlds.identity(self.scenario)},
            **{"seed": self.seed, "detector": self.detector, "filters": self.filters},
        }

    def rows(self) -> pl.DataFrame:
        """Mean errors [m] by filter, bin and metric; none if the seed was refused."""
        try:
            trace = worlds.simulated(self.scenario, self.seed)
        except sim_bridge.SeedRefused:
            return pl.DataFrame(schema=ROWS)
        found = worlds.detected(self.scenario, self.seed, self.detector)
        ids = np.unique(found.source[found.source != CLUTTER])
        measured = by_object(found, found.source, ids, "x", "y")
        truth = by_object(trace, trace.object_id, ids, "x", "y", "regime")
        binned = bins(measured, truth[..., 2])
        means: list[dict[str, Any]] = []
        for name in self.filters:
            own = errors(name, measured, truth[..., :2], trace.dt, self.detector)
            means += _means(name, own, binned)
        return as_rows(
            means,
            study=TRAFFIC,
            scenario=self.scenario,
            seed=self.seed,
            detector=self.detector,
        )


@dataclass(frozen=True)
class Journeys:
    """Some seeds of the journey in closed form, from `first` on."""

    first: int
    seeds: int
    detector: str = DETECTOR
    filters: tuple[str, ...] = FILTERS

    @property
    def group(self) -> str:
        """Shares nothing."""
        return f"{SCENARIO}, seeds {self.first} to {self.first + self.seeds - 1}"

    def key(self) -> Mapping[str, Any]:
        """All that decides the rows."""
        return {
            **{"study": JOURNEY, "scenario": worlds.identity(SCENARIO)},
            **{"first": self.first, "seeds": self.seeds, "detector": self.detector},
            **{"filters": self.filters, "drawn": (DRAWN_SEED, DRAWN)},
        }

    def rows(self) -> pl.DataFrame:
        """Mean errors [m] by seed, filter, bin and metric; of the drawn seed also by frame, with
        the `speed` [m/s], `acceleration` [m/s2] and `regime` (a code) of the `truth`."""
        seeds = range(self.first, self.first + self.seeds)
        driven = journeys(seeds, DETECTORS[self.detector])
        regime = np.stack([trace.regime.astype(float) for trace in driven.traces], axis=1)
        binned = bins(driven.measured, regime)
        found = []
        for name in self.filters:
            own = errors(name, driven.measured, driven.true, driven.dt, self.detector)
            for place, seed in enumerate(seeds):
                one = {metric: values[:, [place]] for metric, values in own.items()}
                told = list(_means(name, one, binned[:, [place]]))
                if seed == DRAWN_SEED and name in DRAWN:
                    told += _over_time(name, one)
                found += [{"seed": seed, **row} for row in told]
        if DRAWN_SEED in seeds:
            trace = driven.traces[DRAWN_SEED - self.first]
            speed = np.hypot(trace.vx, trace.vy)
            along = (trace.ax * trace.vx + trace.ay * trace.vy) / np.where(speed > 0, speed, 1.0)
            truth = {"speed": speed, "acceleration": along, "regime": trace.regime.astype(float)}
            shown = {metric: values[:, None] for metric, values in truth.items()}
            found += [{"seed": DRAWN_SEED, **row} for row in _over_time("truth", shown)]
        return as_rows(found, study=JOURNEY, scenario=SCENARIO, detector=self.detector)


def errors(
    name: str, measured: FloatArray, true: FloatArray, dt: float, detector: str
) -> dict[str, FloatArray]:
    """Errors of a filter's predictions and posteriors (n_frames, n_objects) [m], NaN where there
    is none, of objects measured and truly at (n_frames, n_objects, 2) [m]. detector: whose
    variances the filter is told."""
    chosen = estimator(name)
    predicted, posterior = np.full(true.shape, np.nan), np.full(true.shape, np.nan)
    for step in steps(measured, dt, chosen, DETECTORS[detector]):
        predicted[step.frame, step.objects] = step.predicted
        posterior[step.frame, step.objects] = chosen.position(step.state)
    return dict(zip(METRICS, (distance(predicted, true), distance(posterior, true)), strict=True))


def bins(measured: FloatArray, regime: FloatArray) -> FloatArray:
    """Place in `BINS` of each frame and object (n_frames, n_objects), NaN where it does not count.

    measured (n_frames, n_objects, 2), NaN where not detected; regime (n_frames, n_objects).
    """
    run = run_lengths(measured)
    return np.select([run > SETTLED, run > 1], [regime, np.full(run.shape, len(BINS) - 1)], np.nan)


def _means(
    name: str, errors: Mapping[str, FloatArray], binned: FloatArray
) -> Iterator[dict[str, Any]]:
    for place, told in enumerate(BINS):
        rows = binned == place
        if rows.any():
            for metric, values in errors.items():
                value = float(values[rows].mean())
                yield {"filter": name, "bin": told, "metric": metric, "value": value} | {
                    "n": int(rows.sum())
                }


def _over_time(name: str, values: Mapping[str, FloatArray]) -> Iterator[dict[str, Any]]:
    """Rows by frame of the values (n_frames, 1) of one object."""
    for metric, own in values.items():
        for k, value in enumerate(own[:, 0]):
            yield {"filter": name, "bin": f"frame {k}", "metric": metric, "value": value, "n": 1}


def jobs(scale: Scale) -> list[Job]:
    """Journeys in blocks, and every seed of traffic."""
    count = min(scale.monte_carlo, MOST_JOURNEYS)
    found: list[Job] = [Journeys(k, min(BLOCK, count - k)) for k in range(0, count, BLOCK)]
    found += [Alone(name, seed) for seed in range(scale.worlds) for name in worlds.traffic()]
    return found
