"""pytest's plugin of mdkf: worlds by name as fixtures, and trackers pinned to their baselines.

It is loaded in every run of pytest wherever mdkf is installed, whether a test uses it or not. So it
imports what a fixture needs when a test asks for it, and nothing before.
"""

import hashlib
import os
import re
import sys
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import pytest

UPDATE = "MDKF_UPDATE"
"""Environment variable, as `experiments.regression.check` reads it."""

FOLDER = "baselines"
"""Folder of the baselines, beside the test."""

LONGEST_NAME = 120
"""Characters of a baseline's name."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--mdkf-update`."""
    parser.getgroup("mdkf", "mdkf: regression tests on synthetic traces").addoption(
        "--mdkf-update",
        action="store_true",
        help="make missing baselines of mdkf_regression, and accept changed ones",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Whoever compares, in this process or one that a test starts, knows of `--mdkf-update`."""
    config.pluginmanager.register(_Summary(), "mdkf-summary")
    if config.getoption("mdkf_update"):
        before = os.environ.get(UPDATE)
        os.environ[UPDATE] = "1"
        config.add_cleanup(lambda: _restore(before))


def _restore(before: str | None) -> None:
    if before is None:
        os.environ.pop(UPDATE, None)
    else:
        os.environ[UPDATE] = before


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """What there is to tell of baselines travels with the report, from xdist's workers too."""
    report = yield
    check = sys.modules.get("experiments.regression.check")
    told = check.drain() if check else []
    if told:
        vars(report)["mdkf_notices"] = told
    return report


class _Summary:
    """What became of baselines, at the end of the run."""

    def __init__(self) -> None:
        self.notices: list[str] = []

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Collect, wherever the test ran."""
        self.notices += getattr(report, "mdkf_notices", [])

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Tell, if there is anything to tell."""
        if self.notices:
            terminalreporter.write_sep("=", "mdkf baselines")
            for notice in self.notices:
                terminalreporter.write_line(notice)


@pytest.fixture(scope="session")
def _mdkf_worlds() -> Any:
    from experiments.regression.worlds import Worlds

    return Worlds()


@pytest.fixture(scope="session")
def mdkf_trace(_mdkf_worlds: Any) -> Callable[..., Any]:
    """mdkf_trace(world, seed=0, **parameters): exact truth of a world, e.g. of
    "golden:v1/stop_and_go" or of a scenario by name; each is made once."""
    trace: Callable[..., Any] = _mdkf_worlds.trace
    return trace


@pytest.fixture(scope="session")
def mdkf_detections(_mdkf_worlds: Any) -> Callable[..., Any]:
    """mdkf_detections(world, seed=0, detector="pointrcnn", occlusion="mid:20", **parameters): what
    a detector sees of the world, with gaps by the occlusion protocol."""
    detections: Callable[..., Any] = _mdkf_worlds.detections
    return detections


@pytest.fixture
def mdkf_regression(request: pytest.FixtureRequest) -> Callable[..., None]:
    """mdkf_regression(tracks, trace, detections, baseline=None, tolerances=None, metrics=None,
    strict=False): fails if the tracks score worse than baselines/MODULE.TEST.json beside the test,
    or baselines/BASELINE.json; `pytest --mdkf-update` makes and accepts it."""
    from experiments.regression.check import assert_no_regression

    folder = request.path.parent / FOLDER
    used: set[str] = set()

    def regression(
        tracks: Any, trace: Any, detections: Any, baseline: str | None = None, **options: Any
    ) -> None:
        __tracebackhide__ = True
        name = baseline or _name(request.path, request.node.nodeid)
        if name in used:
            raise ValueError(f"baseline {name!r} is used twice in one test; give each its own name")
        used.add(name)
        assert_no_regression(tracks, trace, detections, folder / name, **options)

    return regression


def _name(path: Path, nodeid: str) -> str:
    """A file's name of a test: module, class, function and parameters."""
    test = nodeid.partition("::")[2].replace("::", ".").replace("[", "-").removesuffix("]")
    name = f"{path.stem}.{test}"
    plain = re.sub(r"[^\w.-]", "-", name)[:LONGEST_NAME]
    # What was left out must not make two tests one.
    return plain if plain == name else f"{plain}-{hashlib.sha256(name.encode()).hexdigest()[:8]}"
