"""A world and what is missing of it into rows: simulated once, detected once by each detector,
occluded once by each protocol, followed by each filter.

It runs in another process, or on another machine. A run that cannot be done becomes a row with its
error, and the others go on.
"""

import hashlib
import json
import socket
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import Any

import polars as pl

import sim_bridge
from experiments.engine import RunFailed
from experiments.growth import GROWTH, growth
from experiments.kitti.recordings import contents
from experiments.named import detector_named
from experiments.sources import computing, deciding, described
from experiments.sweeps.sweep import Setup
from experiments.terminal import SECTIONS
from experiments.world import Followed, follow
from mdkf import Detections, Trace
from scenarios import Scenario
from scenarios.kitti import kitti_root
from sim_bridge import SeedRefused, TraceCache

METRICS = (*(name for _, units in SECTIONS for name in units), "drift", "ms_per_frame")
"""Scores of a run: `Followed.summary`."""

_WHICH = {
    "run": pl.String,
    "scenario": pl.String,
    "parameters": pl.String,
    "seed": pl.Int64,
    "detector": pl.String,
    "tracker": pl.String,
    "occlusion": pl.String,
    "filter": pl.String,
}

RUNS = {
    **_WHICH,
    "estimator": pl.String,
    "gap_truth": pl.String,
    "status": pl.String,
    "error": pl.String,
    **dict.fromkeys(METRICS, pl.Float64),
    "seconds": pl.Float64,
}
"""Columns of the runs, one row for each. run: its content address. parameters: JSON, in the units
that the scenario declares. tracker: rules in place of the detector's. status: done, refused (the
seed makes no world in which nothing overlaps), or failed; error: why, null when done. Scores are
null for "no value". seconds: CPU time, without what runs share."""

GROWN = {**_WHICH, **GROWTH}
"""Columns of error growth, rows for each run with gaps: `experiments.growth`."""

DONE, REFUSED, FAILED = "done", "refused", "failed"


@dataclass(frozen=True)
class Run:
    """One run of a world, and its content address."""

    address: str
    setup: Setup


@dataclass(frozen=True)
class Task:
    """What is missing of one world. sources: `sources()` of whoever asks for it.

    Addresses are made where the sweep is begun, and go with the task: what an estimator of a
    script's computes is known by that script, which is not there on a cluster.
    """

    scenario: Scenario
    seed: int
    runs: tuple[Run, ...]
    sources: str
    cache: TraceCache | None = None


def address(scenario: Scenario, seed: int, sources: str, setup: Setup) -> str:
    """The content address of a run: the SHA-256 of all that decides its numbers."""
    return _digest(_identity(scenario), str(seed), sources, _looked_at(setup))


@dataclass(frozen=True)
class Rows:
    """The rows of a task: `RUNS` and `GROWN`; seconds: what it took [s]."""

    runs: pl.DataFrame
    growth: pl.DataFrame
    seconds: float


def do(task: Task) -> Rows:
    """Do a task. Any error of a run is a row's."""
    began = time.perf_counter()
    runs: list[dict[str, Any]] = []
    grown: list[pl.DataFrame] = []
    for run, found, seconds in _followed(task):
        row = _row(task, run)
        if isinstance(found, Followed):
            scores = {**found.summary(), "seconds": seconds}
            runs.append({**row, "status": DONE, **scores})
            labels = [pl.lit(row[name], kind).alias(name) for name, kind in _WHICH.items()]
            grown.append(growth(found.errors).select(*labels, *GROWTH))
        else:
            runs.append({**row, **_failure(found), "seconds": seconds})
    told = pl.DataFrame(runs, schema=RUNS, strict=True).with_columns(
        pl.col(pl.Float64).fill_nan(None)
    )
    both = pl.concat(grown) if grown else pl.DataFrame(schema=GROWN)
    return Rows(told, both, time.perf_counter() - began)


def died(task: Task) -> Rows:
    """The rows of a task whose worker died doing it."""
    why = _failure(RuntimeError("its worker process died (killed, or out of memory)"))
    runs = [{**_row(task, run), **why} for run in task.runs]
    return Rows(pl.DataFrame(runs, schema=RUNS), pl.DataFrame(schema=GROWN), 0.0)


def parameters_of(scenario: Scenario) -> str:
    """All parameters of a scenario, as the rows of its runs hold them."""
    return json.dumps(dict(scenario.parameters), sort_keys=True)


@cache
def sources() -> str:
    """What decides a run beside its key: the sources, the versions of what they call, the kind of
    machine."""
    return _digest(deciding(Path(__file__)))


def _followed(task: Task) -> Iterator[tuple[Run, Followed | Exception, float]]:
    """Each run with what came of it, and its CPU time [s]."""
    try:
        if task.sources != sources():
            raise RuntimeError(
                f"{socket.gethostname()} has other sources or versions than whoever began the sweep"
            )
        make = sim_bridge.simulate if task.cache is None else task.cache.simulate
        trace = make(task.scenario, task.seed)
    except Exception as error:
        yield from ((run, error, 0.0) for run in task.runs)
        return
    for detector, of_detector in groupby(task.runs, key=lambda run: run.setup.detector):
        own = tuple(of_detector)
        try:
            detections = sim_bridge.detect(trace, detector_named(detector), task.seed)
        except Exception as error:
            yield from ((run, error, 0.0) for run in own)
            continue
        yield from _of_detections(trace, detections, own)


def _of_detections(
    trace: Trace, detections: Detections, runs: Sequence[Run]
) -> Iterator[tuple[Run, Followed | Exception, float]]:
    for occlusion, of_occlusion in groupby(runs, key=lambda run: run.setup.occlusion):
        own = tuple(of_occlusion)
        try:
            occluded = occlusion.apply(detections, trace)
        except Exception as error:
            yield from ((run, error, 0.0) for run in own)
            continue
        for run in own:
            began = time.thread_time()
            setup = run.setup
            found: Followed | Exception
            try:
                estimator = setup.filter.estimator
                found = follow(
                    trace, occluded, estimator, setup.settings, occlusion, setup.gap_truth
                )
            except Exception as error:
                found = error
            yield run, found, time.thread_time() - began


def _failure(error: Exception) -> dict[str, str]:
    """Status and error of a run that was not done."""
    if isinstance(error, SeedRefused):
        return {"status": REFUSED, "error": " ".join(str(error).split())}
    if isinstance(error, RunFailed):
        return {"status": FAILED, "error": str(error)}
    return {"status": FAILED, "error": " ".join(f"{type(error).__name__}: {error}".split())}


def _row(task: Task, run: Run) -> dict[str, Any]:
    """What a run is of."""
    setup = run.setup
    return {
        "run": run.address,
        "scenario": task.scenario.name,
        "parameters": parameters_of(task.scenario),
        "seed": task.seed,
        "detector": setup.detector,
        "tracker": str(setup.rules),
        "occlusion": str(setup.occlusion),
        "filter": setup.filter.name,
        "estimator": described(setup.filter.estimator),
        "gap_truth": setup.gap_truth,
    }


@cache
def _identity(scenario: Scenario) -> str:
    """A world asks for it once for each of its runs, and it reads files."""
    return scenario.identity()


@cache
def _looked_at(setup: Setup) -> str:
    """All that decides a run beside its world and the sources."""
    seen = repr(detector_named(setup.detector))
    if sim_bridge.is_recorded(setup.detector):
        name = sim_bridge.detector_name(setup.detector)
        seen = contents(kitti_root() / "detections" / name)
    parts = [seen, repr(setup.settings), str(setup.occlusion), setup.gap_truth]
    return json.dumps([*parts, setup.filter.name, computing(setup.filter.estimator)])


def _digest(*parts: str) -> str:
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:32]
