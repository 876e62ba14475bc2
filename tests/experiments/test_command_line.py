"""Claim: every command does its step as the library does."""

import json
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import polars as pl
import pytest
import typer

import experiments.world
import scenarios
import sim_bridge
from experiments import OcclusionProtocol, score
from experiments.command_line import application
from mdkf import MotionDynamics, Tracker
from mdkf.tables import Detections, Trace, Tracks
from sim_bridge import SeedRefused, read_table
from tests.experiments.commands import (
    Answer,
    Mdkf,
    in_a_process,
    shortened,
)

COMMANDS = (
    *("run", "scenarios", "cache", "simulate", "detect", "track", "score", "paper", "bench"),
    *("fit-detector", "check-detector", "kitti", "export", "import", "view", "sweep", "search"),
)
KEYS = {
    *("scenario", "filter", "seeds", "hota", "mota", "idf1", "idsw"),
    *("error_before", "error_gap", "error_after", "ms_per_frame"),
}


@pytest.mark.parametrize("command", COMMANDS)
def test_every_commands_help_shows_an_example(mdkf_command: Mdkf, command: str) -> None:
    """`--help` prints usage, options and a line to copy, and does nothing else."""
    answer = mdkf_command(command, "--help")
    assert answer.status == 0
    assert answer.err == ""
    assert f"Example: mdkf {command}" in answer.out
    assert re.search(rf"Usage: .*\b{command} ", answer.out)


def test_these_are_all_the_commands() -> None:
    """A new command has to be added to the tests above."""
    assert set(typer.main.get_command(application()).commands) == set(COMMANDS)  # type: ignore[attr-defined]


def test_a_command_does_not_wait_for_what_others_import() -> None:
    """Workers import the command line too, and draw nothing."""
    code = (
        "import sys; from experiments.command_line import application; application('sweep');"
        "print([name for name in ('matplotlib', 'optuna', 'rerun') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


@pytest.mark.parametrize("command", COMMANDS)
def test_every_example_is_a_valid_command(command: str) -> None:
    """Its options exist and its values are of their types."""
    described = typer.main.get_command(application()).commands[command]  # type: ignore[attr-defined]
    name, chosen, *arguments = shlex.split(described.epilog.removeprefix("Example: "))
    assert (name, chosen) == ("mdkf", command)
    described.make_context(command, arguments)


def test_without_arguments_the_help_is_printed(mdkf_command: Mdkf) -> None:
    """All commands, no error."""
    answer = mdkf_command()
    assert answer.status == 0
    assert answer.err == ""
    for command in COMMANDS:
        assert re.search(rf"\b{command}\b", answer.out)
    assert answer.out.strip() == mdkf_command("--help").out.strip()


def test_version_names_what_decides_the_numbers(mdkf_command: Mdkf) -> None:
    """mdkf, the simulators and the numerics, each with a version."""
    answer = mdkf_command("--version")
    assert answer.status == 0
    told = dict(line.split(" ") for line in answer.out.splitlines())
    assert {"mdkf", "libsumo", "highway-env", "numpy", "numba"} <= told.keys()
    assert all(re.match(r"\d+\.\d+", version) for version in told.values())


def test_scenarios_are_listed_and_described(mdkf_command: Mdkf) -> None:
    """As tables, and as one JSON document with every parameter's bounds."""
    listed = mdkf_command("scenarios")
    assert listed.status == 0
    for name in scenarios.list():
        assert name in listed.out
    described = mdkf_command("scenarios", "bus_stop")
    for spec in scenarios.load("bus_stop").parameter_specs:
        assert spec.name in described.out
    rows = json.loads(mdkf_command("scenarios", "--json").out)["rows"]
    assert [row["name"] for row in rows] == [*scenarios.list()]
    (row,) = json.loads(mdkf_command("scenarios", "bus_stop", "--json").out)["rows"]
    bounds = {p["name"]: (p["minimum"], p["maximum"], p["unit"]) for p in row["parameters"]}
    assert bounds["speed"] == (6.0, 13.0, "m/s")


def test_file_to_file_is_what_the_library_does_in_one_process(
    mdkf_command: Mdkf, made: Path, tmp_path: Path
) -> None:
    """simulate, detect, track and score from file to file: the tables are those of the library,
    bit for bit, and so are the scores, by both conventions."""
    own = made / "own" / "scenario.yaml"
    assert mdkf_command("simulate", own, "--seed", 3, "--out", "trace.parquet").status == 0
    hide = ("--seed", 3, "--occlusion", "mid:20")
    assert mdkf_command("detect", "trace.parquet", *hide, "--out", "seen.parquet").status == 0
    filtered = ("--filter", "md", "--out", "tracks.parquet")
    assert mdkf_command("track", "seen.parquet", *filtered).status == 0
    ruled = ("--filter", "md", "--set", "gate=3", "--set", "coasting=no", "--set", "max_missed=9")
    assert mdkf_command("track", "seen.parquet", *ruled, "--out", "other.parquet").status == 0
    other = read_table(tmp_path / "other.parquet", Tracks)
    tracker = Tracker(MotionDynamics(), "pointrcnn", gate=3, coasting=False, max_missed=9)
    assert other == tracker.run(read_table(tmp_path / "seen.parquet", Detections))
    kinds = {"trace": Trace, "seen": Detections, "tracks": Tracks}
    tables: dict[str, Any] = {}
    for name, kind in kinds.items():
        tables[name] = read_table(tmp_path / f"{name}.parquet", kind)
        library = read_table(made / f"{name}.parquet", kind)
        assert tables[name] == library
        assert tables[name].provenance == library.provenance
    for convention in ("keep", "ignore"):
        files = ("trace.parquet", "tracks.parquet", "--gap-truth", convention)
        answer = mdkf_command("score", *files, "--json")
        assert answer.status == 0
        protocol = OcclusionProtocol("mid", 20, 35)
        expected = score(tables["trace"], tables["tracks"], protocol, convention).summary()  # type: ignore[arg-type]
        assert json.loads(answer.out) == expected
        assert expected["gaps"] >= 5
    assert "hota" in mdkf_command("score", "trace.parquet", "tracks.parquet").out


def test_parameters_reach_the_simulation(mdkf_command: Mdkf, made: Path, tmp_path: Path) -> None:
    """`--set` and `--dt` change the trace as the library's arguments do."""
    own = made / "own" / "scenario.yaml"
    options = ("--set", "speed=9", "--set", "dwell=12.5", "--dt", "0.2", "--seed", 3)
    assert mdkf_command("simulate", own, *options, "--out", "t.parquet").status == 0
    expected = sim_bridge.simulate(scenarios.load(own, speed=9.0, dwell=12.5), 3, 0.2)
    assert read_table(tmp_path / "t.parquet", Trace) == expected


@pytest.fixture(scope="module")
def ran(made: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Answer, Path]:
    """`mdkf run --json` on two seeds, as a user starts it: in a process of its own."""
    out = tmp_path_factory.mktemp("ran") / "deep" / "out"
    arguments = [str(made / "own" / "scenario.yaml"), "--seeds", "2", "--filters", "ca,imm,md"]
    arguments += ["--workers", "1", "--out", str(out), "--json"]
    return in_a_process("run", *arguments), out


def test_run_prints_one_json_document_that_agrees_with_its_files(
    ran: tuple[Answer, Path],
) -> None:
    """Nothing else on stdout, nothing at all on stderr; rows equal results.parquet."""
    answer, out = ran
    assert answer.status == 0
    assert answer.err == ""
    document = json.loads(answer.out)
    rows = document["rows"]
    assert rows == pl.read_parquet(out / "results.parquet").to_dicts()
    assert document["differences"] == pl.read_parquet(out / "differences.parquet").to_dicts()
    assert [(row["scenario"], row["filter"], row["seeds"]) for row in rows] == [
        ("bus_stop", name, 2) for name in ("ca", "imm", "md")
    ]
    for row in rows:
        assert row.keys() >= KEYS
        assert all(row[key] is not None for key in KEYS)
        assert row["ms_per_frame"] > 0
    assert Path(document["report"]) == out / "report.html"
    assert (out / "report.html").is_file()
    assert document["refused"] == []


def test_run_shows_a_table_and_names_the_report(
    mdkf_command: Mdkf, made: Path, tmp_path: Path
) -> None:
    """Each filter's name and the page's path; an occlusion of `none` is a run as well."""
    own = made / "own" / "scenario.yaml"
    answer = mdkf_command(
        *("run", own, "--seeds", 1, "--filters", "ca,md", "--occlusion", "none"),
        *("--workers", 1, "--out", "out"),
    )
    assert answer.status == 0
    for word in ("bus_stop", "ca", "md", "HOTA", str(Path("out") / "report.html")):
        assert word in answer.out
    stored = pl.read_parquet(tmp_path / "out" / "results.parquet")
    assert stored["gaps"].to_list() == [0.0, 0.0]
    assert stored["error_gap"].null_count() == 2


def simulated_by(
    made: Path, failures: dict[int, BaseException]
) -> Callable[[scenarios.Scenario, int], Trace]:
    """A quick stand-in for the simulation that fails for some seeds."""
    trace = read_table(made / "trace.parquet", Trace)

    def simulate(scenario: scenarios.Scenario, seed: int) -> Trace:
        if seed in failures:
            raise failures[seed]
        return trace

    return simulate


RUN = ("run", "bus_stop", "--seeds", 2, "--filters", "ca,md", "--workers", 1, "--out", "out")


def test_a_refused_seed_is_told_and_the_run_goes_on(
    mdkf_command: Mdkf, made: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On stderr and in the JSON document, with status 0."""
    failing = simulated_by(made, {0: SeedRefused("bus_stop, seed 0: two cars overlap")})
    monkeypatch.setattr(experiments.world, "simulate", failing)
    answer = mdkf_command(*RUN, "--json")
    assert answer.status == 0
    assert "bus_stop, seed 0: two cars overlap" in answer.err
    document = json.loads(answer.out)
    assert document["refused"] == ["bus_stop, seed 0: two cars overlap"]
    assert [row["seeds"] for row in document["rows"]] == [1, 1]


def test_a_run_of_which_nothing_is_left_fails_with_status_1(
    mdkf_command: Mdkf, made: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The input was good, the work failed: one line with the reason."""
    refused = {seed: SeedRefused(f"bus_stop, seed {seed}: overlap") for seed in (0, 1)}
    monkeypatch.setattr(experiments.world, "simulate", simulated_by(made, refused))
    answer = mdkf_command(*RUN)
    assert answer.status == 1
    assert answer.err == "mdkf: bus_stop, seed 0: overlap\n"
    assert answer.out == ""
    assert not any(p.is_file() for p in tmp_path.rglob("*"))


def test_ctrl_c_leaves_a_report_of_what_is_finished_and_status_130(
    mdkf_command: Mdkf, made: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """After one of two worlds."""
    failing = simulated_by(made, {1: KeyboardInterrupt()})
    monkeypatch.setattr(experiments.world, "simulate", failing)
    answer = mdkf_command(*RUN)
    assert answer.status == 130
    assert answer.err == "mdkf: interrupted\n"
    assert pl.read_parquet(tmp_path / "out" / "results.parquet")["seeds"].to_list() == [1, 1]
    assert "Interrupted" in (tmp_path / "out" / "report.html").read_text()


def test_ctrl_c_in_a_single_step_is_status_130(
    mdkf_command: Mdkf, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """One line, no file."""

    def interrupted(*_: object) -> Trace:
        raise KeyboardInterrupt

    monkeypatch.setattr(sim_bridge, "simulate", interrupted)
    answer = mdkf_command("simulate", "bus_stop", "--out", "t.parquet")
    assert answer == Answer(130, "", "mdkf: interrupted\n")
    assert list(tmp_path.iterdir()) == []


def test_units_and_a_scenarios_own_words_are_printed_as_they_are(
    mdkf_command: Mdkf, ran: tuple[Answer, Path], made: Path, tmp_path: Path
) -> None:
    """Square brackets are no markup: not in headings, not in a user's file."""
    purpose = scenarios.load("bus_stop").purpose
    own = shortened(
        tmp_path / "own", scenario=lambda text: text.replace(purpose, "see [1] and [/x] end")
    )
    assert "see [1] and [/x] end" in mdkf_command("scenarios", own).out
    answer = mdkf_command("run", made / "own" / "scenario.yaml", "--seeds", 1, "--filters", "ca,md")
    assert "drift [m]" in answer.out
    assert "HOTA [points]" in answer.out
