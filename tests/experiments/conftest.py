"""Fixtures for the tests of commands."""

import re
import sys
from pathlib import Path

import polars as pl
import pytest

import mdkf
import scenarios
import sim_bridge
from experiments import OcclusionProtocol
from experiments.command_line import main
from tests.experiments.commands import COLOURING, Answer, Mdkf, shortened
from tests.experiments.planted import FAULTY, SMALL, plant, searching

collect_ignore = ["example_project"]
"""A user's project, which `test_regression_example` runs from outside."""


@pytest.fixture
def mdkf_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Mdkf:
    """Runs `mdkf ARGUMENTS...` in this process and in an empty folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    for name in COLOURING:
        monkeypatch.delenv(name, raising=False)

    def call(*arguments: object) -> Answer:
        monkeypatch.setattr(sys, "argv", ["mdkf", *map(str, arguments)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as exited:
            main()
        told = capsys.readouterr()
        return Answer(int(exited.value.code or 0), re.sub(r"\x1b\[[\d;]*m", "", told.out), told.err)

    return call


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a short scenario, and two seeds' tables as the library makes and writes
    them: `trace`, `seen`, `tracks` of seed 3 and `other-trace` of the seed that follows it."""
    folder = tmp_path_factory.mktemp("made")
    scenario = scenarios.load(shortened(folder / "own"))
    trace = sim_bridge.simulate(scenario, 3)
    seen = OcclusionProtocol("mid", 20, 35).apply(sim_bridge.detect(trace, seed=3))
    tables = {
        "trace": trace,
        "seen": seen,
        "tracks": mdkf.Tracker(mdkf.estimator("md"), "pointrcnn").run(seen),
        "other-trace": sim_bridge.simulate(scenario, 4),
    }
    for name, table in tables.items():
        sim_bridge.write_table(table, folder / f"{name}.parquet")
    whole = (folder / "trace.parquet").read_bytes()
    (folder / "truncated.parquet").write_bytes(whole[: len(whole) // 2])
    (folder / "text.parquet").write_text("frame,x,y\n")
    pl.DataFrame({"x": [1.0]}).write_parquet(folder / "foreign.parquet")
    return folder


@pytest.fixture
def planted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The planted filters installed, their scenario in the folder in which commands run."""
    monkeypatch.syspath_prepend(plant(tmp_path))
    return tmp_path


@pytest.fixture(scope="session")
def searched(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an undisturbed search, in a process of its own."""
    folder = tmp_path_factory.mktemp("searched")
    plant(folder)
    assert searching(folder, *FAULTY, *SMALL, "--out", "out").status == 0
    return folder / "out"
