"""Claim: `mdkf scenarios NAME` tells what happens in a world, and draws it."""

import json
from pathlib import Path

import numpy as np
import pytest

import scenarios
import sim_bridge
from experiments.worlds.describe import describe, occlusion_lengths
from experiments.worlds.figure import catalogue_figure, world_figure
from mdkf import REGIMES, Trace
from tests.experiments.commands import Mdkf, shortened


def world(visible: list[float], distance: float = 20.0) -> Trace:
    """One standing car whose visible fraction goes as given, frame by frame."""
    n = len(visible)
    scenario = scenarios.load("stationary", x=distance, y=5.0)
    trace = sim_bridge.simulate(scenario, 0)
    kept = trace.take(trace.frame < n)
    columns = {**kept.columns(), "visible": np.array(visible)}
    common = {"n_frames": trace.n_frames, "dt": trace.dt, "ego": trace.ego}
    return Trace.from_columns(columns, **common, provenance=trace.provenance)


@pytest.mark.parametrize(
    ("visible", "lengths"),
    [
        ([1, 1, 1], []),
        ([1, 0, 0, 1], [2]),
        ([1, 0.1, 0.14, 0.15, 0.0, 1], [2, 1]),
        ([0, 0, 1, 0, 1, 0], [1]),  # hidden at first and at last: not seen before, or after
        ([0, 0, 0], []),
    ],
)
def test_an_occlusion_is_between_two_sights(visible: list[float], lengths: list[int]) -> None:
    """Runs below 15 %, seen in the frame before and in the frame after."""
    trace = world(visible)
    near = np.ones(len(trace), dtype=np.bool_)
    assert occlusion_lengths(trace, near, trace.visible >= 0.15) == lengths


def test_what_is_out_of_range_is_no_occlusion() -> None:
    """A car 80 m away is not told of at all."""
    told = describe(world([1, 0, 0, 1], distance=80.0))
    assert told.objects == {}
    assert not any(told.occlusions.values())
    assert told.regimes == {}


def test_lengths_are_classed() -> None:
    """1 to 5, 6 to 10, 11 to 20, 21 to 50 frames, and more."""
    visible = [1.0]
    for length in (1, 5, 6, 20, 21, 51):
        visible += [0.0] * length + [1.0]
    assert describe(world(visible)).occlusions == {
        "1-5": 2,
        "6-10": 1,
        "11-20": 1,
        "21-50": 1,
        "over 50": 1,
    }


def test_shares_are_those_of_the_seen_frames() -> None:
    """Brake to standstill: the regimes' shares sum to one and stand for the rows."""
    trace = sim_bridge.simulate(scenarios.load("brake_to_standstill"), 0)
    told = describe(trace)
    assert told.objects == {"car": 1}
    assert told.standing == 0
    assert sum(told.regimes.values()) == pytest.approx(1.0)
    standing = float((trace.regime == REGIMES.index("stationary")).mean())
    assert told.regimes["stationary"] == pytest.approx(standing)


def test_the_picture_shows_every_regime() -> None:
    """Its legend names those that occur, its axes have units."""
    scenario = scenarios.load("pull_away")
    trace = sim_bridge.simulate(scenario, 0)
    above, snapshot = world_figure(scenario, trace).axes
    legend = above.get_legend()
    assert legend is not None
    names = {text.get_text() for text in legend.get_texts()}
    assert {REGIMES[code].replace("_", " ") for code in set(trace.regime.tolist())} <= names
    for axes in (above, snapshot):
        assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [m]", "y [m]")


def test_the_command_describes_and_draws(mdkf_command: Mdkf, tmp_path: Path) -> None:
    """A table, a JSON document, a PNG file."""
    picture = tmp_path / "pull_away.png"
    answer = mdkf_command("scenarios", "pull_away", "--picture", str(picture))
    assert answer.status == 0
    assert "1 car" in answer.out
    assert "stationary" in answer.out
    assert picture.read_bytes().startswith(b"\x89PNG")
    (row,) = json.loads(mdkf_command("scenarios", "pull_away", "--seed", "3", "--json").out)["rows"]
    assert row["seed"] == 3
    assert row["objects"] == {"car": 1}
    assert row["source"] == "closed-form"


def test_the_catalogue_is_drawn_without_a_name(
    mdkf_command: Mdkf, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A panel for each scenario but recordings, those of simulators first; the table as ever."""
    names = ("circle", "kitti-0001", "merge", "stationary")
    known = tuple(name for name in names if name in scenarios.list())
    monkeypatch.setattr(scenarios, "list", lambda: known)
    picture = tmp_path / "all.png"
    answer = mdkf_command("scenarios", "--picture", str(picture))
    assert answer.status == 0
    assert all(name in answer.out for name in known)
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_panels_of_the_catalogue_are_of_one_scale() -> None:
    """Around the sensor in the middle of the recording, as wide and as high in all."""
    worlds = [(s, sim_bridge.simulate(s, 0)) for s in map(scenarios.load, ("circle", "journey"))]
    panels = [axes for axes in catalogue_figure(worlds).axes if axes.get_title()]
    assert [axes.get_title() for axes in panels] == [
        "circle (closed-form)",
        "journey (closed-form)",
    ]
    for axes in panels:
        assert axes.get_xlim() == (-75.0, 75.0)
        assert axes.get_ylim() == (-45.0, 45.0)


def test_the_cache_changes_no_byte(
    mdkf_command: Mdkf, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """`simulate`, `scenarios` and `run` with a cold, a warm and no cache; `mdkf cache` tells what
    is kept, and clears it."""
    monkeypatch.setenv("MDKF_CACHE", str(tmp_path / "kept"))
    own = shortened(tmp_path / "own")
    files, answers, tables = [], [], []
    run = ("run", own, "--seeds", 1, "--filters", "ca", "--workers", 1)
    for name, option in (("cold", ()), ("warm", ()), ("none", ("--no-cache",))):
        out = tmp_path / f"{name}.parquet"
        assert mdkf_command("simulate", own, "--out", out, *option).status == 0
        files.append(out.read_bytes())
        answers.append(mdkf_command("scenarios", own, "--json", *option).out)
        assert mdkf_command(*run, "--out", tmp_path / name, *option).status == 0
        tables.append((tmp_path / name / "worlds" / "bus_stop-0" / "trace.parquet").read_bytes())
    assert set(files) == set(tables)
    assert len(set(files)) == len(set(answers)) == 1
    told = json.loads(mdkf_command("cache", "--json").out)
    assert told["folder"] == str(tmp_path / "kept" / "traces")
    assert (told["traces"], told["bytes"]) == (1, len(files[0]))
    assert "1 traces" in mdkf_command("cache").out
    assert json.loads(mdkf_command("cache", "--clear", "--json").out)["traces"] == 0
    monkeypatch.setenv("MDKF_CACHE", "off")
    assert json.loads(mdkf_command("cache", "--clear", "--json").out)["folder"] is None
    assert "no cache" in mdkf_command("cache").out


def test_without_the_cache_nothing_is_kept_or_read(
    mdkf_command: Mdkf, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """`--no-cache` leaves the folder alone in all three commands."""
    monkeypatch.setenv("MDKF_CACHE", str(tmp_path / "kept"))
    own = shortened(tmp_path / "own")
    run = ("run", own, "--seeds", 1, "--filters", "ca", "--workers", 1)
    for command in (("simulate", own, "--out", "t.parquet"), ("scenarios", own), run):
        assert mdkf_command(*command, "--no-cache").status == 0
    assert not (tmp_path / "kept").exists()
