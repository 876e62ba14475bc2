"""Scenes to look at: a car that stands, and a large vehicle that drives past and hides it.

Which car and when is chosen by the truth and the detections alone: of the first seed that has one,
the standing car that a moving object, taller than the sensor, hides for 1 to 4 s, nearest to the
sensor as it is hidden. No filter's error is looked at.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import polars as pl

import sim_bridge
from experiments.engine import RunFailed
from experiments.gaps import Gaps
from experiments.jobs import Job, as_rows
from experiments.phases import gap_errors
from experiments.playback.scene import estimates, played_frames
from experiments.population import SCORED_RANGE, SCORED_VISIBLE
from experiments.studies.seeds import detected, identity, simulated
from mdkf import Detections, Trace, Tracker, Tracks, estimator
from mdkf.tables import KINDS, REGIMES
from sim_bridge.frames import frames_of
from sim_bridge.line_of_sight import visible_fraction

STUDY = "showcase"
SCENARIOS = ("passing_bus", "bus_stop", "passing_van")
FILTERS = ("ca", "imm", "imm-zero", "md")
DETECTOR = "pointrcnn"
ESTIMATES = ("x", "y", "vx", "vy", "error", "major", "minor")
"""Columns of `experiments.playback.scene.estimates` that are kept, besides the diagnostics."""
SEEDS = range(10)
"""Tried one after the other."""

HIDDEN = 1.0, 4.0
"""How long the car is hidden, at least and at most [s]."""
BEFORE, AFTER = 2.0, 1.0
"""How long it stands before and afterwards, at least [s]."""
DETECTED = 0.75
"""Share of the frames then in which it is detected, at least."""


@dataclass(frozen=True)
class Hidden:
    """A car that is hidden: from frame start on it is not detected, at stop it is again; the object
    that hides it half-way, and the distance of the car from the sensor as it begins [m]."""

    distance: float
    object_id: int
    start: int
    stop: int
    by: int

    @property
    def gap(self) -> tuple[int, int]:
        """Its first frame, and the first after it."""
        return self.start, self.stop


def hidden_cars(trace: Trace, detections: Detections) -> Iterator[Hidden]:
    """Every time that a standing car is hidden, and not detected, by something large that
    drives past."""
    least, most = (round(seconds / trace.dt) for seconds in HIDDEN)
    before, after = round(BEFORE / trace.dt), round(AFTER / trace.dt)
    distance = trace.sensor_distance()
    standing = (trace.kind == KINDS.index("car")) & (trace.regime == REGIMES.index("stationary"))
    for object_id in np.unique(trace.object_id[standing]).tolist():
        rows = trace.rows_of(object_id)
        detected = np.isin(trace.frame[rows], detections.frame[detections.rows_of(object_id)])
        unseen = (trace.visible[rows] < SCORED_VISIBLE) & ~detected
        edges = np.flatnonzero(np.diff(unseen, prepend=False, append=False))
        for begin, end in edges.reshape(-1, 2).tolist():
            first, last = begin - before, end + after
            if not least <= end - begin <= most or first < 0 or last > len(rows):
                continue
            around = rows[first:last]
            start, stop = int(trace.frame[rows[begin]]), int(trace.frame[rows[end]])
            if (
                not standing[around].all()
                or np.ptp(trace.frame[around]) != last - first - 1
                or distance[rows[begin:end]].max() > SCORED_RANGE
                or min(detected[first:begin].mean(), detected[end:last].mean()) < DETECTED
            ):
                continue
            by = _hides(trace, object_id, (start + stop) // 2)
            if by is not None:
                yield Hidden(float(distance[rows[begin]]), object_id, start, stop, by)


def _hides(trace: Trace, object_id: int, frame: int) -> int | None:
    """The moving object, taller than the sensor, without which an object would be in view."""
    sensors, starts, boxes = frames_of(trace)
    ids = trace.object_id[trace.frame_rows(frame)]
    there = boxes[starts[frame] : starts[frame + 1]]
    own = int(np.flatnonzero(ids == object_id)[0])
    speed = np.hypot(trace.vx, trace.vy)[trace.frame_rows(frame)]
    top = there[:, 2] + there[:, 6] / 2
    for other in np.flatnonzero((speed > 0.5) & (top > sensors[frame, 2])).tolist():
        without = np.delete(there, other, axis=0)
        alone = visible_fraction(sensors[frame], without)[own - (other < own)]
        if other != own and alone >= SCORED_VISIBLE:
            return int(ids[other])
    return None


@dataclass(frozen=True)
class Scene(Job):
    """What is looked at: one scenario, of the first seed that has a hidden car."""

    scenario: str

    @property
    def group(self) -> str:
        """By itself."""
        return f"{self.scenario}, {STUDY}"

    def key(self) -> Mapping[str, Any]:
        """All that decides the rows."""
        return {
            "study": STUDY,
            "scenario": identity(self.scenario),
            "seeds": list(SEEDS),
            "detector": DETECTOR,
            "filters": FILTERS,
        }

    def rows(self) -> pl.DataFrame:
        """What each filter believes of the car in each frame (bin `frame K`): as
        `experiments.playback.scene.estimates` has them; and the `error` [m] of the followed track,
        mean over the frames in which the car is hidden (`gap`) and in the last of them (`end`)."""
        shown = show(self.scenario)
        measured = []
        for name in FILTERS:
            own = shown.errors.filter(filter=name)
            in_gap = own.filter(phase="gap")["error"]
            parts = {("gap", "error"): in_gap.mean(), ("end", "error"): in_gap[-1]}
            parts |= shown.estimates(name)
            measured += [
                {"filter": name, "bin": part, "metric": metric, "value": value, "n": 1}
                for (part, metric), value in parts.items()
            ]
        return as_rows(
            measured,
            study=STUDY,
            scenario=self.scenario,
            seed=shown.seed,
            detector=DETECTOR,
        )


@dataclass(frozen=True, eq=False)
class Shown:
    """A scene with all that is drawn of it; errors: `gap_errors` with a column `filter`."""

    scenario: str
    seed: int
    hidden: Hidden
    trace: Trace
    detections: Detections
    tracks: Mapping[str, Tracks]
    errors: pl.DataFrame

    def title(self) -> str:
        """What is seen."""
        kind = KINDS[self.trace.kind[self.trace.rows_of(self.hidden.by)[0]]]
        seconds = (self.hidden.stop - self.hidden.start) * self.trace.dt
        return (
            f"{self.scenario}, seed {self.seed}: a {kind} hides a standing car for {seconds:.1f} s"
        )

    def estimates(self, name: str) -> dict[tuple[str, str], float]:
        """A filter's numbers that the playback shows, by frame and name."""
        played = played_frames(self.trace, self.hidden.gap)
        subject = self.hidden.object_id, self.hidden.gap, played
        found = estimates(self.trace, self.tracks[name], *subject)
        columns = {metric: found[metric] for metric in ESTIMATES} | found["diagnostics"]
        return {
            (f"frame {frame}", metric): float(values[place])
            for metric, values in columns.items()
            for place, frame in enumerate(played)
        }


@cache
def show(scenario: str) -> Shown:
    """The scene of a scenario. Raises `RunFailed` if none of the seeds has one."""
    for seed in SEEDS:
        try:
            trace = simulated(scenario, seed)
        except sim_bridge.SeedRefused:
            continue
        detections = detected(scenario, seed, DETECTOR)
        found = min(hidden_cars(trace, detections), key=lambda h: h.distance, default=None)
        if found is None:
            continue
        tracks = {name: Tracker(estimator(name), DETECTOR).run(detections) for name in FILTERS}
        gaps = Gaps.of([(found.object_id, *found.gap)])
        errors = [
            gap_errors(trace, own, gaps).with_columns(filter=pl.lit(name))
            for name, own in tracks.items()
        ]
        return Shown(scenario, seed, found, trace, detections, tracks, pl.concat(errors))
    raise RunFailed(f"{scenario}: in seeds {SEEDS} nothing large drives past a standing car")
