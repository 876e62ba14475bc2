"""Claim: every example script runs as a newcomer runs it, and leaves what it promises."""

import subprocess
import sys
from pathlib import Path

import polars as pl
import pytest
from matplotlib.image import imread

import mdkf
import scenarios
import sim_bridge

FOLDER = Path(__file__).parents[2] / "experiments" / "examples"
EXAMPLES = {
    "own_filter": {"errors.png"},
    "own_scenario": {"behind_a_truck.yaml", "hidden.png", "all.png"},
    "own_data": {"tracks.csv", "tracks.parquet", "tracks.png"},
    "occlusion_experiment": {"errors.parquet", "one_gap.png"},
    "notebook_tour": {"tables.html", "trace.png", "errors.png", "frame.png", "weights.png"},
}


def run(name: str, folder: Path, *arguments: str) -> str:
    """What a script prints, run in a folder by a fresh interpreter."""
    ran = subprocess.run(
        [sys.executable, str(FOLDER / f"{name}.py"), *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    assert ran.stderr == ""
    return ran.stdout


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[str, Path]]:
    """What each script prints, and the folder it writes into."""
    done = {}
    for name in EXAMPLES:
        folder = tmp_path_factory.mktemp(name)
        done[name] = (run(name, folder, "results"), folder / "results")
    return done


def test_every_script_is_known_and_short() -> None:
    """None is untested; each has less than 60 lines, and its docstring says how to run it."""
    scripts = {path.stem: path.read_text().splitlines() for path in FOLDER.glob("*.py")}
    assert scripts.keys() == EXAMPLES.keys()
    for name, lines in scripts.items():
        assert len(lines) < 60
        assert f"python {name}.py [FOLDER]" in lines[0]


@pytest.mark.parametrize("name", EXAMPLES)
def test_a_script_writes_its_files(made: dict[str, tuple[str, Path]], name: str) -> None:
    """All of them into the folder it is given, none elsewhere; no picture is blank."""
    _, folder = made[name]
    assert {path.name for path in folder.iterdir()} == EXAMPLES[name]
    assert list(folder.parent.iterdir()) == [folder]
    for picture in folder.glob("*.png"):
        assert imread(picture)[..., :3].std() > 0.02


def test_without_a_folder_one_is_made(tmp_path: Path) -> None:
    """In the current directory, under a name that says whose it is."""
    run("own_data", tmp_path)
    written = {path.name for path in (tmp_path / "mdkf-out" / "own_data").iterdir()}
    assert written == EXAMPLES["own_data"]


def test_the_numbers_are_the_librarys(made: dict[str, tuple[str, Path]]) -> None:
    """Cars of 8, 10 and 12 m/s are found; the file of tracks is the table that was printed; errors
    are those of the gaps; the scenario is hidden where its picture says."""
    tracks = sim_bridge.read_table(made["own_data"][1] / "tracks.parquet", mdkf.Tracks)
    last = tracks.frame == tracks.n_frames - 1
    assert sorted(round(v) for v in tracks.vx[last].tolist()) == [8, 10, 12]
    data = pl.read_csv(made["own_data"][1] / "tracks.csv")
    assert sim_bridge.from_polars(mdkf.Tracks, data, like=tracks) == tracks
    errors = pl.read_parquet(made["occlusion_experiment"][1] / "errors.parquet")
    assert set(errors["filter"]) == {"ca", "imm", "md"}
    assert f"{errors['object_id'].n_unique()} gaps" in made["occlusion_experiment"][0]
    printed, folder = made["own_scenario"]
    trace = sim_bridge.simulate(scenarios.load(folder / "behind_a_truck.yaml", speed=8.0), 0)
    assert trace.visible.min() == 0.0
    assert trace.describe() in printed
    walk, md = made["own_filter"][0].splitlines()
    assert walk.startswith("walk Scores(hota=")
    assert md.startswith("md Scores(hota=")
