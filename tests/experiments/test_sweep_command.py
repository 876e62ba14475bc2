"""Claim: `mdkf sweep` tells what it will do, does it, and shows what came of it."""

import json
from pathlib import Path

import polars as pl
import pytest

from experiments.sweeps.progress import Mean, Progress
from tests.experiments.commands import Mdkf, answered, assert_refused, in_a_process
from tests.experiments.sweeping import FILE, kept


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """The small sweep's file, with two seeds: 24 runs."""
    path = tmp_path / "sweep.yaml"
    path.write_text(FILE.replace("seeds: 8", "seeds: 2"))
    return path


def test_it_prints_what_the_files_hold(mdkf_command: Mdkf, file: Path, tmp_path: Path) -> None:
    """Tables on a terminal; with --json one document, of the same numbers."""
    answer = mdkf_command("sweep", file, "--out", tmp_path / "out", "--workers", 1)
    assert answer.status == 0
    assert "3 scenarios x 2 seeds x 1 detector x 2 occlusions x 2 filters: 24 runs" in answer.err
    assert "stationary(y=8), mid:10:35, 2 seeds" in answer.out
    assert "ca − md" in answer.out
    document = answered(
        mdkf_command("sweep", file, "--out", tmp_path / "out", "--workers", 1, "--json")
    )
    assert document["runs"] == {"all": 24, "there": 24, "found": 24, "failed": 0, "refused": 0}
    summary = pl.read_parquet(tmp_path / "out" / "summary.parquet")
    assert document["rows"] == summary.to_dicts()
    assert len(document["differences"]) == len(
        pl.read_parquet(tmp_path / "out" / "differences.parquet")
    )


def test_a_table_too_long_for_a_terminal_is_cut(
    mdkf_command: Mdkf, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At a whole row, saying how many more there are."""
    monkeypatch.setattr("experiments.sweeps.command.MAX_ROWS", 5)
    monkeypatch.setattr("experiments.sweeps.command.MAX_PAIRS", 2)
    path = tmp_path / "sweep.yaml"
    path.write_text(
        "scenarios: [stationary]\nseeds: 2\ndetectors: [pointrcnn, second]\n"
        "tracker: {gate: [3, 4]}\nfilters: [ca, md]\n"
    )
    answer = mdkf_command("sweep", path, "--out", tmp_path / "out", "--workers", 1)
    assert answer.status == 0
    assert answer.out.count("ca − md") == 2
    assert "5 more rows are in" in answer.out


def test_a_preview_does_one_world_of_each_scenario(
    mdkf_command: Mdkf, file: Path, tmp_path: Path
) -> None:
    """It tells how many runs are left and how long they take; what it did is not done again."""
    out = tmp_path / "out"
    answer = mdkf_command("sweep", file, "--out", out, "--workers", 1, "--preview")
    assert answer.status == 0
    assert "16 runs are left: about" in answer.err
    assert len(kept(out)) == 8
    assert json.loads((out / "manifest.json").read_text())["state"] == "incomplete"
    answer = mdkf_command("sweep", file, "--out", out, "--workers", 1)
    assert "8 of 24 runs were there already" in answer.err
    assert len(kept(out)) == 24


def test_damage_is_told(mdkf_command: Mdkf, file: Path, tmp_path: Path) -> None:
    """A truncated file is found and done again."""
    mdkf_command("sweep", file, "--out", tmp_path / "out", "--workers", 1)
    path = next((tmp_path / "out").glob("runs/*/*.parquet"))
    path.write_bytes(path.read_bytes()[:-1])
    answer = mdkf_command("sweep", file, "--out", tmp_path / "out", "--workers", 1)
    assert "1 damaged files of results were found" in answer.err
    assert len(kept(tmp_path / "out")) == 24


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("nowhere.yaml",), "nowhere.yaml: does not exist"),
        (("sweep.yaml", "--workers", "0"), "--workers"),
        (("sweep.yaml", "--workers", "1", "--dask", "tcp://x:1"), "--workers or --dask"),
    ],
)
def test_bad_input_is_one_line(
    mdkf_command: Mdkf, tmp_path: Path, arguments: tuple[str, ...], told: str
) -> None:
    """Status 2, before anything is written."""
    answer = mdkf_command("sweep", *arguments, "--out", tmp_path / "out")
    assert_refused(answer, tmp_path, told)


def test_the_time_that_remains_is_that_of_the_scenarios_that_remain() -> None:
    """By what each scenario's runs took; a scenario of which nothing is known takes the mean."""
    progress = Progress({"a": 10, "b": 4, "c": 2}, {"a": 5, "b": 2, "c": 0}, 0, 0, workers=2)
    assert progress.remaining != progress.remaining  # nobody knows yet
    progress._seconds["a"] = Mean(10.0, 5)
    progress._seconds["b"] = Mean(2.0, 2)
    assert progress.remaining == pytest.approx((5 * 2.0 + 2 * 1.0 + 2 * 12 / 7) / 2)


def test_what_is_no_address_is_told_in_one_line(tmp_path: Path, file: Path) -> None:
    """In a process of its own, whose end has nothing to add: status 2, and soon."""
    arguments = ("--dask", "nonsense", "--out", str(tmp_path / "out"))
    answer = in_a_process("sweep", str(file), *arguments)
    *_, last = answer.err.splitlines()
    assert answer.status == 2
    assert last.startswith("mdkf: --dask nonsense: missing port")
    assert "Traceback" not in answer.err
