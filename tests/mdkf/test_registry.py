"""Claim: a filter's name finds the built-in one or an installed package's, and nothing else."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import mdkf
from mdkf import (
    ESTIMATORS,
    InteractingMultipleModel,
    Kalman,
    MotionDynamics,
    estimator,
    estimator_names,
)

OWN = """
from mdkf import Kalman

class Slow(Kalman):
    pass

def make():
    return Slow(order=1)

def make_wrongly():
    raise RuntimeError("no weights\\nin the folder")

made = Slow(order=3)
number = 3

def make_nothing():
    return None

def make_a_class():
    return Slow
"""

Install = Callable[..., None]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """Install a package as pip does: a module and a .dist-info on the path."""

    def install(name: str, points: str, source: str = OWN) -> None:
        (tmp_path / f"{name}.py").write_text(source, encoding="utf-8")
        info = tmp_path / f"{name}-1.2.dist-info"
        info.mkdir()
        metadata = f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.2\n"
        (info / "METADATA").write_text(metadata, encoding="utf-8")
        text = f"[mdkf.estimators]\n{points}\n"
        (info / "entry_points.txt").write_text(text, encoding="utf-8")
        monkeypatch.syspath_prepend(tmp_path)

    return install


def test_a_package_adds_its_filters(install: Install) -> None:
    """A class, a function and an object; listed without being imported, made once."""
    install(
        "own_filters",
        "slow = own_filters:Slow\nmade-slow = own_filters:make\nslow3 = own_filters:made",
    )
    assert estimator_names()[-3:] == ("made-slow", "slow", "slow3")
    assert list(ESTIMATORS)[-3:] == ["made-slow", "slow", "slow3"]
    assert "slow" in ESTIMATORS
    assert "slow" in repr(ESTIMATORS)
    with pytest.raises(ValueError, match=r"did you mean 'slow3'\?"):
        estimator("slow33")
    assert "own_filters" not in sys.modules
    for name, order in (("slow", 2), ("made-slow", 1), ("slow3", 3)):
        found = estimator(name)
        assert type(found).__module__ == "own_filters"
        assert isinstance(found, Kalman)
        assert found.order == order
        assert ESTIMATORS[name] is found
    mdkf.testing.check_estimator(estimator("slow"))


def test_worker_processes_find_it_by_name(install: Install, tmp_path: Path) -> None:
    """`mdkf run` hands names to fresh processes."""
    install("worker_filters", "slow = worker_filters:Slow")
    code = (
        "import multiprocessing, mdkf\n"
        "if __name__ == '__main__':\n"
        "    with multiprocessing.get_context('spawn').Pool(1) as pool:\n"
        "        print(type(pool.apply(mdkf.estimator, ('slow',))).__module__)\n"
    )
    # mdkf itself is found wherever this process found it.
    path = [str(tmp_path), str(Path(mdkf.__file__).parents[1])]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path)}
    ran = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False
    )
    assert ran.stdout == "worker_filters\n", ran.stderr


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        ("bad_filters_missing:Slow", "cannot be imported: ModuleNotFoundError: No module named"),
        ("bad_filters:Fast", "cannot be imported: AttributeError: "),
        ("bad_filters:make_wrongly", "cannot be called: RuntimeError: no weights in the folder"),
        ("bad_filters:number", "is a int, expected an estimator, or a class or function"),
        ("bad_filters:make_nothing", "makes a NoneType without the methods of mdkf.Estimator"),
        ("bad_filters:make_a_class", "makes a type without the methods"),
        ("bad_filters", "is a module, expected an estimator"),
    ],
)
def test_a_filter_that_cannot_be_used_is_named(install: Install, value: str, reason: str) -> None:
    """One line with the entry point, its package and the reason; the other names still work."""
    point = f"slow = {value}"
    install("bad_filters", point)
    with pytest.raises(ValueError, match="entry point") as raised:
        estimator("slow")
    assert str(raised.value).startswith(f"entry point '{point}' of bad_filters 1.2 ")
    assert reason in str(raised.value)
    assert "\n" not in str(raised.value)
    assert "slow" in estimator_names()
    assert estimator("md") == MotionDynamics()
    with pytest.raises(ValueError, match="entry point"):
        ESTIMATORS["slow"]


@pytest.mark.parametrize("name", ["md", "ca-retuned"])
def test_a_built_in_name_is_not_given_away(install: Install, name: str) -> None:
    """Neither filter is taken silently; the list names it once and other names work."""
    install("greedy_filters", f"{name} = greedy_filters:Slow")
    with pytest.raises(ValueError, match=r"is built in, and entry point .* of greedy_filters 1\.2"):
        estimator(name)
    assert list(ESTIMATORS).count(name) == 1
    assert len(ESTIMATORS) == len(list(ESTIMATORS))
    assert estimator("ca") == Kalman()
    assert "greedy_filters" not in sys.modules


def test_a_name_given_twice_is_refused(install: Install) -> None:
    """Both packages are named."""
    install("first_filters", "slow = first_filters:Slow")
    install("second_filters", "slow = second_filters:Slow")
    with pytest.raises(ValueError, match=r"given twice: .*first_filters 1\.2.*second_filters 1\.2"):
        estimator("slow")


@pytest.mark.parametrize("name", ["../slow", "slow,fast"])
def test_names_that_the_commands_cannot_use_are_refused(install: Install, name: str) -> None:
    """Names stand between commas and in file names."""
    install("odd_filters", f"{name} = odd_filters:Slow")
    with pytest.raises(ValueError, match="a filter's name is of letters"):
        estimator(name)


def test_an_unknown_name_gets_a_hint() -> None:
    """The likeliest name, all base names, and the suffix that they can take."""
    with pytest.raises(ValueError, match=r"unknown filter 'mdd' \(did you mean 'md'\?\)") as raised:
        estimator("mdd")
    assert ", ".join(estimator_names()) in str(raised.value)
    assert "NAME-retuned" in str(raised.value)
    with pytest.raises(ValueError, match=r"did you mean 'md3-retuned'\?"):
        estimator("md3-retune")
    with pytest.raises(ValueError, match="unknown filter 'ca-retuned-retuned'"):
        estimator("ca-retuned-retuned")
    with pytest.raises(KeyError):
        ESTIMATORS["kalman"]
    assert "kalman" not in ESTIMATORS
    assert ESTIMATORS.get("kalman") is None


def test_every_base_name_has_a_retuned_start() -> None:
    """The same filter but for the speed variance of 100 (m/s)2."""
    built_in = [name for name in ESTIMATORS if not name.endswith("-retuned")]
    assert list(estimator_names()) == built_in
    for name in built_in:
        base, retuned = estimator(name), estimator(f"{name}-retuned")
        assert type(base) is type(retuned)
        assert base.start_variance[1] == 4.0  # type: ignore[attr-defined]
        assert retuned.start_variance[1] == 100.0  # type: ignore[attr-defined]


def test_names_say_their_options() -> None:
    """What a name promises is what it builds; no two names build the same."""
    assert estimator("cv") == Kalman(order=1)
    assert estimator("imm3-zero") == InteractingMultipleModel(order=3, mixing="zero")
    assert estimator("md-fw") == MotionDynamics(covariance_by="FW")
    assert estimator("md-joint") == MotionDynamics(axes="joint")
    assert estimator("md3-keep") == MotionDynamics(order=3, after_gap="keep")
    for denoise in ("innovation", "posterior", "raw"):
        assert estimator(f"md-{denoise}") == MotionDynamics(denoise=denoise)  # type: ignore
    assert len({repr(built) for built in ESTIMATORS.values()}) == len(ESTIMATORS)
