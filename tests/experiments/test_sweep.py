"""Claim: a sweep does everything crossed with everything, each run once, with the numbers that one
run alone has."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import duckdb
import numpy as np
import polars as pl
import pytest
from polars.testing import assert_frame_equal
from scipy import stats

import mdkf
import sim_bridge
from experiments import OcclusionProtocol
from experiments.sources import computing
from experiments.sweeps import (
    Filter,
    Rules,
    SweepError,
    run_sweep,
    with_parameters,
)
from experiments.sweeps import run as run_module
from experiments.sweeps.dataset import Dataset
from experiments.sweeps.summary import COMPARED
from experiments.sweeps.task import METRICS
from experiments.world import follow
from mdkf import MotionDynamics, Tracker
from mdkf.kalman import Kalman
from scenarios import Scenario
from tests.experiments.sweeping import kept, small, whole


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the small sweep, four seeds of it."""
    out = tmp_path_factory.mktemp("swept") / "out"
    run_sweep(small(seeds=4), out, workers=1, cached=False)
    return out


def test_every_combination_is_there_once(swept: Path) -> None:
    """Three scenarios, four seeds, two filters; each with a content address of its own."""
    rows = kept(swept)
    assert len(rows) == len(small(seeds=4)) == 24
    assert rows["run"].n_unique() == 24
    assert set(rows["status"]) == {"done"}
    combinations = rows.select("scenario", "parameters", "seed", "filter").unique()
    assert len(combinations) == 24
    assert {json.loads(p)["y"] for p in rows.filter(scenario="stationary")["parameters"]} == {8, 20}
    assert whole(swept)


def test_a_run_has_the_numbers_that_it_has_alone(swept: Path) -> None:
    """Simulated, detected, occluded, tracked and scored step by step."""
    scenario = small().scenarios[2]
    trace = sim_bridge.simulate(scenario, 3)
    protocol = OcclusionProtocol("mid", 10)
    occluded = protocol.apply(sim_bridge.detect(trace, "pointrcnn", 3))
    alone = follow(
        trace, occluded, mdkf.estimator("md"), mdkf.DETECTORS["pointrcnn"], protocol
    ).summary()
    row = kept(swept).filter(
        scenario="stationary", parameters=json.dumps(dict(scenario.parameters), sort_keys=True)
    )
    told = row.filter(seed=3, filter="md").row(0, named=True)
    assert {name: told[name] for name in METRICS if name in told} == {
        name: None if np.isnan(value) else value
        for name, value in alone.items()
        if name != "ms_per_frame"
    }


def test_scores_of_a_run_are_those_of_its_summary() -> None:
    """The columns are all that `Followed.summary` has, and no more."""
    scenario = small().scenarios[0]
    trace = sim_bridge.simulate(scenario, 0)
    seen = sim_bridge.detect(trace)
    settings, none = mdkf.DETECTORS["pointrcnn"], OcclusionProtocol("none")
    assert set(follow(trace, seen, mdkf.estimator("ca"), settings, none).summary()) == set(METRICS)


def test_means_and_paired_differences_are_those_of_scipy(swept: Path) -> None:
    """Of every score of every world, against `scipy.stats`; the first filter less the other."""
    runs = kept(swept)
    summary = pl.read_parquet(swept / "summary.parquet")
    assert summary["label"].unique(maintain_order=True).to_list() == [
        "constant_velocity",
        "stationary(y=8)",
        "stationary(y=20)",
    ]
    assert summary["filter"].to_list() == ["ca", "md"] * 3
    for row in summary.iter_rows(named=True):
        own = runs.filter(parameters=row["parameters"], filter=row["filter"])
        values = own["nees"].to_numpy()
        interval = stats.ttest_1samp(values, 0).confidence_interval(0.95)
        assert row["seeds"] == 4
        assert (row["nees"], row["nees_low"], row["nees_high"]) == pytest.approx(
            (values.mean(), interval.low, interval.high)
        )
    pairs = pl.read_parquet(swept / "differences.parquet")
    assert len(pairs) == 3 * len(COMPARED)
    for row in pairs.filter(metric="drift").iter_rows(named=True):
        assert (row["filter"], row["against"], row["seeds"]) == ("ca", "md", 4)
        own = runs.filter(parameters=row["parameters"]).sort("seed")
        first, second = (own.filter(filter=name)["drift"].to_numpy() for name in ("ca", "md"))
        interval = stats.ttest_rel(first, second).confidence_interval(0.95)
        assert (row["difference"], row["low"], row["high"]) == pytest.approx(
            ((first - second).mean(), interval.low, interval.high)
        )


def test_the_results_are_read_in_one_line(swept: Path) -> None:
    """By polars and by DuckDB, the folder as it is; both find the same means."""
    by_polars = (
        pl.read_parquet(swept / "runs").group_by("scenario", "filter").agg(pl.col("drift").mean())
    )
    by_duckdb = duckdb.sql(
        f"SELECT scenario, filter, avg(drift) AS drift FROM '{swept}/runs/*/*.parquet' GROUP BY ALL"
    ).fetchall()
    assert {row[:2]: row[2] for row in by_duckdb} == pytest.approx(
        {row[:2]: row[2] for row in by_polars.iter_rows()}
    )
    assert len(by_duckdb) == 4


def test_parameters_become_columns(swept: Path) -> None:
    """One for each, null where a scenario has none of the name; `x` is a parameter here."""
    rows = with_parameters(pl.read_parquet(swept / "runs"))
    assert "parameters" not in rows.columns
    assert set(rows.filter(scenario="stationary")["y"]) == {8.0, 20.0}


def test_a_second_sweep_does_what_is_missing(
    swept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """More seeds, a filter and an occlusion: the runs that are there are not done again."""
    out, done = tmp_path / "out", list[tuple[str, int, int]]()
    run_sweep(small(), out, workers=1, cached=False)
    before = {path: path.read_bytes() for path in out.glob("runs/*/*.parquet")}
    real = run_module.task.do

    def watched(task: Any) -> Any:
        done.append((task.scenario.name, task.seed, len(task.runs)))
        return real(task)

    monkeypatch.setattr(run_module.task, "do", watched)
    results = run_sweep(small(), out, workers=1, cached=False)
    assert (done, results.progress.found) == ([], 12)
    more = small(seeds=3, filters=["ca", "md", "imm"])
    results = run_sweep(more, out, workers=1, cached=False)
    assert results.progress.found == 12
    assert sorted(done) == sorted(
        [(name, seed, 1) for name in ("constant_velocity", *["stationary"] * 2) for seed in (0, 1)]
        + [(name, 2, 3) for name in ("constant_velocity", *["stationary"] * 2)]
    )
    assert {path: path.read_bytes() for path in before} == before
    assert len(kept(out)) == len(more) == 27
    assert kept(out)["run"].n_unique() == 27
    # A smaller sweep tells of its own runs alone, though more are there.
    assert (
        run_sweep(small(seeds=1), out, workers=1, cached=False).summary["seeds"].to_list()
        == [1] * 6
    )


def test_any_number_of_workers_gives_the_same(swept: Path, tmp_path: Path) -> None:
    """To the bit, but for what was measured of the machine."""
    run_sweep(small(seeds=4), tmp_path / "out", workers=2, cached=False)
    for kind in ("runs", "growth"):
        assert_frame_equal(kept(tmp_path / "out", kind), kept(swept, kind), check_exact=True)
    names = [
        sorted(path.relative_to(folder).as_posix() for path in folder.glob("*/*/*.parquet"))
        for folder in (swept, tmp_path / "out")
    ]
    assert names[0] == names[1]


class Faulty(Kalman):
    """A filter that cannot be used after a while."""

    def update(self, state: Any, measured: Any, noise: Any) -> Any:
        """Divides by nothing."""
        return 1 / 0


def test_a_run_that_crashes_is_a_row_with_its_error(tmp_path: Path) -> None:
    """The others of the same world go on; it is not done again unless asked for."""
    own = small(filters=[Filter("faulty", Faulty()), "ca"])
    results = run_sweep(own, tmp_path / "out", workers=1, cached=False)
    rows = kept(tmp_path / "out")
    (error,) = set(rows.filter(filter="faulty")["error"])
    assert error.startswith("estimator Faulty: ZeroDivisionError: division by zero (")
    assert f"{Path(__file__).name}, line " in error
    assert set(rows.filter(filter="faulty")["status"]) == {"failed"}
    assert set(rows.filter(filter="ca")["status"]) == {"done"}
    assert (results.progress.failed, len(rows)) == (6, 12)
    again = run_sweep(own, tmp_path / "out", workers=1, cached=False)
    assert (again.progress.failed, again.progress.found) == (0, 12)
    again = run_sweep(own, tmp_path / "out", workers=1, cached=False, retry=True)
    assert (again.progress.failed, again.progress.found) == (6, 6)
    assert kept(tmp_path / "out").equals(rows)


def test_a_simulation_that_fails_and_a_refused_seed_are_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All runs of the world, each with the reason."""

    def simulate(scenario: Scenario, seed: int) -> Any:
        kind = sim_bridge.SeedRefused if seed else sim_bridge.SimulationError
        raise kind(f"{scenario.name}:\n seed {seed}")

    monkeypatch.setattr(sim_bridge, "simulate", simulate)
    run_sweep(small(), tmp_path / "out", workers=1, cached=False)
    rows = kept(tmp_path / "out").filter(scenario="constant_velocity").sort("seed")
    assert rows["status"].to_list() == ["failed"] * 2 + ["refused"] * 2
    assert rows["error"].to_list() == (
        ["SimulationError: constant_velocity: seed 0"] * 2 + ["constant_velocity: seed 1"] * 2
    )
    assert rows["hota"].null_count() == 4


def test_what_a_killed_writer_left_is_cleared_away(tmp_path: Path) -> None:
    """Half a file under its temporary name, and growth whose runs were not written any more."""
    out = tmp_path / "out"
    run_sweep(small(), out, workers=1, cached=False)
    before = kept(out), kept(out, "growth")
    path = next(out.glob("runs/*/*.parquet"))
    (path.parent / f".{path.name}.abc.part").write_bytes(b"PAR1")
    path.unlink()
    run_sweep(small(seeds=1), out, workers=1, cached=False)
    assert whole(out)
    run_sweep(small(), out, workers=1, cached=False)
    assert (kept(out).equals(before[0]), kept(out, "growth").equals(before[1])) == (True, True)


@pytest.mark.parametrize("how", ["truncated", "altered", "empty", "foreign", "growth"])
def test_a_damaged_file_is_found_and_done_again(tmp_path: Path, how: str) -> None:
    """Whatever is wrong with it: its runs, and no others, are done again."""
    out = tmp_path / "out"
    run_sweep(small(), out, workers=1, cached=False)
    before = kept(out), kept(out, "growth")
    folder = "growth" if how == "growth" else "runs"
    path = sorted(out.glob(f"{folder}/*/*.parquet"))[1]
    content = path.read_bytes()
    middle = len(content) // 2
    altered = content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]
    if how == "foreign":
        pl.DataFrame({"run": ["a"]}).write_parquet(path)
    else:
        spoilt = {"truncated": content[:-9], "altered": altered, "empty": b"", "growth": altered}
        path.write_bytes(spoilt[how])
    results = run_sweep(small(), out, workers=1, cached=False)
    assert (results.progress.damaged, results.progress.found) == (1, 10)
    assert kept(out).equals(before[0])
    assert kept(out, "growth").equals(before[1])


def test_what_decides_a_run_is_in_its_address(tmp_path: Path) -> None:
    """A filter's options, the tracker's rules, the protocol, the profile's numbers, the sources."""
    text = Path(sim_bridge.__file__).with_name("detectors").joinpath("pointrcnn.yaml").read_text()
    same, nearer = tmp_path / "same.yaml", tmp_path / "nearer.yaml"
    same.write_text(text)
    nearer.write_text(text.replace("max_range: 69.9", "max_range: 60.0"))
    rules = [{"settings": "pointrcnn"}]
    variants = {
        "usual": small(),
        "option": small(filters=["ca", Filter("md", MotionDynamics(window=21))]),
        "rule": small(tracker=[{"gate": 4.5}]),
        "occlusion": small(occlusions=["mid:11"]),
        "truth": small(gap_truth="ignore"),
        "same profile": small(detectors=[str(same)], tracker=rules),
        "profile": small(detectors=[str(nearer)], tracker=rules),
    }
    addresses = {}
    for name, own in variants.items():
        (first, *_) = run_module.tasks_of(own, None)
        run = first.runs[1]
        addresses[name] = run.address
        others = run_module.task.address(first.scenario, first.seed, "others", run.setup)
        assert others != addresses[name]
    # The same profile in another file, of the same name, is the same detector.
    assert addresses.pop("same profile") == addresses["usual"]
    assert len(set(addresses.values())) == len(addresses)


def test_estimators_of_one_name_in_two_modules_are_two() -> None:
    """Even where both are of one package, and show themselves alike."""
    one, other = (
        type("Same", (Kalman,), {"__module__": f"tests.{name}", "__qualname__": "Same"})()
        for name in ("one", "other")
    )
    assert repr(one) == repr(other)
    assert computing(one) != computing(other)


def test_results_of_other_sources_are_not_gone_on_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two versions in one table would be no comparison; `fresh` begins anew."""
    out = tmp_path / "out"
    run_sweep(small(seeds=1), out, workers=1, cached=False)
    monkeypatch.setattr(run_module.manifest, "sources", lambda: "0" * 32)
    with pytest.raises(SweepError, match="other sources or versions"):
        run_sweep(small(seeds=1), out, workers=1, cached=False)
    monkeypatch.undo()
    (out / "manifest.json").unlink()
    with pytest.raises(SweepError, match="is missing"):
        run_sweep(small(seeds=1), out, workers=1, cached=False)
    assert run_sweep(small(seeds=1), out, workers=1, cached=False, fresh=True).progress.found == 0


def test_the_manifest_tells_what_made_every_file(swept: Path) -> None:
    """Versions, machine, command, the sweep, and hashes that anybody can check."""
    told = json.loads((swept / "manifest.json").read_text())
    assert (told["state"], told["runs"]) == ("finished", {"done": 24})
    assert told["command"] == sys.argv
    assert {"mdkf", "libsumo", "highway-env", "numpy", "polars"} <= told["versions"].keys()
    assert told["sweep"]["seeds"] == [0, 1, 2, 3]
    assert told["files"] == Dataset(swept).files()
    assert len(told["files"]) == 2 * 12


def test_nobody_else_writes_to_the_folder_meanwhile(tmp_path: Path) -> None:
    """Two at a time would do runs twice."""
    with Dataset(tmp_path).locked(), pytest.raises(SweepError, match="another sweep"):
        run_sweep(small(), tmp_path, workers=1)
    run_sweep(small(seeds=1), tmp_path, workers=1, cached=False)


SCRIPT = """
import sys
import numpy as np
from experiments.sweeps import Filter, Sweep, run_sweep


class Still:
    def __init__(self, variance):
        self.variance = variance

    def start(self, position, noise):
        return position.copy()

    def predict(self, state, dt):
        return state

    def update(self, state, position, noise):
        return np.where(np.isnan(position), state, position)

    def position(self, state):
        return state

    def velocity(self, state):
        return 0 * state

    def covariance(self, state):
        return np.tile(self.variance * np.eye(2), (len(state), 1, 1))

    def diagnostics(self, state):
        return {}


if __name__ == "__main__":
    filters = [Filter("still", Still(float(sys.argv[1]))), "ca"]
    sweep = Sweep.of(["stationary"], filters, seeds=3, occlusions=["mid:10"])
    print(run_sweep(sweep, "out", workers=2, cached=False).progress.found)
"""


def test_a_scripts_own_estimator_is_done_once_too(tmp_path: Path) -> None:
    """Its class is the script's, which has another name in the worker processes; with another
    option it is another filter, and with another source."""

    def found(variance: str, text: str = SCRIPT) -> int:
        (tmp_path / "script.py").write_text(text)
        command = [sys.executable, "script.py", variance]
        ran = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
        return int(ran.stdout)

    assert [found("0.1"), found("0.1"), found("0.2")] == [0, 6, 3]
    rows = kept(tmp_path / "out")
    assert set(rows["status"]) == {"done"}
    assert set(rows.filter(filter="still")["estimator"]) == {
        "Still({'variance': 0.1})",
        "Still({'variance': 0.2})",
    }
    assert found("0.1", SCRIPT.replace("return state\n", "return 1.0 * state\n")) == 3


def test_rules_are_the_trackers(tmp_path: Path) -> None:
    """A rule in place of the detector's decides what the tracker does."""
    own = small(scenarios=["bus_stop"], seeds=1, filters=["ca"], tracker=[{}, {"gate": 0.2}])
    run_sweep(own, tmp_path / "out", workers=1)
    rows = kept(tmp_path / "out")
    told = dict(zip(rows["tracker"], rows["idsw"], strict=True))
    assert set(told) == {"", "gate=0.2"}
    trace = sim_bridge.simulate(own.scenarios[0], 0)
    occluded = own.occlusions[0].apply(sim_bridge.detect(trace, "pointrcnn", 0))
    settings = Rules({"gate": 0.2}).settings("pointrcnn")
    assert settings == replace(mdkf.DETECTORS["pointrcnn"], gate=0.2)
    tracks = Tracker(mdkf.estimator("ca"), settings).run(occluded)
    from experiments import score

    assert told["gate=0.2"] == score(trace, tracks).summary()["idsw"]
    assert told["gate=0.2"] != told[""]
