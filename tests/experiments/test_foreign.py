"""Claim: what goes wrong in somebody else's estimator is told in one line, status 1, by every
command that tracks; the line names the estimator and the place in its file."""

from pathlib import Path

import pytest

from tests.experiments.commands import Mdkf
from tests.experiments.planted import install

SOURCE = """
from mdkf.kalman import Kalman


class Broken(Kalman):
    def update(self, state, measured, noise):
        return 1 / 0  # here


class Nowhere(Kalman):
    def position(self, state):
        return super().position(state) + float("nan")
"""
LINE = 1 + SOURCE.splitlines().index("        return 1 / 0  # here")
POINTS = "[mdkf.estimators]\nbroken = broken_filters:Broken\nnowhere = broken_filters:Nowhere\n"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of installed packages: one, with estimators that fail."""
    return install(tmp_path_factory.mktemp("site"), SOURCE, "broken_filters", POINTS)


@pytest.fixture
def broken(site: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file of those estimators, which commands and their workers find."""
    monkeypatch.syspath_prepend(site)
    monkeypatch.setenv("PYTHONPATH", str(site))
    return site / "broken_filters.py"


COMMANDS = {
    "run": ("run", "stationary", "--seeds", 2, "--filters", "broken,ca", "--out", "out"),
    "alone": ("run", "stationary", "--seeds", 1, "--filters", "broken", "--workers", 1),
    "export": ("export", "stationary", "--seeds", 1, "--filters", "broken", "--out", "out"),
    "track": ("track", "seen.parquet", "--filter", "broken", "--out", "tracks.parquet"),
}


@pytest.mark.parametrize("what", COMMANDS)
def test_it_is_told_in_one_line(mdkf_command: Mdkf, broken: Path, what: str) -> None:
    """In a worker as in this process."""
    assert mdkf_command("simulate", "stationary", "--out", "trace.parquet").status == 0
    assert mdkf_command("detect", "trace.parquet", "--out", "seen.parquet").status == 0
    done = mdkf_command(*COMMANDS[what])
    assert done.status == 1, done.err
    *_, line = done.err.strip().splitlines()
    expected = f"estimator Broken: ZeroDivisionError: division by zero ({broken}, line {LINE})"
    assert line == f"mdkf: {expected}"
    assert "Traceback" not in done.err


def test_positions_that_are_no_numbers_too(mdkf_command: Mdkf, broken: Path) -> None:
    """They fail in the tracker, not in the estimator's file."""
    done = mdkf_command("run", "stationary", "--seeds", 1, "--filters", "nowhere", "--out", "out")
    assert done.status == 1
    assert "estimator Nowhere: ValueError: Nowhere: positions of" in done.err
    assert "Traceback" not in done.err
