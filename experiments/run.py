"""The main job: many worlds on a process pool, gathered into one table of results.

Files in the output folder: `results.parquet` (a row for each scenario and filter: what the table
shows), `differences.parquet` (paired over seeds), `worlds.parquet` (a row for each scenario, seed
and filter), `errors.parquet` (a row for each filter, gap and frame), `breakdown.parquet` (a row for
each world, filter, bin and score: `experiments.breakdown`), `worlds/SCENARIO-SEED/` (the tables
behind the pictures).
"""

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

import mdkf
from experiments import engine
from experiments.engine import RunFailed
from experiments.occlusion import OcclusionProtocol
from experiments.population import GapTruth
from experiments.statistics import mean_interval
from experiments.warm_up import compile_sensing, compile_tracking
from experiments.world import Outcome, World, run_world
from scenarios import Scenario
from sim_bridge import TraceCache, check_detector, check_inputs, is_recorded
from sim_bridge.parquet import write_frame

SCENARIOS = ("bus_stop", "stop_and_go")
"""The worlds of the main job, unless told otherwise: a bus that hides standing cars, and queues."""

_ROBMOT = ("ca", "imm", "imm-zero", "md", "md-keep")
FILTERS = _ROBMOT + tuple(f"{name}-retuned" for name in _ROBMOT)
"""What is compared unless told otherwise: every estimator with RobMOT's start variance and with
the retuned one, both ways of mixing for IMM, both readings of what follows a gap for MD."""

INTERVALS = (
    *("hota", "mota", "idf1", "idsw", "error_before", "error_gap", "error_after", "drift"),
    *("gospa", "position_error", "velocity_error", "heading_error", "nees", "nis"),
)
"""Scores that get a 95 % interval over the seeds."""

SUBJECT = "md"
"""The filter under test: all others are its opponents."""

KEPT = "worlds"
"""Folder of the kept tables, in the output folder; emptied when a run begins."""


@dataclass(frozen=True)
class Plan:
    """All that decides the results of a run, and where its simulated worlds are kept, if they are:
    `cache` decides how long it takes, and no number."""

    scenarios: tuple[Scenario, ...]
    seeds: tuple[int, ...]
    filters: tuple[str, ...]
    detector: str
    settings: str
    occlusion: OcclusionProtocol
    gap_truth: GapTruth = "keep"
    cache: TraceCache | None = None

    def world(self, scenario: Scenario, seed: int, keep: Path | None) -> World:
        """One world of the plan; `keep` is where its tables are kept, if they are."""
        rules = (self.filters, self.detector, self.settings, self.occlusion, self.gap_truth)
        return World(scenario, seed, *rules, keep=keep, cache=self.cache)

    def worlds(self, out: Path) -> list[World]:
        """One world for each seed and scenario; the first of each scenario keeps its tables.

        No seed changes what was recorded: one world is all that there is of it, and a mean over
        more would have an interval of nothing.
        """
        first = self.seeds[0]
        seeds = (first,) if is_recorded(self.detector) else self.seeds
        return [
            self.world(s, seed, kept_folder(out, s.name, seed) if seed == first else None)
            for seed in seeds
            for s in self.scenarios
        ]


@dataclass(frozen=True)
class Results:
    """The gathered results: tables as written to the files, reasons of refused seeds, by scenario
    the seed whose tables are kept, and whether Ctrl-C or a failure ended the run early."""

    table: pl.DataFrame
    differences: pl.DataFrame
    worlds: pl.DataFrame
    errors: pl.DataFrame
    breakdown: pl.DataFrame
    refused: tuple[str, ...]
    kept: dict[str, int]
    interrupted: bool = False
    failure: str | None = None


def kept_folder(out: Path, scenario: str, seed: int) -> Path:
    """Where a world's tables are kept."""
    return out / KEPT / f"{scenario}-{seed}"


def run(
    plan: Plan,
    out: Path,
    workers: int | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> Results:
    """Run a plan and write its files to `out`.

    workers: processes, the machine's cores if None; 1 runs in this process. `progress` is told
    how many worlds are done. Ctrl-C finishes the worlds under way; after it, and after the death
    of a worker, the results are those of the finished worlds, and say so.

    Raises `RunFailed` if no world was finished, and what `simulate` raises for bad input, leaving
    nothing behind.
    """
    for scenario in plan.scenarios:
        check_inputs(scenario)
        check_detector(plan.detector, scenario)
    shutil.rmtree(out / KEPT, ignore_errors=True)
    worlds = plan.worlds(out)
    # The first run on a machine compiles the kernels: each of two workers a half.
    warm_up = (compile_sensing, partial(compile_tracking, plan.filters))
    outcomes: list[Outcome] = []
    interrupted, failure = False, None  # what ended the run early
    try:
        for outcome in engine.outcomes(run_world, worlds, workers, warm_up):
            outcomes.append(outcome)
            progress(len(outcomes))
    except KeyboardInterrupt:
        interrupted = True
    except RunFailed as error:
        failure = f"{error}; {len(outcomes)} of {len(worlds)} worlds are in {out}"
        if not outcomes:
            raise
    except BaseException:
        shutil.rmtree(out / KEPT, ignore_errors=True)
        raise
    results = _gather(plan, outcomes, out, interrupted, failure)
    for name in ("table", "differences", "worlds", "errors", "breakdown"):
        file = "results" if name == "table" else name
        write_frame(getattr(results, name), out / f"{file}.parquet")
    return results


def _gather(
    plan: Plan,
    outcomes: list[Outcome],
    out: Path,
    interrupted: bool,
    failure: str | None,
) -> Results:
    """Results of the finished worlds; raises `RunFailed` if there are none."""
    outcomes.sort(key=lambda outcome: (outcome.scenario, outcome.seed))
    rows = [row for outcome in outcomes for row in outcome.rows]
    refused = tuple(outcome.refused for outcome in outcomes if outcome.refused)
    if not rows:
        reason = "interrupted before a world was done" if interrupted else " ".join(refused[:1])
        raise RunFailed(failure or reason)
    kept: dict[str, int] = {}
    for outcome in outcomes:
        if outcome.rows:
            kept.setdefault(outcome.scenario, outcome.seed)
    for scenario in plan.scenarios:
        seed = kept.get(scenario.name)
        # The first seed was refused, or is not done: the next good one shows the pictures.
        if seed is not None and not kept_folder(out, scenario.name, seed).is_dir():
            run_world(plan.world(scenario, seed, kept_folder(out, scenario.name, seed)))
    per_world = pl.DataFrame(rows)
    return Results(
        _summarise(per_world, plan),
        _differences(per_world),
        per_world,
        pl.concat([outcome.errors for outcome in outcomes if outcome.rows]),
        pl.concat([outcome.breakdown for outcome in outcomes if outcome.rows]),
        refused,
        kept,
        interrupted,
        failure,
    )


def _summarise(per_world: pl.DataFrame, plan: Plan) -> pl.DataFrame:
    """A row for each scenario and filter: means over seeds, with intervals."""
    rows = []
    for scenario in plan.scenarios:
        for name in plan.filters:
            own = per_world.filter(scenario=scenario.name, filter=name)
            if own.is_empty():
                continue
            row: dict[str, Any] = {"scenario": scenario.name, "filter": name, "seeds": len(own)}
            for column in own.columns[3:]:
                interval = mean_interval(own[column])
                row[column] = interval.mean
                if column in INTERVALS:
                    row[f"{column}_low"], row[f"{column}_high"] = interval.low, interval.high
            built = mdkf.ESTIMATORS[name]
            row["start_speed_variance"] = float(getattr(built, "start_variance", (0, np.nan))[1])
            row |= {"occlusion": str(plan.occlusion), "gap_truth": plan.gap_truth}
            row |= {"detector": plan.detector, "estimator": repr(built)}
            rows.append(row)
    return pl.DataFrame(rows).with_columns(pl.col(pl.Float64).fill_nan(None))


def _differences(per_world: pl.DataFrame) -> pl.DataFrame:
    """Paired differences over seeds, subject minus opponent, of the same start variance.

    Negative errors favour the subject, negative scores the opponent; of NEES and NIS, which should
    be 2, the sign says nothing.
    """
    rows = []
    names = per_world["filter"].unique(maintain_order=True).to_list()
    for scenario in per_world["scenario"].unique(maintain_order=True):
        for opponent in names:
            start = "-retuned" if opponent.endswith("-retuned") else ""
            subject = SUBJECT + start
            if subject not in names or opponent == subject:
                continue
            a = per_world.filter(scenario=scenario, filter=subject).sort("seed")
            b = per_world.filter(scenario=scenario, filter=opponent).sort("seed")
            for metric in INTERVALS:
                interval = mean_interval((a[metric] - b[metric]).to_numpy())
                which = {"scenario": scenario, "filter": subject, "against": opponent}
                values = {"difference": interval.mean, "low": interval.low, "high": interval.high}
                rows.append({**which, "metric": metric, **values, "seeds": interval.n})
    schema: dict[str, type[pl.DataType]] = dict.fromkeys(
        ("scenario", "filter", "against", "metric"), pl.String
    )
    schema |= dict.fromkeys(("difference", "low", "high"), pl.Float64)
    schema["seeds"] = pl.Int64
    return pl.DataFrame(rows, schema=schema).with_columns(pl.col(pl.Float64).fill_nan(None))
