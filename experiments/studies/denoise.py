"""Detections, posteriors and post-processed measurements against truth, as jobs.

What stands for an object's position (paper, section on the motion dynamics): the detection z, the
posterior H x_{t|t}, or the post-processed measurement z^ = z - H K diag(D), D read in three ways
(`mdkf.MotionDynamics`); the fourth reading, `raw`, is the detection. Each object's own detections
go into its own filter (`experiments.alone`). Every detection counts; told apart are those after a
second of detections: before it, most of the error is the start's.
"""

from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

import sim_bridge
from experiments.alone import SETTLED, by_object, distance, run_lengths, steps
from experiments.bins import EVERYTHING
from experiments.estimates import RECORDED
from experiments.jobs import Job, as_rows
from experiments.kitti.recordings import contents, folders_there, sequences_in
from experiments.studies.journeys import JourneyJob, Journeys
from experiments.studies.recorded import SPLIT
from experiments.studies.seeds import SeedJob
from mdkf import DETECTORS, Detections, MotionDynamics, Trace
from mdkf.motion_dynamics import Denoise
from mdkf.tables import CLUTTER, BoolArray, FloatArray
from scenarios.kitti import kitti_root

TRAFFIC = "denoise"
WHITE = "denoise-white"
ONE_CAR = "denoise-car"
"""Studies: simulated traffic with a simulated detector; closed form with white noise of the
variances that the filter is told; one car of that traffic by frame."""

READINGS: tuple[Denoise, ...] = ("literal", "innovation", "posterior")
ESTIMATES = ("detection", "posterior", *(f"post-processed ({name})" for name in READINGS))
"""What is compared, as `filter` of the rows. The posterior is that of the literal reading's
filter."""

AFTER_START = "detected for 1 s"
"""The bin of what is settled."""


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of every estimate by name (n,) [m], and whether they are settled (n,)."""

    of: Mapping[str, FloatArray]
    settled: BoolArray

    @staticmethod
    def joined(parts: Sequence["Errors"]) -> "Errors":
        """Those of several sequences."""
        whole = {name: np.concatenate([part.of[name] for part in parts]) for name in ESTIMATES}
        return Errors(whole, np.concatenate([part.settled for part in parts]))

    def take(self, rows: slice) -> "Errors":
        """Some of them."""
        return Errors({name: own[rows] for name, own in self.of.items()}, self.settled[rows])

    def summary(self) -> Iterator[dict[str, Any]]:
        """`mse`, the mean of the squared errors [m2], and `spread`, the standard deviation of the
        errors [m], of each estimate in each bin."""
        everywhere = np.ones(len(self.settled), dtype=np.bool_)
        for told, rows in ((EVERYTHING, everywhere), (AFTER_START, self.settled)):
            for name, errors in self.of.items():
                own = errors[rows]
                if len(own):
                    row = {"filter": name, "bin": told, "n": len(own)}
                    yield {**row, "metric": "mse", "value": float(np.mean(own**2))}
                    yield {**row, "metric": "spread", "value": float(np.std(own))}


@dataclass(frozen=True)
class Denoised(SeedJob):
    """One seed of a traffic scenario."""

    detector: str

    @property
    def labels(self) -> Mapping[str, str]:
        """By detector."""
        return {"study": TRAFFIC, "detector": self.detector}

    def measured(self, trace: Trace) -> Iterator[dict[str, Any]]:
        """`mse` [m2] and `spread` [m] of each estimate."""
        return table_errors(trace, self.detected(self.detector), self.detector).summary()


@dataclass(frozen=True)
class OneCar(SeedJob):
    """The car with the most detections in one seed of a traffic scenario (of several the one with
    the lowest id)."""

    detector: str

    @property
    def labels(self) -> Mapping[str, str]:
        """By detector."""
        return {"study": ONE_CAR, "detector": self.detector}

    def measured(self, trace: Trace) -> Iterator[dict[str, Any]]:
        """`mse` [m2] and `spread` [m] of each estimate, and its `error` [m] by frame with a
        detection, counted from 0."""
        found = self.detected(self.detector)
        ids, counts = np.unique(found.source[found.source != CLUTTER], return_counts=True)
        own = found.take(found.source == ids[np.argmax(counts)])
        errors = table_errors(trace, own, self.detector)
        yield from errors.summary()
        for name, values in errors.of.items():
            for k, error in enumerate(values):
                where = {"filter": name, "bin": f"frame {k}", "n": 1}
                yield {**where, "metric": "error", "value": error}


@dataclass(frozen=True)
class DenoisedJourneys(JourneyJob):
    """Some seeds of the journey in closed form."""

    @property
    def study(self) -> str:
        """White noise."""
        return WHITE

    def measured(self, driven: Journeys) -> Iterator[dict[str, Any]]:
        """`mse` [m2] and `spread` [m] of each estimate and seed."""
        errors = estimate_errors(driven.measured, driven.true, driven.dt, self.detector)
        n_frames = len(driven.measured)
        for place, seed in enumerate(self.numbers):
            own = errors.take(slice(place * n_frames, (place + 1) * n_frames))
            yield from ({"seed": seed, **row} for row in own.summary())


@dataclass(frozen=True)
class DenoisedRecordings(Job):
    """The validation sequences of KITTI with recorded detections; truth is the labels. contents:
    SHA-256 of the recordings."""

    detector: str
    contents: str

    @property
    def group(self) -> str:
        """Shares nothing."""
        return f"KITTI {SPLIT} with {self.detector}, denoised"

    def key(self) -> Mapping[str, Any]:
        """All that decides the rows."""
        return {"study": RECORDED, "split": SPLIT, **vars(self)}

    def rows(self) -> pl.DataFrame:
        """`mse` [m2] and `spread` [m] of each estimate over all sequences, and over all but one."""
        root, folder = kitti_root(), folders_there()[self.detector]
        by_sequence = {}
        for name in sequences_in(root, SPLIT):
            trace = sim_bridge.kitti_trace(root, name)
            found = sim_bridge.kitti_detections(root, folder, name)
            by_sequence[name] = table_errors(trace, found, self.detector)
        parts = {SPLIT: list(by_sequence.values())}
        for left_out in by_sequence:
            others = [errors for name, errors in by_sequence.items() if name != left_out]
            parts[f"{SPLIT}-{left_out}"] = others
        measured = [
            {"scenario": told, **row}
            for told, errors in parts.items()
            for row in Errors.joined(errors).summary()
        ]
        return as_rows(measured, study=RECORDED, seed=0, detector=self.detector)


def recordings(detectors: Container[str]) -> list[DenoisedRecordings]:
    """A job for each of some detectors of which there are recorded detections."""
    there = folders_there()
    return [DenoisedRecordings(name, contents(there[name])) for name in there if name in detectors]


def table_errors(trace: Trace, found: Detections, detector: str) -> Errors:
    """Errors in all detections of objects, sorted by object and frame."""
    ids = np.unique(found.source[found.source != CLUTTER])
    measured = by_object(found, found.source, ids, "x", "y")
    true = by_object(trace, trace.object_id, ids, "x", "y")
    return estimate_errors(measured, true, trace.dt, detector)


def estimate_errors(measured: FloatArray, true: FloatArray, dt: float, detector: str) -> Errors:
    """Errors in all detections, sorted by object and frame.

    measured, true (n_frames, n_objects, 2) [m], measured NaN where not detected; detector: whose
    variances the filters are told.
    """
    estimated = {name: np.full(measured.shape, np.nan) for name in ESTIMATES}
    estimated["detection"] = measured
    for reading in READINGS:
        chosen = MotionDynamics(denoise=reading)
        for step in steps(measured, dt, chosen, DETECTORS[detector]):
            place = step.frame, step.objects
            estimated[f"post-processed ({reading})"][place] = chosen.denoised(step.state)
            if reading == READINGS[0]:
                estimated["posterior"][place] = chosen.position(step.state)
    lengths = run_lengths(measured).T
    seen = lengths > 0
    errors = {name: distance(own, true).T[seen] for name, own in estimated.items()}
    return Errors(errors, lengths[seen] > SETTLED)
