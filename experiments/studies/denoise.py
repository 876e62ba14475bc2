"""Detections, posteriors and post-processed measurements against truth, as jobs.

What stands for an object's position (paper, section on the motion dynamics): the detection z, the
posterior H x_{t|t}, or the post-processed measurement z^ = z - H K diag(D), D read in three ways
(`mdkf.MotionDynamics`); the fourth reading, `raw`, is the detection. Each object's own detections
go into its own filter (`experiments.alone`). Every detection counts; told apart are those after a
second of detections: before it, most of the error is the start's.
"""

import hashlib
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

import sim_bridge
from experiments.alone import SETTLED, by_object, distance, run_lengths, steps
from experiments.bins import EVERYTHING
from experiments.estimates import RECORDED
from experiments.jobs import ROWS, as_rows
from experiments.kitti.recordings import sequences_in
from experiments.studies import worlds
from experiments.studies.journeys import SCENARIO, journeys
from mdkf import DETECTORS, Detections, MotionDynamics, Trace
from mdkf.motion_dynamics import Denoise
from mdkf.settings import FOLDERS
from mdkf.tables import CLUTTER, BoolArray, FloatArray
from scenarios.kitti import kitti_root
from sim_bridge.kitti import recording_identity

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

SPLIT = "val"


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
class Denoised:
    """One seed of a traffic scenario."""

    scenario: str
    seed: int
    detector: str

    @property
    def group(self) -> str:
        """Shares its simulation with all that is done with the same world."""
        return worlds.group(self.scenario, self.seed)

    def key(self) -> Mapping[str, Any]:
        """All that decides the rows."""
        return {
            "study": TRAFFIC,
            "scenario": worlds.identity(self.scenario),
            "seed": self.seed,
            "detector": self.detector,
        }

    def rows(self) -> pl.DataFrame:
        """`mse` [m2] and `spread` [m] of each estimate; none if the seed was refused."""
        try:
            trace = worlds.simulated(self.scenario, self.seed)
        except sim_bridge.SeedRefused:
            return pl.DataFrame(schema=ROWS)
        found = worlds.detected(self.scenario, self.seed, self.detector)
        return as_rows(
            table_errors(trace, found, self.detector).summary(),
            study=TRAFFIC,
            scenario=self.scenario,
            seed=self.seed,
            detector=self.detector,
        )


@dataclass(frozen=True)
class OneCar:
    """The car with the most detections in one seed of a traffic scenario (of several the one with
    the lowest id)."""

    scenario: str
    seed: int
    detector: str

    @property
    def group(self) -> str:
        """Shares its simulation with all that is done with the same world."""
        return worlds.group(self.scenario, self.seed)

    def key(self) -> Mapping[str, Any]:
        """All that decides the rows."""
        return {
            "study": ONE_CAR,
            "scenario": worlds.identity(self.scenario),
            "seed": self.seed,
            "detector": self.detector,
        }

    def rows(self) -> pl.DataFrame:
        """`mse` [m2] and `spread` [m] of each estimate, and its `error` [m] by frame with a
        detection, counted from 0; none if the seed was refused."""
        try:
            trace = worlds.simulated(self.scenario, self.seed)
        except sim_bridge.SeedRefused:
            return pl.DataFrame(schema=ROWS)
        found = worlds.detected(self.scenario, self.seed, self.detector)
        ids, counts = np.unique(found.source[found.source != CLUTTER], return_counts=True)
        own = found.take(found.source == ids[np.argmax(counts)])
        errors = table_errors(trace, own, self.detector)
        by_frame = [
            {"filter": name, "bin": f"frame {k}", "metric": "error", "value": error, "n": 1}
            for name, values in errors.of.items()
            for k, error in enumerate(values)
        ]
        return as_rows(
            [*errors.summary(), *by_frame],
            study=ONE_CAR,
            scenario=self.scenario,
            seed=self.seed,
            detector=self.detector,
        )


@dataclass(frozen=True)
class DenoisedJourneys:
    """Some seeds of the journey in closed form, from `first` on."""

    first: int
    seeds: int
    detector: str

    @property
    def group(self) -> str:
        """Shares nothing."""
        return f"{SCENARIO}, seeds {self.first} to {self.first + self.seeds - 1}, denoised"

    def key(self) -> Mapping[str, Any]:
        """All that decides the rows."""
        return {
            "study": WHITE,
            "scenario": worlds.identity(SCENARIO),
            "first": self.first,
            "seeds": self.seeds,
            "detector": self.detector,
        }

    def rows(self) -> pl.DataFrame:
        """`mse` [m2] and `spread` [m] of each estimate and seed."""
        seeds = range(self.first, self.first + self.seeds)
        driven = journeys(seeds, DETECTORS[self.detector])
        errors = estimate_errors(driven.measured, driven.true, driven.dt, self.detector)
        n_frames = len(driven.measured)
        found = [
            {"seed": seed, **row}
            for place, seed in enumerate(seeds)
            for row in errors.take(slice(place * n_frames, (place + 1) * n_frames)).summary()
        ]
        return as_rows(found, study=WHITE, scenario=SCENARIO, detector=self.detector)


@dataclass(frozen=True)
class DenoisedRecordings:
    """The validation sequences of KITTI with recorded detections; truth is the labels."""

    root: Path
    folder: Path
    detector: str

    @property
    def group(self) -> str:
        """Shares nothing."""
        return f"KITTI {SPLIT} with {self.detector}, denoised"

    def key(self) -> Mapping[str, Any]:
        """All that decides the rows."""
        own = {"split": SPLIT, "detector": self.detector}
        return {"study": RECORDED, **own, "files": _identity(self.root, self.folder)}

    def rows(self) -> pl.DataFrame:
        """`mse` [m2] and `spread` [m] of each estimate over all sequences, and over all but one."""
        by_sequence = {}
        for name in sequences_in(self.root, SPLIT):
            trace = sim_bridge.kitti_trace(self.root, name)
            found = sim_bridge.kitti_detections(self.root, self.folder, name)
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
    root = kitti_root()
    folders: dict[str, Path] = {}
    for path in sorted((root / "detections").glob("*/")):
        folders.setdefault(FOLDERS.get(path.name, path.name), path)
    own = [(name, path) for name, path in folders.items() if name in detectors]
    return [DenoisedRecordings(root, path, name) for name, path in own]


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


@cache
def _identity(root: Path, folder: Path) -> str:
    """SHA-256 of all files that are read."""
    digest = hashlib.sha256()
    for name in sequences_in(root, SPLIT):
        digest.update(recording_identity(root, name).encode())
        digest.update(hashlib.sha256((folder / f"{name}.txt").read_bytes()).digest())
    return digest.hexdigest()
