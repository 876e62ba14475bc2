"""Claim: a sweep loses nothing and does nothing twice, whatever kills it: itself, one of its
processes, a worker of a cluster."""

import os
import random
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from polars.testing import assert_frame_equal

from experiments.engine import RunFailed
from experiments.sweeps import Filter, read_sweep, run_sweep
from mdkf.kalman import Kalman
from tests.experiments.commands import MDKF, plain
from tests.experiments.sweeping import FILE, kept, small, whole

KILLS = 10


def begun(file: Path, out: Path, *options: str) -> subprocess.Popen[bytes]:
    """`mdkf sweep` in a process, and a process group, of its own."""
    return subprocess.Popen(
        [*MDKF, "sweep", str(file), "--out", str(out), "--no-cache", *options],
        env=plain(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )


def files(out: Path) -> int:
    """How many files of results there are."""
    return len(list(out.glob("*/*/*.parquet")))


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A sweep's file, and a folder with its results."""
    folder = tmp_path_factory.mktemp("undisturbed")
    file = folder / "sweep.yaml"
    file.write_text(FILE.replace("seeds: 8", "seeds: 12"))
    run_sweep(read_sweep(file), folder / "out", workers=1, cached=False)
    return file, folder / "out"


def assert_as_undisturbed(out: Path, undisturbed: Path) -> None:
    """The same runs, none missing, none double, with the same numbers; nothing half done."""
    assert whole(out)
    for kind in ("runs", "growth"):
        assert_frame_equal(kept(out, kind), kept(undisturbed, kind), check_exact=True)
    assert kept(out)["run"].n_unique() == len(kept(out))


def test_a_sweep_killed_ten_times_ends_as_if_nothing_had_been(
    tmp_path: Path, undisturbed: tuple[Path, Path]
) -> None:
    """SIGKILL of the command at random moments, its workers left to find out for themselves."""
    file, complete = undisturbed
    out, moments, random_numbers = tmp_path / "out", list[int](), random.Random(7)
    expected = files(complete)
    for k in range(KILLS):
        process = begun(file, out, "--workers", "2")
        before = files(out)
        # A tenth of the whole each time, so that ten of them are before the end; then a moment
        # anywhere in a task.
        goal = max(before, expected * k // (KILLS + 2) + random_numbers.randrange(3))
        while files(out) < goal and process.poll() is None:
            time.sleep(0.002)
        time.sleep(random_numbers.random() * 0.05)
        assert process.poll() is None, process.communicate()
        process.kill()
        process.communicate()
        moments.append(files(out))
    assert moments[-1] < expected
    process = begun(file, out, "--workers", "2")
    _, told = process.communicate()
    assert process.returncode == 0, told
    assert b"runs were there already" in told
    assert_as_undisturbed(out, complete)


def test_ctrl_c_keeps_what_is_finished(tmp_path: Path, undisturbed: tuple[Path, Path]) -> None:
    """Status 130, a manifest that says so, a table of what there is; then it goes on."""
    file, complete = undisturbed
    out = tmp_path / "out"
    process = begun(file, out, "--workers", "2")
    while files(out) < 6:
        assert process.poll() is None
        time.sleep(0.002)
    os.killpg(process.pid, signal.SIGINT)
    _, told = process.communicate()
    assert process.returncode == 130
    assert b"the same command goes on" in told
    assert b"Traceback" not in told
    assert '"state": "interrupted"' in (out / "manifest.json").read_text()
    assert 6 <= files(out) < files(complete)
    run_sweep(read_sweep(file), out, workers=2, cached=False)
    assert_as_undisturbed(out, complete)


def test_nobody_is_left_when_the_command_is_killed(
    tmp_path: Path, undisturbed: tuple[Path, Path]
) -> None:
    """Its workers end by themselves, within seconds."""
    process = begun(undisturbed[0], tmp_path / "out", "--workers", "2")
    while files(tmp_path / "out") < 4:
        assert process.poll() is None
        time.sleep(0.002)
    process.kill()
    process.communicate()
    deadline = time.monotonic() + 30
    while time.monotonic() < deadline:
        try:
            os.killpg(process.pid, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGKILL)
    pytest.fail("a worker outlived its parent")


class Deadly(Kalman):
    """A filter that kills the process that uses it."""

    def update(self, state: Any, measured: Any, noise: Any) -> Any:
        """The last thing that this process does."""
        os.kill(os.getpid(), signal.SIGKILL)


def test_a_run_that_kills_its_worker_is_a_row_and_the_others_go_on(tmp_path: Path) -> None:
    """That run alone failed; the others of its world are done."""
    deadly = Filter("deadly", Deadly())
    own = small(scenarios=["stationary"], filters=[deadly, "ca"], seeds=1)
    results = run_sweep(own, tmp_path / "one", workers=2, cached=False)
    rows = kept(tmp_path / "one")
    assert results.progress.failed == 1
    assert rows.filter(filter="ca")["status"].to_list() == ["done"]
    assert "worker process died" in rows.filter(filter="deadly")["error"].item()


@contextmanager
def cluster() -> Iterator[Any]:
    """A Dask scheduler with two worker processes of one thread each."""
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=True,
        dashboard_address=None,
        host="127.0.0.1",
        silence_logs=50,
    ) as local:
        yield local


def test_a_cluster_does_it_and_the_death_of_a_worker_is_no_loss(
    tmp_path: Path, undisturbed: tuple[Path, Path]
) -> None:
    """One of two worker processes is killed while it works: the same results."""
    file, complete = undisturbed
    out = tmp_path / "out"
    with cluster() as local:
        process = begun(file, out, "--dask", local.scheduler_address)
        while files(out) < 8:
            assert process.poll() is None, process.communicate()
            time.sleep(0.002)
        victim = local.workers[0].pid
        assert victim is not None
        os.kill(victim, signal.SIGKILL)
        there = files(out)
        _, told = process.communicate(timeout=120)
        assert process.returncode == 0, told
        assert there < files(complete)
    assert_as_undisturbed(out, complete)
    told_workers = (out / "manifest.json").read_text()
    assert "tcp://" in told_workers


def test_a_cluster_that_is_not_there_is_told(tmp_path: Path) -> None:
    """In one line; nothing was done."""
    with pytest.raises(RunFailed, match="no Dask scheduler answers at tcp://127"):
        run_sweep(small(), tmp_path / "out", dask="tcp://127.0.0.1:1")
