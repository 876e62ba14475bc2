"""Claim: a run's files hold every world, its table their means; the same plan gives the same
numbers on any number of processes; what fails is said, and what is finished is kept."""

import dataclasses
import re
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from polars.testing import assert_frame_equal
from scipy import stats

import experiments.world
import mdkf
import scenarios
import sim_bridge
from experiments import OcclusionProtocol, score
from experiments.engine import RunFailed
from experiments.report import write_report
from experiments.run import Plan, Results, run
from experiments.world import Outcome
from mdkf.tables import Detections, Trace, Tracks
from sim_bridge import SeedRefused, SimulationError, read_table

SHORT = dataclasses.replace(scenarios.load("bus_stop"), duration=10.0)
PLAN = Plan(
    scenarios=(SHORT,),
    seeds=(0, 1),
    filters=("ca", "imm", "md"),
    detector="pointrcnn",
    settings="pointrcnn",
    occlusion=OcclusionProtocol("mid", 20, 35),
)
BOTH_STARTS = ("ca", "md", "ca-retuned", "md-retuned")
FILES = ("results", "worlds", "errors", "differences", "breakdown")
Simulating = Callable[[dict[int, BaseException]], None]
SCORES = (
    *("hota", "mota", "idf1", "idsw", "error_before", "error_gap", "error_after", "drift"),
    *("gospa", "position_error", "velocity_error", "heading_error", "nees", "nis"),
)


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the finished run wrote."""
    return tmp_path_factory.mktemp("run")


@pytest.fixture(scope="module")
def finished(out: Path) -> Results:
    """Two seeds of one scenario, in this process."""
    return run(PLAN, out, workers=1)


@pytest.fixture(scope="module")
def traces() -> dict[int, Trace]:
    """The two seeds' traces, for runs that need no simulation of their own."""
    return {seed: sim_bridge.simulate(SHORT, seed) for seed in PLAN.seeds}


@pytest.fixture
def simulating(traces: dict[int, Trace], monkeypatch: pytest.MonkeyPatch) -> Simulating:
    """Makes simulation quick, and fail for some seeds with the given error."""

    def install(failures: dict[int, BaseException]) -> None:
        def simulate(scenario: Any, seed: int) -> Trace:
            if seed in failures:
                raise failures[seed]
            return traces[seed]

        monkeypatch.setattr(experiments.world, "simulate", simulate)

    return install


@pytest.fixture(scope="module")
def averaged(traces: dict[int, Trace], tmp_path_factory: pytest.TempPathFactory) -> Results:
    """Four seeds that share a trace and differ in their detections: enough to tell a mean."""
    plan = dataclasses.replace(PLAN, seeds=(0, 1, 2, 3), filters=BOTH_STARTS)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(experiments.world, "simulate", lambda scenario, seed: traces[0])
        return run(plan, tmp_path_factory.mktemp("averaged"), workers=1)


def without_time(table: pl.DataFrame) -> pl.DataFrame:
    """All but the measured time, which no two runs share."""
    return table.drop("ms_per_frame", strict=False)


def test_every_table_is_in_its_file(finished: Results, out: Path) -> None:
    """Five Parquet files hold what was returned; nothing half-written is left beside them."""
    tables = (finished.table, finished.worlds, finished.errors, finished.differences)
    returned = (*tables, finished.breakdown)
    for name, table in zip(FILES, returned, strict=True):
        assert_frame_equal(pl.read_parquet(out / f"{name}.parquet"), table, check_exact=True)
    assert {p.name for p in out.iterdir()} == {*(f"{name}.parquet" for name in FILES), "worlds"}
    assert not finished.interrupted
    assert finished.refused == ()


def test_there_is_a_row_for_every_world_and_filter(finished: Results) -> None:
    """2 seeds x 3 filters, and in the results 3 filters, in the plan's order."""
    keys = finished.worlds.select("scenario", "seed", "filter").rows()
    assert keys == [("bus_stop", seed, name) for seed in (0, 1) for name in PLAN.filters]
    rows = finished.table.select("scenario", "filter", "seeds").rows()
    assert rows == [("bus_stop", name, 2) for name in PLAN.filters]
    pairs = set(finished.differences.select("filter", "against").iter_rows())
    assert pairs == {("md", "ca"), ("md", "imm")}


def test_results_are_the_means_of_the_worlds(averaged: Results) -> None:
    """Every number of every world, averaged over the seeds in numpy."""
    measured = averaged.worlds.columns[3:]
    assert set(SCORES) | {"ms_per_frame", "captured", "lost"} <= set(measured)
    assert averaged.worlds.filter(filter="md")["hota"].n_unique() == 4
    for row in averaged.table.to_dicts():
        own = averaged.worlds.filter(filter=row["filter"])
        assert row["seeds"] == len(own) == 4
        for column in measured:
            expected = np.nanmean(own[column].to_numpy())
            assert row[column] == pytest.approx(expected, rel=1e-12, abs=1e-12), column


def test_intervals_are_students_over_the_seeds(averaged: Results) -> None:
    """low and high of every score, from `scipy.stats`."""
    for row in averaged.table.to_dicts():
        own = averaged.worlds.filter(filter=row["filter"])
        for column in SCORES:
            values = own[column].to_numpy()
            half = stats.t.ppf(0.975, 3) * stats.sem(values)
            found = (row[f"{column}_low"], row[f"{column}_high"])
            expected = (values.mean() - half, values.mean() + half)
            assert found == pytest.approx(expected, rel=1e-9, abs=1e-9), column


def test_differences_are_paired_by_seed(averaged: Results) -> None:
    """md minus its opponent of the same start variance: the mean of the seeds' own differences,
    with their interval."""
    found = averaged.differences
    pairs = set(found.select("filter", "against").iter_rows())
    assert pairs == {("md", "ca"), ("md-retuned", "ca-retuned")}
    assert set(found["metric"]) == set(SCORES)
    for row in found.to_dicts():
        md, ca = (
            averaged.worlds.filter(filter=name).sort("seed")[row["metric"]].to_numpy()
            for name in (row["filter"], row["against"])
        )
        half = stats.t.ppf(0.975, 3) * stats.sem(md - ca)
        expected = (np.mean(md - ca), np.mean(md - ca) - half, np.mean(md - ca) + half)
        shown = (row["difference"], row["low"], row["high"])
        assert shown == pytest.approx(expected, rel=1e-9, abs=1e-9)
        assert row["seeds"] == 4


def test_errors_hold_every_gap_of_every_filter(finished: Results) -> None:
    """All filters were measured on the same gaps and frames; the worlds' error in the gap is
    their mean."""
    columns = ("seed", "object_id", "gap_start", "gap_stop", "frame")
    gaps = [finished.errors.filter(filter=name).select(columns) for name in PLAN.filters]
    assert len(gaps[0]) > 200
    for other in gaps[1:]:
        assert_frame_equal(gaps[0], other)
    for row in finished.worlds.to_dicts():
        own = finished.errors.filter(
            pl.col("track_id") >= 0, seed=row["seed"], filter=row["filter"], phase="gap"
        )
        assert row["error_gap"] == pytest.approx(own["error"].mean(), rel=1e-12)


def test_drift_is_the_mean_over_all_gaps(finished: Results) -> None:
    """Captured, deleted or unfollowed: the filter's own drift counts every gap."""
    for row in finished.worlds.to_dicts():
        own = finished.errors.filter(seed=row["seed"], filter=row["filter"], phase="gap")
        counted = own.filter(pl.col("offset") < PLAN.occlusion.length)
        assert counted["drift"].null_count() == 0
        assert own.filter(pl.col("offset") >= PLAN.occlusion.length)["drift"].is_null().all()
        assert row["drift"] == pytest.approx(own["drift"].mean(), rel=1e-12)
        assert own["object_id"].n_unique() == row["gaps"]


def test_a_filters_drift_does_not_depend_on_the_others(
    finished: Results, simulating: Simulating, tmp_path: Path
) -> None:
    """Alone or in company, its numbers are the same."""
    simulating({})
    alone = run(dataclasses.replace(PLAN, filters=("md",)), tmp_path, 1).worlds
    together = finished.worlds.filter(filter="md")
    assert_frame_equal(without_time(alone), without_time(together), check_exact=True)


def test_a_failed_worker_loses_nothing_finished(
    finished: Results, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The worlds before it are written and reported, and the line says how many."""
    first = [row for row in finished.worlds.to_dicts() if row["seed"] == 0]

    def dying(*given: object) -> Iterator[Outcome]:
        tables = (finished.errors.filter(seed=0), finished.breakdown.filter(seed=0))
        yield Outcome("bus_stop", 0, first, *tables)
        raise RunFailed("a worker process died")

    monkeypatch.setattr("experiments.engine.outcomes", dying)
    results = run(PLAN, tmp_path, 2)
    assert results.failure == f"a worker process died; 1 of 2 worlds are in {tmp_path}"
    assert set(pl.read_parquet(tmp_path / "worlds.parquet")["seed"]) == {0}
    page = write_report(PLAN, results, tmp_path, "mdkf run").read_text()
    assert "Unfinished: a worker process died" in page


def test_pictures_come_from_the_first_good_seed(
    finished: Results, simulating: Simulating, tmp_path: Path
) -> None:
    """Where seed 0 is refused, seed 1's tables are kept."""
    simulating({0: SeedRefused("two boxes overlap")})
    results = run(PLAN, tmp_path, 1)
    assert results.kept == {"bus_stop": 1}
    assert [path.name for path in (tmp_path / "worlds").iterdir()] == ["bus_stop-1"]


def test_all_filters_saw_the_same_detections(finished: Results, out: Path) -> None:
    """Tracking the kept detections again gives each filter's kept tracks, bit for bit, and
    scoring those gives its row."""
    folder = out / "worlds" / "bus_stop-0"
    trace = read_table(folder / "trace.parquet", Trace)
    occluded = PLAN.occlusion.apply(read_table(folder / "detections.parquet", Detections))
    for name in PLAN.filters:
        kept = read_table(folder / f"tracks-{name}.parquet", Tracks)
        assert mdkf.Tracker(mdkf.estimator(name), "pointrcnn").run(occluded) == kept
        row = finished.worlds.filter(seed=0, filter=name).row(0, named=True)
        scores = score(trace, kept, PLAN.occlusion)
        for column, value in scores.summary().items():
            assert row[column] == pytest.approx(value, nan_ok=True, rel=0, abs=0), column
        bins = finished.breakdown.filter(seed=0, filter=name).drop("scenario", "seed", "filter")
        assert_frame_equal(bins, scores.by("phase", "regime", "range,level"), check_exact=True)


def test_only_the_first_seed_keeps_its_tables(finished: Results, out: Path) -> None:
    """The pictures' tables of one world; a run of a hundred seeds is not a hundred worlds big."""
    assert [p.name for p in (out / "worlds").iterdir()] == ["bus_stop-0"]


@pytest.mark.parametrize("workers", [1, 2])
def test_the_same_plan_gives_the_same_numbers(
    finished: Results, tmp_path: Path, workers: int
) -> None:
    """Bit for bit in another folder, in one process and in two, but for the measured time."""
    again = run(PLAN, tmp_path, workers)
    for name in ("table", "worlds", "errors", "differences", "breakdown"):
        first, second = (without_time(getattr(r, name)) for r in (finished, again))
        assert_frame_equal(first, second, check_exact=True)
    for name in ("trace", "detections", *(f"tracks-{f}" for f in PLAN.filters)):
        (there,) = tmp_path.glob(f"worlds/*/{name}.parquet")
        assert there.is_file()


def test_progress_counts_the_worlds(simulating: Simulating, tmp_path: Path) -> None:
    """One, two; refused worlds count as done."""
    simulating({0: SeedRefused("ego lost")})
    told: list[int] = []
    run(PLAN, tmp_path, 1, told.append)
    assert told == [1, 2]


def test_a_refused_seed_is_reported_and_left_out(
    simulating: Simulating, finished: Results, tmp_path: Path
) -> None:
    """The other seed's numbers are what they were; one seed has no interval."""
    simulating({1: SeedRefused("bus_stop, seed 1: two cars overlap")})
    results = run(PLAN, tmp_path, 1)
    assert results.refused == ("bus_stop, seed 1: two cars overlap",)
    assert set(results.worlds["seed"]) == {0}
    assert set(results.errors["seed"]) == {0}
    assert results.table["seeds"].to_list() == [1, 1, 1]
    assert results.table["hota_low"].null_count() == 3
    expected = without_time(finished.worlds.filter(seed=0))
    assert_frame_equal(without_time(results.worlds), expected, check_exact=True)


def test_a_run_of_which_every_seed_is_refused_has_failed(
    simulating: Simulating, tmp_path: Path
) -> None:
    """The reason is in the message, and nothing is written."""
    simulating({seed: SeedRefused(f"bus_stop, seed {seed}: overlap") for seed in PLAN.seeds})
    with pytest.raises(RunFailed, match="bus_stop, seed 0: overlap"):
        run(PLAN, tmp_path, 1)
    assert not any(p.is_file() for p in tmp_path.rglob("*"))


def test_bad_input_is_not_mistaken_for_a_refused_seed(
    simulating: Simulating, tmp_path: Path
) -> None:
    """A broken network ends the run, even after a good world."""
    simulating({1: SimulationError("network.net.xml: not well-formed")})
    with pytest.raises(SimulationError, match="not well-formed"):
        run(PLAN, tmp_path, 1)
    assert not list(tmp_path.glob("*.parquet"))


def test_an_interrupted_run_keeps_what_is_finished(
    simulating: Simulating, finished: Results, tmp_path: Path
) -> None:
    """Ctrl-C after the first of two worlds: its numbers are written, and marked."""
    simulating({})

    def interrupt(done: int) -> None:
        raise KeyboardInterrupt

    results = run(PLAN, tmp_path, 1, interrupt)
    assert results.interrupted
    assert set(results.worlds["seed"]) == {0}
    for name in FILES:
        assert (tmp_path / f"{name}.parquet").is_file()
    assert_frame_equal(pl.read_parquet(tmp_path / "worlds.parquet"), results.worlds)
    expected = without_time(finished.worlds.filter(seed=0))
    assert_frame_equal(without_time(results.worlds), expected, check_exact=True)


def test_a_run_interrupted_before_its_first_world_says_so(
    simulating: Simulating, tmp_path: Path
) -> None:
    """There is nothing to write."""
    simulating({0: KeyboardInterrupt()})
    with pytest.raises(RunFailed, match="interrupted"):
        run(PLAN, tmp_path, 1)
    assert not list(tmp_path.glob("*.parquet"))


class Deadly:
    """Takes the place of a scenario; the process that unpickles it dies by SIGKILL."""

    name = "deadly"

    def __reduce__(self) -> tuple[Callable[..., object], tuple[int]]:
        return signal.raise_signal, (signal.SIGKILL,)


def test_a_killed_worker_is_a_failed_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As when memory runs out: one line, and no wait for a world that never comes."""
    monkeypatch.setattr("experiments.run.check_inputs", lambda scenario: None)
    plan = dataclasses.replace(PLAN, scenarios=(Deadly(),))  # type: ignore[arg-type]
    with pytest.raises(RunFailed) as caught:
        run(plan, tmp_path, workers=2)
    assert re.fullmatch(r"a worker process died.*", str(caught.value))
    assert not list(tmp_path.glob("*.parquet"))
