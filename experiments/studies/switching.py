"""Simulated traffic into the filters' errors by true regime and phase, and into how well their
signals tell the true regimes apart.

Each object's own detections go into the estimator (`experiments.drift.followed`): perfect
association, no clutter, so that the filter is measured and not the tracker.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from experiments.bins import around_gaps
from experiments.drift import followed
from experiments.gaps import Gaps
from experiments.occlusion import OcclusionProtocol
from experiments.regime_switches import frames_since_change
from experiments.studies.scale import Scale
from experiments.studies.seeds import SeedJob, of_traffic
from experiments.studies.signals import separation, signals
from experiments.studies.worlds import ORDER_2, ORDER_3
from mdkf import DETECTORS, Detections, Estimator, Trace, estimator
from mdkf.tables import CLUTTER, REGIMES, BoolArray, FloatArray, IntArray
from sim_bridge.regimes import CONSTANT_VELOCITY

STUDY = "switching-worlds"
DETECTOR = "virconv"
OCCLUSION = "mid:20"
FILTERS = (*ORDER_2, "md-posterior", *ORDER_3)
"""With the one reading of MD whose w_a responds to switches in closed form
(`experiments.studies.switches`); all of them are told there."""

PHASES = ("in view", "gap", "after")
IN_VIEW, GAP, AFTER = range(len(PHASES))
"""Frames with a detection, away from gaps; the protocol's frames of a gap; the second after."""

CRAWL = 0.5
"""Speed below which an object that does not stand creeps; estimated, below which a filter without
a weight for it takes an object to stand [m/s]."""

KINDS = ("standstill", "creeping", "constant velocity", "manoeuvre")
"""True motions: who drives at constant velocity keeps speed and direction; all else is a
manoeuvre."""
STANDSTILL, CREEPING, STEADY, MANOEUVRE = range(len(KINDS))
TOLD = ("standstill", "constant velocity", "manoeuvre")
"""What a filter's signals may say."""
ENDS = ("rest", "constant velocity", "manoeuvre")
"""What an object does at an end of a gap; at rest it stands or creeps."""

TASKS: Mapping[str, tuple[tuple[int, ...], tuple[int, ...]]] = {
    "moving": ((CREEPING, STEADY, MANOEUVRE), (STANDSTILL,)),
    "driving": ((STEADY, MANOEUVRE), (STANDSTILL,)),
    "manoeuvre": ((MANOEUVRE,), (STEADY,)),
}
"""The kinds that a signal is asked to tell apart, those in which it should be larger first."""

AGE = 20
"""Frames in which an object has been followed before its signals are asked."""
RECENT = 20
"""Frames from a true change on in which it is recent."""


@dataclass(frozen=True)
class Followed(SeedJob):
    """One seed of a scenario, each object followed by every filter."""

    @property
    def labels(self) -> Mapping[str, str]:
        """The same for all."""
        return {"study": STUDY, "detector": DETECTOR, "occlusion": OCCLUSION}

    def measured(self, trace: Trace) -> Iterator[dict[str, Any]]:
        """By bin: `REGIME, PHASE` and `turning, PHASE`, by the true motion in that frame, `gap from
        END to END`, by that in a gap's first and last frame: `error`, the mean distance from the
        true position [m]; `KIND as TOLD`: `confusion` [% of KIND]; `all` and `recent`: `SIGNAL
        TASK`, the area under the curve."""
        protocol = OcclusionProtocol.parse(OCCLUSION)
        seen = self.detected(DETECTOR)
        occluded, gaps = protocol.apply(seen), protocol.gaps(seen)
        truth = truth_of(trace, occluded, gaps, protocol.length)
        for name in FILTERS:
            for one in scored(trace, truth, occluded, gaps, estimator(name)):
                yield {"filter": name, **one}


@dataclass(frozen=True, eq=False)
class Truth:
    """Of every row of a trace (n,): the places of its kind in `KINDS` and of its phase in `PHASES`,
    and for each task whether it is of the kinds to be told (1), of the others (0) or of none (-1),
    and how many frames ago that changed."""

    kind: IntArray
    phase: IntArray
    tasks: Mapping[str, tuple[IntArray, IntArray]]


def jobs(scale: Scale) -> list[Followed]:
    """Every scenario and seed of a scale."""
    return [Followed(*one) for one in of_traffic(scale.worlds)]


def kinds(trace: Trace) -> IntArray:
    """Of every row, the place of its kind in `KINDS`."""
    stands = trace.regime == REGIMES.index("stationary")
    creeps = np.hypot(trace.vx, trace.vy) < CRAWL
    steady = (trace.regime == REGIMES.index("constant_velocity")) & ~trace.turning
    return np.select([stands, creeps, steady], [STANDSTILL, CREEPING, STEADY], MANOEUVRE)


def inferred(told: Mapping[str, FloatArray]) -> IntArray:
    """What a filter's signals, each (n,), say: places in `TOLD`.

    It stands if MD's w_v is below 1 on both axes, or, by filters without it, below `CRAWL`. If
    not, it is in a manoeuvre if MD's w_a is 1 on an axis, by IMM if constant velocity has less than
    half of the probability, and by others from `CONSTANT_VELOCITY` of acceleration on, as the
    truth has it along the path.
    """
    stands = told["w_v"] < 1.0 if "w_v" in told else told["speed"] < CRAWL
    if "w_a" in told:
        manoeuvre = told["w_a"] == 1.0
    elif "not cv" in told:
        manoeuvre = told["not cv"] > 0.5
    else:
        manoeuvre = told["acceleration"] >= CONSTANT_VELOCITY
    return np.select([stands, ~manoeuvre], [0, 1], 2)


def truth_of(trace: Trace, occluded: Detections, gaps: Gaps, length: int) -> Truth:
    """The truth of a trace's rows; length: of the gaps, past which nothing counts [frames]."""
    kind = kinds(trace)
    states = {
        task: np.select([np.isin(kind, active), np.isin(kind, quiet)], [1, 0], -1)
        for task, (active, quiet) in TASKS.items()
    }
    tasks = {task: (state, frames_since_change(trace, state)) for task, state in states.items()}
    return Truth(kind, _phases(trace, occluded, gaps, length), tasks)


def scored(
    trace: Trace, truth: Truth, occluded: Detections, gaps: Gaps, model: Estimator
) -> Iterator[dict[str, Any]]:
    """bin, metric, value and what is behind it."""
    row, error, told = _estimates(trace, occluded, gaps, model)
    phase, kind, regime = truth.phase[row], truth.kind[row], trace.regime[row]
    for code, name in enumerate(REGIMES[:-1]):
        motion = name.replace("_", " ")
        for where, own in _by_phase(phase, regime == code):
            yield _mean(f"{motion}, {where}", "error", error[own])
    for where, own in _by_phase(phase, trace.turning[row]):
        yield _mean(f"turning, {where}", "error", error[own])
    hidden = phase == GAP
    yield from _by_change(trace, kind[hidden], gaps, row[hidden], error[hidden])
    asked = (phase == IN_VIEW) & (_ages(trace, row) >= AGE)
    row, kind = row[asked], kind[asked]
    told = {name: values[asked] for name, values in told.items()}
    said = inferred(told)
    for (true, name), (place, answer) in product(enumerate(KINDS), enumerate(TOLD)):
        yield _mean(f"{name} as {answer}", "confusion", 100.0 * (said[kind == true] == place))
    for task, (state, since) in truth.tasks.items():
        for where, within in (("all", trace.n_frames + 1), ("recent", RECENT)):
            own = since[row] <= within
            high, low = own & (state[row] == 1), own & (state[row] == 0)
            for name, values in told.items():
                area = float(separation(values[high], values[low]))
                n = int(high.sum() + low.sum())
                yield {"bin": where, "metric": f"{name} {task}", "value": area, "n": n}


def _estimates(
    trace: Trace, occluded: Detections, gaps: Gaps, model: Estimator
) -> tuple[IntArray, FloatArray, dict[str, FloatArray]]:
    """Rows of the trace (n,) in which its object is followed, the distance from its true position
    [m], and the signals."""
    ids = np.setdiff1d(occluded.source, [CLUTTER])
    row_of = np.full((trace.n_frames, len(ids)), -1)
    known = np.flatnonzero(np.isin(trace.object_id, ids))
    row_of[trace.frame[known], np.searchsorted(ids, trace.object_id[known])] = known
    rows, positions = [], []
    told: list[dict[str, FloatArray]] = []
    settings = DETECTORS[DETECTOR]
    for frame, place, state in followed(occluded, gaps, ids, model, settings):
        there = row_of[frame, place] >= 0  # an object may leave while its track still coasts
        rows.append(row_of[frame, place[there]])
        positions.append(model.position(state)[there])
        told.append({name: one[there] for name, one in signals(model, state).items()})
    row = np.concatenate(rows)
    error = np.hypot(*(np.concatenate(positions) - np.column_stack([trace.x, trace.y])[row]).T)
    return row, error, {name: np.concatenate([one[name] for one in told]) for name in told[0]}


def _phases(trace: Trace, occluded: Detections, gaps: Gaps, length: int) -> IntArray:
    """Of every row of the trace, the place of its phase in `PHASES`; -1 where it has none: without
    a detection outside gaps, or past the protocol's frames of a gap."""
    stride = trace.n_frames
    own = trace.object_id * stride + trace.frame
    found = np.where(np.isin(own, occluded.source * stride + occluded.frame), IN_VIEW, -1)
    place = around_gaps(trace, gaps)
    found[place.phase == "after"] = AFTER
    found[place.nth > 0] = np.where(place.nth[place.nth > 0] <= length, GAP, -1)
    return found


def _by_change(
    trace: Trace, kind: IntArray, gaps: Gaps, row: IntArray, error: FloatArray
) -> Iterator[dict[str, Any]]:
    """Errors in the rows of gaps, by what the object does in a gap's first and last of them."""
    own = trace.object_id[row]
    end = np.maximum(kind, CREEPING) - CREEPING  # places in ENDS
    first, last = np.full(len(row), -1), np.full(len(row), -1)
    when = trace.frame[row]
    for identifier, start, stop in gaps.rows():
        place = np.flatnonzero((own == identifier) & (when >= start) & (when < stop))
        if len(place):
            frame = when[place]
            first[place] = end[place[np.argmin(frame)]]
            last[place] = end[place[np.argmax(frame)]]
    for (a, before), (b, after) in product(enumerate(ENDS), enumerate(ENDS)):
        yield _mean(f"gap from {before} to {after}", "error", error[(first == a) & (last == b)])


def _by_phase(phase: IntArray, own: BoolArray) -> Iterator[tuple[str, BoolArray]]:
    for code, name in enumerate(PHASES):
        yield name, own & (phase == code)


def _ages(trace: Trace, row: IntArray) -> IntArray:
    """For how many frames in a row each of some rows' objects has been followed, from 0."""
    order = np.lexsort((trace.frame[row], trace.object_id[row]))
    frame, own = trace.frame[row][order], trace.object_id[row][order]
    begins = np.append(True, (own[1:] != own[:-1]) | (frame[1:] != frame[:-1] + 1))
    first = np.maximum.accumulate(np.where(begins, np.arange(len(order)), 0))
    ages = np.empty(len(order), dtype=np.int64)
    ages[order] = frame - frame[first]
    return ages


def _mean(where: str, metric: str, values: FloatArray) -> dict[str, Any]:
    mean = float(values.mean()) if len(values) else np.nan
    return {"bin": where, "metric": metric, "value": mean, "n": len(values)}
