"""Claim: what was done is kept under a name that all that decides it makes, so that a run that was
killed, or asks for more, does what is missing and nothing twice."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from polars.testing import assert_frame_equal

from experiments import jobs
from experiments.engine import RunFailed
from experiments.jobs import ROWS, Job, Store, as_rows, do
from experiments.sources import deciding
from experiments.studies import worlds
from sim_bridge import SimulationError


@dataclass(frozen=True)
class Square(Job):
    """A job that leaves a mark each time it is done."""

    number: int
    marks: Path
    seconds: float = 0.0
    fault: str = ""

    @property
    def group(self) -> str:
        """Even and odd ones."""
        return str(self.number % 2)

    def key(self) -> Mapping[str, Any]:
        """The number decides."""
        return {"number": self.number}

    def rows(self) -> pl.DataFrame:
        """Its square, and NaN, which is no value."""
        time.sleep(self.seconds)
        if self.fault == "simulation":
            raise SimulationError("the simulator\n died")
        if self.fault == "killed":  # as soon as another job is kept
            while not list((self.marks / "jobs").glob("*.parquet")):
                time.sleep(0.01)
            os.kill(os.getpid(), signal.SIGKILL)
        with (self.marks / "done.txt").open("a") as file:
            file.write(f"{self.number}\n")
        measured = [{"metric": "square", "value": self.number**2}, {"value": float("nan")}]
        return as_rows(measured, study="squares", seed=self.number)


def squares(marks: Path, n: int = 4, **options: Any) -> list[Square]:
    """Jobs 0..n-1, even ones first."""
    return [Square(k, marks, **options) for k in (*range(0, n, 2), *range(1, n, 2))]


def done(marks: Path) -> list[int]:
    """What was done, in order."""
    path = marks / "done.txt"
    return list(map(int, path.read_text().split())) if path.exists() else []


def test_rows_have_all_columns_and_nan_is_no_value() -> None:
    """What nobody names is `all`, empty or null."""
    measured = [{"value": float("nan"), "metric": "a"}, {"value": 2, "metric": "b", "bin": "part"}]
    rows = as_rows(measured, n=3)
    assert rows["bin"].to_list() == ["all", "part"]
    assert dict(rows.schema) == ROWS
    assert rows["value"].to_list() == [None, 2.0]
    assert rows.row(0, named=True) | {"metric": "", "value": 0} == {
        **dict.fromkeys(("study", "scenario", "detector", "occlusion", "filter", "metric"), ""),
        **{"seed": None, "bin": "all", "value": 0, "n": 3},
    }


@pytest.mark.parametrize("workers", [1, 2])
def test_every_job_is_done_once_and_more_jobs_do_what_is_missing(
    tmp_path: Path, workers: int
) -> None:
    """Progress counts what was there before; rows come in the order asked for."""
    store, told = Store(tmp_path / "jobs"), list[int]()
    do(squares(tmp_path), store, workers, told.append)
    assert sorted(done(tmp_path)) == [0, 1, 2, 3]
    assert (told[0], told[-1]) == (0, 4)
    told.clear()
    do(squares(tmp_path, 6), store, workers, told.append)
    assert sorted(done(tmp_path)) == [0, 1, 2, 3, 4, 5]
    assert (told[0], told[-1]) == (4, 6)
    rows = store.rows(squares(tmp_path, 6))
    assert rows.filter(metric="square")["seed"].to_list() == [0, 2, 4, 1, 3, 5]
    assert rows.filter(metric="square")["value"].to_list() == [0, 4, 16, 1, 9, 25]


@pytest.mark.parametrize("content", [b"", b"PAR1", b"nonsense" * 99, None])
def test_a_spoilt_file_is_made_anew(tmp_path: Path, content: bytes | None) -> None:
    """Truncated, empty, overwritten, or of other columns."""
    store, job = Store(tmp_path / "jobs"), Square(3, tmp_path)
    do([job], store, 1)
    path, before = store.path(job), store.read(job)
    assert before is not None
    if content is None:
        pl.DataFrame({"a": [1]}).write_parquet(path)
    else:
        path.write_bytes(content or path.read_bytes()[:-20])
    assert store.read(job) is None
    do([job], store, 1)
    assert done(tmp_path) == [3, 3]
    after = store.read(job)
    assert after is not None
    assert_frame_equal(after, before)


def test_the_name_is_all_that_decides(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another key, another source: another file; what does not decide changes no name."""
    store, job = Store(tmp_path), Square(1, tmp_path)
    name = store.path(job).name
    assert store.path(replace(job, seconds=9.0)).name == name
    assert store.path(Square(2, tmp_path)).name != name
    monkeypatch.setattr(jobs, "deciding", lambda module: "other sources")
    assert store.path(job).name != name


def test_the_sources_that_a_job_imports_decide() -> None:
    """Directly or by way of others; filters, simulators and their data in any case; of this
    package nothing else."""
    sums, versions, _ = json.loads(deciding(Path(str(worlds.__file__))))
    for source in (
        *("mdkf/kalman.py", "sim_bridge/detect.py", "sim_bridge/detectors/virconv.yaml"),
        *("experiments/studies/worlds.py", "experiments/drift.py", "experiments/alone.py"),
        "experiments/metrics/hota.py",
    ):
        assert len(sums[source]) == 64
    for source in ("report", "terminal", "claims/scoreboard", "kitti/run", "bench/plan"):
        assert f"experiments/{source}.py" not in sums
    assert "libsumo" in versions
    assert "test_jobs.py" in str(deciding(Path(__file__)))


def test_any_change_of_a_source_is_another_text(tmp_path: Path) -> None:
    """A comment too: what changes nothing cannot be told."""
    first, second = tmp_path / "first.py", tmp_path / "second.py"
    first.write_text("import experiments.drift")
    second.write_text("import experiments.drift  # again")
    assert deciding(first) != deciding(second).replace("second.py", "first.py")


def test_a_job_that_fails_is_one_line_and_loses_nothing(tmp_path: Path) -> None:
    """The jobs before it are kept."""
    store = Store(tmp_path / "jobs")
    good, bad = Square(0, tmp_path), Square(1, tmp_path, fault="simulation")
    with pytest.raises(RunFailed, match=r"^1: the simulator died$"):
        do([good, bad], store, 1)
    assert store.read(good) is not None
    assert store.read(bad) is None


def test_a_killed_worker_loses_only_its_own(tmp_path: Path) -> None:
    """The other group's jobs are kept, and the next run does the rest."""
    store = Store(tmp_path / "jobs")
    good = Square(0, tmp_path)
    with pytest.raises(RunFailed, match="a worker process died"):
        do([good, Square(1, tmp_path, fault="killed")], store, 2)
    assert store.read(good) is not None
    do([good, Square(1, tmp_path)], store, 2)
    assert done(tmp_path) == [0, 1]


def test_killed_at_any_moment_and_resumed_nothing_is_missing_or_half_written(
    tmp_path: Path,
) -> None:
    """SIGKILL of the whole run, five times; then the rows are those of an undisturbed run."""
    script = (
        "import sys; from pathlib import Path; from tests.experiments.test_jobs import squares;"
        "from experiments.jobs import Store, do;"
        "marks = Path(sys.argv[1]);"
        "do(squares(marks, 12, seconds=0.05), Store(marks / 'jobs'), 1)"
    )
    command = [sys.executable, "-c", script, str(tmp_path)]
    for count in range(1, 6):
        process = subprocess.Popen(command, start_new_session=True)
        while process.poll() is None and len(done(tmp_path)) < 2 * count:
            time.sleep(0.002)
        os.killpg(process.pid, signal.SIGKILL) if process.poll() is None else None
        process.wait()
    subprocess.run(command, check=True)
    wanted = squares(tmp_path, 12)
    rows = Store(tmp_path / "jobs").rows(wanted)
    assert_frame_equal(rows, pl.concat([replace(job, marks=tmp_path).rows() for job in wanted]))
    files = [path for path in (tmp_path / "jobs").iterdir() if path.suffix == ".parquet"]
    assert len(files) == 12
