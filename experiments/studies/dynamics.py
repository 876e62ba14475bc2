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

from experiments.alone import SETTLED, by_object, distance, run_lengths, steps
from experiments.jobs import Job
from experiments.studies.journeys import JourneyJob, Journeys, blocks
from experiments.studies.scale import Scale
from experiments.studies.seeds import SeedJob, of_traffic
from mdkf import DETECTORS, Trace, estimator
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

DRAWN_SEED = 0
DRAWN = ("cv", "ca", "cj", "md")
"""The seed and the filters whose errors are kept frame by frame."""


@dataclass(frozen=True)
class Alone(SeedJob):
    """One seed of a traffic scenario, each object's detections through filters of its own."""

    @property
    def labels(self) -> Mapping[str, str]:
        """The same for all."""
        return {"study": TRAFFIC, "detector": DETECTOR}

    def measured(self, trace: Trace) -> Iterator[dict[str, Any]]:
        """Mean errors [m] by filter, bin and metric."""
        found = self.detected(DETECTOR)
        ids = np.unique(found.source[found.source != CLUTTER])
        seen = by_object(found, found.source, ids, "x", "y")
        truth = by_object(trace, trace.object_id, ids, "x", "y", "regime")
        binned = bins(seen, truth[..., 2])
        for name in (*FILTERS, *RETUNED):
            own = errors(name, seen, truth[..., :2], trace.dt, DETECTOR)
            yield from _means(name, own, binned)


@dataclass(frozen=True)
class Journey(JourneyJob):
    """Some seeds of the journey, all filters on each."""

    @property
    def study(self) -> str:
        """Closed form."""
        return JOURNEY

    def measured(self, driven: Journeys) -> Iterator[dict[str, Any]]:
        """Mean errors [m] by seed, filter, bin and metric; of the drawn seed also by frame, with
        the `speed` [m/s], `acceleration` [m/s2] and `regime` (a code) of the `truth`."""
        regime = np.stack([trace.regime.astype(float) for trace in driven.traces], axis=1)
        binned = bins(driven.measured, regime)
        for name in FILTERS:
            own = errors(name, driven.measured, driven.true, driven.dt, self.detector)
            for place, seed in enumerate(self.numbers):
                one = {metric: values[:, [place]] for metric, values in own.items()}
                told = list(_means(name, one, binned[:, [place]]))
                if seed == DRAWN_SEED and name in DRAWN:
                    told += _over_time(name, one)
                yield from ({"seed": seed, **row} for row in told)
        if DRAWN_SEED in self.numbers:
            trace = driven.traces[DRAWN_SEED - self.first]
            speed = np.hypot(trace.vx, trace.vy)
            along = (trace.ax * trace.vx + trace.ay * trace.vy) / np.where(speed > 0, speed, 1.0)
            truth = {"speed": speed, "acceleration": along, "regime": trace.regime.astype(float)}
            shown = {metric: values[:, None] for metric, values in truth.items()}
            yield from ({"seed": DRAWN_SEED, **row} for row in _over_time("truth", shown))


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
    found: list[Job] = [Journey(*block, DETECTOR) for block in blocks(scale)]
    return [*found, *(Alone(*one) for one in of_traffic(scale.worlds))]
