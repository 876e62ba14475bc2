"""Claim: pytest's plugin costs a suite that does not use it nothing, names baselines after tests,
updates them safely from several workers, and tells what it did."""

import os
import re
from pathlib import Path

import pytest

import experiments
from experiments.regression import check, plugin
from experiments.warm_up import compile_tracking

pytest_plugins = ["pytester"]

ROOT = Path(experiments.__file__).parents[1]
HEAVY = (
    "numpy",
    "numba",
    "polars",
    "scipy",
    "libsumo",
    "experiments.occlusion",
    "experiments.regression.check",
    "mdkf",
    "sim_bridge",
)

TRACKED = """
import mdkf
import pytest

WORLD = "golden:v1/journey"

@pytest.fixture
def pinned(mdkf_trace, mdkf_detections, mdkf_regression):
    trace, seen = mdkf_trace(WORLD), mdkf_detections(WORLD)
    def pin(filter, *name, **options):
        tracks = mdkf.Tracker(mdkf.estimator(filter)).run(seen)
        mdkf_regression(tracks, trace, seen, *name, **options)
    return pin
"""
EACH = """
import pytest

@pytest.mark.parametrize("f", ["cv", "ca", "imm", "md"])
def test_each(f, pinned):
    pinned(f)
"""


@pytest.fixture(scope="module", autouse=True)
def _imported() -> None:
    """All that numba imports late is there: pytester forgets what a run in its process imports, and
    numba does not bear being imported twice."""
    compile_tracking(["cv", "ca", "imm", "md"])


@pytest.fixture
def project(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> pytest.Pytester:
    """An empty folder of tests with the fixture `pinned`, where the plugin's entry point is found
    whether or not mdkf is installed."""
    installed = pytester.path.parent / f"{pytester.path.name}-installed"
    told = installed / "told-1.dist-info"
    told.mkdir(parents=True)
    (told / "METADATA").write_text("Metadata-Version: 2.1\nName: told\nVersion: 1\n")
    (told / "entry_points.txt").write_text("[pytest11]\nmdkf = experiments.regression.plugin\n")
    pytester.syspathinsert(installed)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(installed), str(ROOT)]))
    monkeypatch.setenv("COLUMNS", "120")
    pytester.makeconftest(TRACKED)
    return pytester


def files(project: pytest.Pytester) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in (project.path / "baselines").glob("*")}


def test_a_suite_that_does_not_use_it_imports_nothing(project: pytest.Pytester) -> None:
    """Nor is anything printed."""
    (project.path / "conftest.py").unlink()
    project.makepyfile(
        "import sys\n\n\ndef test_nothing_is_imported():\n"
        "    assert 'experiments.regression.plugin' in sys.modules\n"
        f"    assert [name for name in {HEAVY} if name in sys.modules] == []\n"
    )
    ran = project.runpytest_subprocess()
    ran.assert_outcomes(passed=1)
    ran.stdout.no_fnmatch_line("*baselines*")
    without = project.runpytest_subprocess("-p", "no:mdkf")
    without.stdout.fnmatch_lines(
        ["*assert 'experiments.regression.plugin' in*"]
    )  # it is not there then


def test_both_know_the_same_variable() -> None:
    """The plugin, which may not import the function, and the function."""
    assert plugin.UPDATE == check.UPDATE


def test_baselines_are_named_after_tests(project: pytest.Pytester) -> None:
    """Module, class, function and parameters; what a file's name cannot hold is told apart by a
    digest; a name of the user's own is taken as it is."""
    project.makepyfile(
        test_it="import pytest\n\n\n"
        "def test_plain(pinned):\n    pinned('ca')\n\n\n"
        "class TestIt:\n    def test_method(self, pinned):\n        pinned('ca')\n\n\n"
        "@pytest.mark.parametrize('f', ['ca', 'md'])\n"
        "def test_each(f, pinned):\n    pinned(f)\n\n\n"
        "@pytest.mark.parametrize('f', ['a/b', 'a:b', 'x' * 300])\n"
        "def test_odd(f, pinned):\n    pinned('ca')\n\n\n"
        "def test_two(pinned):\n    pinned('ca', 'first')\n    pinned('md', 'second')\n"
    )
    project.runpytest_inprocess("--mdkf-update").assert_outcomes(passed=8)
    names = sorted(files(project))
    odd = [name for name in names if "test_odd" in name]
    assert sorted(set(names) - set(odd)) == [
        "first.json",
        "second.json",
        "test_it.TestIt.test_method.json",
        "test_it.test_each-ca.json",
        "test_it.test_each-md.json",
        "test_it.test_plain.json",
    ]
    assert len(odd) == 3
    assert all(re.fullmatch(r"[\w.-]{1,140}", name) for name in odd)
    project.runpytest_inprocess().assert_outcomes(passed=8)


def test_a_name_is_used_once_in_a_test(project: pytest.Pytester) -> None:
    """Two trackers in one test need two names."""
    project.makepyfile(test_it="def test_two(pinned):\n    pinned('ca')\n    pinned('ca')\n")
    ran = project.runpytest_inprocess("--mdkf-update")
    ran.assert_outcomes(failed=1)
    ran.stdout.fnmatch_lines(["*'test_it.test_two' is used twice in one test*"])


def test_workers_update_as_one_process_does(project: pytest.Pytester) -> None:
    """The same bytes, all told once by the process that the user sees; then nothing is left."""
    project.makepyfile(test_it=EACH)
    project.runpytest_inprocess("--mdkf-update").assert_outcomes(passed=4)
    alone = files(project)
    for path in (project.path / "baselines").iterdir():
        path.unlink()
    ran = project.runpytest_subprocess("-n", "2", "--mdkf-update")
    ran.assert_outcomes(passed=4)
    assert files(project) == alone
    told = re.findall(r"(?m)^baselines/(\S+): made$", ran.stdout.str())
    assert sorted(told) == sorted(alone)
    again = project.runpytest_inprocess("--mdkf-update")
    again.assert_outcomes(passed=4)
    again.stdout.no_fnmatch_line("*mdkf baselines*")
    assert files(project) == alone


def test_what_fails_and_what_is_accepted_is_told(project: pytest.Pytester) -> None:
    """A missing baseline with its command; a worse tracker with a table and without the plugin's
    own lines; a better one with a notice; what was accepted, old and new. Without being asked,
    nothing is written."""
    project.makepyfile(test_it="def test_it(pinned):\n    pinned('ca')\n")
    missing = project.runpytest_inprocess()
    missing.assert_outcomes(failed=1)
    missing.stdout.fnmatch_lines(["*make it with:  pytest --mdkf-update test_it.py::test_it"])
    assert files(project) == {}

    made = project.runpytest_inprocess("--mdkf-update")
    made.stdout.re_match_lines(
        [r"=+ mdkf baselines =+", r"baselines/test_it.test_it.json: made"], consecutive=True
    )
    before = files(project)

    project.makepyfile(test_it="def test_it(pinned):\n    pinned('md')\n")
    changed = project.runpytest_inprocess()
    changed.assert_outcomes(failed=1)
    changed.stdout.re_match_lines(
        [
            r"E +metric +unit +baseline +now +change +allowed +verdict$",
            r"E +error_before +m +[\d.]+ +[\d.]+ .* worse$",
            r".*accept it with:  pytest --mdkf-update test_it.py::test_it$",
        ]
    )
    changed.stdout.no_fnmatch_line("*experiments/regression/check.py*")
    changed.stdout.no_fnmatch_line("*plugin.py*")
    assert files(project) == before

    project.makepyfile(test_it="def test_it(pinned):\n    pinned('md', metrics=['nees'])\n")
    (project.path / "baselines" / "test_it.test_it.json").write_bytes(
        re.sub(rb'("nees": {"value": )[\d.]+', rb"\g<1>50.5", before["test_it.test_it.json"])
    )
    better = project.runpytest_inprocess()
    better.assert_outcomes(passed=1)
    better.stdout.re_match_lines([r"  nees  50\.5  ->  [\d.]+ +better$"])

    accepted = project.runpytest_inprocess("--mdkf-update")
    accepted.stdout.re_match_lines(
        [r"baselines/test_it.test_it.json: accepted$", r"  nees  50\.5  ->  [\d.]+ +better$"],
        consecutive=True,
    )
    project.runpytest_inprocess().assert_outcomes(passed=1)


def test_updating_ends_with_the_run(project: pytest.Pytester) -> None:
    """Of two runs in one process the second, without the option, compares."""
    project.makepyfile(test_it="def test_it(pinned):\n    pinned('ca')\n")
    project.runpytest_inprocess("--mdkf-update").assert_outcomes(passed=1)
    assert check.UPDATE not in os.environ
    (project.path / "baselines" / "test_it.test_it.json").unlink()
    project.runpytest_inprocess().assert_outcomes(failed=1)


def test_without_the_plugin_there_is_the_function(project: pytest.Pytester) -> None:
    """`-p no:mdkf`: neither option nor fixtures; what is imported works by the variable."""
    project.makepyfile(
        test_fixture="def test_it(mdkf_regression):\n    pass\n",
        test_function="import mdkf\n"
        "from experiments.regression import assert_no_regression, golden_detections, golden_trace\n"
        "from pathlib import Path\n\n\n"
        "def test_it():\n"
        "    trace = golden_trace('golden:v1/journey')\n"
        "    seen = golden_detections('golden:v1/journey')\n"
        "    tracks = mdkf.Tracker(mdkf.estimator('ca')).run(seen)\n"
        "    assert_no_regression(tracks, trace, seen, Path(__file__).parent / 'it')\n",
    )
    alone = project.runpytest_inprocess("-p", "no:mdkf")
    alone.assert_outcomes(errors=1, failed=1)
    alone.stdout.fnmatch_lines(["*fixture 'mdkf_regression' not found*"])
    alone.stdout.fnmatch_lines(["*no baseline it.json*"])
    assert project.runpytest_inprocess("-p", "no:mdkf", "--mdkf-update").ret == 4
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(check.UPDATE, "1")
        project.runpytest_inprocess("-p", "no:mdkf", "test_function.py").assert_outcomes(passed=1)
    project.runpytest_inprocess("-p", "no:mdkf", "test_function.py").assert_outcomes(passed=1)
    project.runpytest_inprocess("test_function.py", "--mdkf-update").assert_outcomes(passed=1)
