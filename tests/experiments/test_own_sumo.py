"""Claim: every command takes a user's own SUMO configuration where it takes a scenario."""

import json
from pathlib import Path

import pytest

from mdkf import Trace
from sim_bridge import read_table
from tests.experiments.commands import Mdkf, assert_refused
from tests.sim_bridge.town import Edit, instead, replaced, write_town


@pytest.fixture(scope="module")
def town(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_town(tmp_path_factory.mktemp("own") / "town")


def test_run_scores_the_filters_on_it(mdkf_command: Mdkf, town: Path, tmp_path: Path) -> None:
    """Simulated, detected, tracked and scored; nothing is written but what was asked for."""
    before = {path: path.read_bytes() for path in town.parent.rglob("*")}
    answer = mdkf_command(
        *("run", town, "--seeds", "1", "--filters", "ca,md", "--workers", "1", "--json"),
        *("--out", tmp_path / "out"),
    )
    assert answer.status == 0, answer.err
    rows = json.loads(answer.out)["rows"]
    assert [(row["scenario"], row["filter"]) for row in rows] == [("town", "ca"), ("town", "md")]
    assert all(row["hota"] > 20.0 and row["gaps"] > 0 for row in rows)
    assert {path: path.read_bytes() for path in town.parent.rglob("*")} == before


def test_simulate_writes_its_trace(mdkf_command: Mdkf, town: Path, tmp_path: Path) -> None:
    """With its parameters set."""
    out = tmp_path / "trace.parquet"
    answer = mdkf_command("simulate", town, "--set", "duration=20", "--seed", "3", "--out", out)
    assert answer.status == 0, answer.err
    trace = read_table(out, Trace)
    assert trace.provenance["scenario"] == "town"
    assert 10.0 < trace.n_frames * trace.dt <= 20.0


def test_scenarios_describes_and_draws_it(mdkf_command: Mdkf, town: Path, tmp_path: Path) -> None:
    """Who carries the sensor, and how many had to be left out."""
    picture = tmp_path / "town.png"
    answer = mdkf_command("scenarios", town, "--picture", picture)
    assert answer.status == 0, answer.err
    assert "on vehicle " in answer.out
    assert "they drive through others" in answer.out
    assert picture.read_bytes().startswith(b"\x89PNG")
    (row,) = json.loads(mdkf_command("scenarios", town, "--json").out)["rows"]
    assert {spec["name"] for spec in row["parameters"]} == {"warmup", "duration"}
    assert row["ego"]
    assert row["left_out"] >= 0


BAD: dict[str, tuple[str, Edit, tuple[str, ...]]] = {
    "not XML": ("town.sumocfg", instead("town"), ("town.sumocfg", "not well-formed")),
    "lost routes": ("town.sumocfg", replaced("types.rou.xml", "lost.xml"), ("lost.xml",)),
    "unknown edge": ("demand.rou.xml", replaced("west_out", "moon"), ("demand.rou.xml", "'moon'")),
    "no vehicles": ("demand.rou.xml", instead("<routes/>"), ("demand.rou.xml", "departs")),
    "too late": (
        "demand.rou.xml",
        instead('<routes><trip id="t" depart="900" from="west_in" to="west_out"/></routes>'),
        ("no vehicle is on the road",),
    ),
    "empty network": ("network.net.xml", instead("<net/>"), ("network.net.xml", "<location>")),
}


@pytest.mark.parametrize("command", ["run", "simulate", "scenarios"])
@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_refused(
    name: str,
    command: str,
    mdkf_command: Mdkf,
    tmp_path_factory: pytest.TempPathFactory,
    tmp_path: Path,
) -> None:
    """Status 2, one line that names the file, nothing written."""
    file, edit, parts = BAD[name]
    path = write_town(tmp_path_factory.mktemp("bad") / "town", {file: edit})
    more = {
        "run": ("--seeds", "1", "--workers", "1", "--out", tmp_path / "out"),
        "simulate": ("--out", tmp_path / "trace.parquet"),
        "scenarios": ("--picture", tmp_path / "town.png"),
    }
    assert_refused(mdkf_command(command, path, *more[command]), tmp_path, *parts)
