"""Claim: a search loses nothing and does nothing twice, whatever interrupts it, and tells what
could not be done."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from polars.testing import assert_frame_equal

import experiments.search.evaluation
import experiments.search.run
import scenarios
import sim_bridge
from sim_bridge import SeedRefused, SimulationError
from tests.experiments.commands import MDKF, Mdkf, answered
from tests.experiments.planted import (
    FAULTY,
    FILTERS,
    HIDDEN,
    SMALL,
    SPEEDS,
    install,
    searching,
    tables,
    with_filters,
)


def test_the_number_of_processes_changes_nothing(mdkf_command: Mdkf, planted: Path) -> None:
    """Two workers, which find the installed filter by its name, and one."""
    few = (*HIDDEN, *SPEEDS, "--trials", 16, "--seeds", 2, "--check-seeds", 4)
    assert mdkf_command(*FAULTY, *few, "--workers", 1, "--out", "one").status == 0
    assert searching(planted, *FAULTY, *few, "--workers", 2, "--out", "two").status == 0
    for name, table in tables(planted / "two").items():
        assert_frame_equal(table, tables(planted / "one")[name])


def test_killed_and_resumed_it_finds_what_an_undisturbed_search_finds(
    searched: Path, planted: Path
) -> None:
    """SIGKILL at two moments; the third time it goes on, and does nothing twice."""
    command = [*map(str, (*FAULTY, *SMALL, "--out", "other"))]
    kept = planted / "other" / "jobs"
    for count in (15, 60):
        process = subprocess.Popen(
            [*MDKF, *command],
            cwd=planted,
            env=with_filters(planted),
            stdout=subprocess.DEVNULL,
            start_new_session=True,
        )
        while process.poll() is None and len(list(kept.glob("*.parquet"))) < count:
            time.sleep(0.01)
        assert process.poll() is None
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        assert not (planted / "other" / "checks.parquet").exists()
    before = {path: path.stat().st_mtime_ns for path in kept.glob("*.parquet")}
    assert searching(planted, *command).status == 0
    for name, table in tables(planted / "other").items():
        assert_frame_equal(table, tables(searched)[name])
    drawn = (planted / "other" / "worst-1.svg").read_bytes()
    assert drawn == (searched / "worst-1.svg").read_bytes()
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert {p.name for p in kept.glob("*.parquet")} == {
        p.name for p in (searched / "jobs").glob("*.parquet")
    }


def failing(monkeypatch: pytest.MonkeyPatch, fault: Any) -> list[int]:
    """The simulation asks `fault` (scenario, how many worlds were asked for) what to raise."""
    asked: list[int] = []
    simulate = sim_bridge.simulate

    def simulated(scenario: scenarios.Scenario, seed: int) -> Any:
        asked.append(seed)
        error = fault(scenario, len(asked), seed)
        if error is not None:
            raise error
        return simulate(scenario, seed)

    monkeypatch.setattr(experiments.search.evaluation, "simulate", simulated)
    return asked


def test_ctrl_c_tells_what_was_found_so_far_and_the_next_run_goes_on(
    mdkf_command: Mdkf, searched: Path, planted: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Status 130; whole batches of trials are in the files, nothing is called confirmed."""
    with monkeypatch.context() as patch:
        failing(patch, lambda _, count, __: KeyboardInterrupt() if count > 40 else None)
        answer = mdkf_command(*FAULTY, *SMALL, "--out", "other")
    assert answer.status == 130
    assert answer.err == "mdkf: interrupted\n"
    assert answer.out.startswith("Nothing confirmed: interrupted after 16 of 32 trials")
    found = tables(planted / "other")
    assert_frame_equal(found["trials"], tables(searched)["trials"].head(16))
    assert found["checks"].is_empty()
    assert not list((planted / "other").glob("worst-*"))
    assert mdkf_command(*FAULTY, *SMALL, "--out", "other").status == 0
    for name, table in tables(planted / "other").items():
        assert_frame_equal(table, tables(searched)[name])


def test_seeds_that_are_refused_and_simulators_that_fail_are_told(
    mdkf_command: Mdkf, planted: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Seed 1 has no valid world, above 15 m/s the simulator dies: the search goes on, status 0."""

    def fault(scenario: scenarios.Scenario, _: int, seed: int) -> Exception | None:
        if scenario.parameters["speed"] > 15:
            return SimulationError("the simulator died")
        return SeedRefused("two cars overlap") if seed == 1 else None

    failing(monkeypatch, fault)
    monkeypatch.setattr(experiments.search.run, "simulate", experiments.search.evaluation.simulate)
    few = ("--trials", 16, "--seeds", 3, "--check-seeds", 4, "--workers", 1, "--out", "out")
    answer = mdkf_command(*FAULTY, *HIDDEN, *SPEEDS, *few, "--json")
    document = answered(answer)
    trials = pl.DataFrame(document["trials"])
    fast = pl.col("parameter_speed") > 15
    assert trials.filter(fast)["failed"].to_list() == [3] * len(trials.filter(fast))
    assert trials.filter(fast)["value"].null_count() == len(trials.filter(fast)) >= 2
    assert set(trials.filter(~fast)["refused"]) == {1}
    assert document["refused"] == trials["refused"].sum()
    assert document["failed"] == trials["failed"].sum()
    assert (
        f"{document['failed']} worlds failed in the simulator, the first: the simulator died"
        in (" ".join(answer.err.split()))
    )


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        (SimulationError("the simulator died"), "32 failed: the simulator died"),
        (SeedRefused("two cars overlap"), "32 seeds refused, 0 failed: two cars overlap"),
    ],
)
def test_where_there_is_no_world_at_all_the_work_has_failed(
    mdkf_command: Mdkf,
    planted: Path,
    monkeypatch: pytest.MonkeyPatch,
    fault: Exception,
    reason: str,
) -> None:
    """Status 1, one line."""
    failing(monkeypatch, lambda *_: fault)
    monkeypatch.setattr(experiments.search.run, "simulate", experiments.search.evaluation.simulate)
    few = ("--trials", 16, "--seeds", 2, "--check-seeds", 4, "--workers", 1, "--out", "out")
    answer = mdkf_command(*FAULTY, *HIDDEN, *SPEEDS, *few)
    assert answer.status == 1
    assert answer.out == ""
    assert answer.err.count("\n") == 1
    assert reason in answer.err


def test_a_filter_of_another_package_is_known_by_its_sources(
    planted: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A change of its source makes another world's name, in another process; nothing else does."""
    program = (
        "import scenarios; from experiments import OcclusionProtocol as O, jobs;"
        "from experiments.search.evaluation import Evaluation as E; from pathlib import Path;"
        "world = E(scenarios.load('circle'), 1, ('faulty', 'md'), 'pointrcnn', 'pointrcnn', O());"
        "print(jobs.Store(Path('.')).path(world).name)"
    )

    def name() -> str:
        command = [sys.executable, "-c", program]
        ran = subprocess.run(
            command,
            cwd=planted,
            env=with_filters(planted),
            capture_output=True,
            text=True,
            check=True,
        )
        return ran.stdout

    before = name()
    assert name() == before
    install(planted / "site", FILTERS.replace("0.1 *", "0.2 *"))
    assert name() != before
