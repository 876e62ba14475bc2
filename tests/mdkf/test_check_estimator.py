"""Claim: `mdkf.testing` passes sound estimators and names what is wrong with broken ones."""

import itertools
import pickle
import subprocess
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import mdkf
from mdkf import ESTIMATORS
from mdkf.testing import BEHAVIOUR, CHECKS, CONTRACT, EstimatorCheckError, check_estimator
from tests.mdkf.broken import BROKEN, FAULTS, AlphaBeta, NeedsATrack, Rows


@pytest.mark.parametrize("name", ESTIMATORS)
def test_every_built_in_estimator_passes(name: str) -> None:
    """All checks, for every name that the commands take."""
    check_estimator(ESTIMATORS[name])


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_a_plain_numpy_estimator_passes(check: Any) -> None:
    """Each check alone."""
    check(AlphaBeta())


@pytest.mark.parametrize(
    ("name", "cls", "told"), FAULTS, ids=lambda value: getattr(value, "__name__", None)
)
def test_a_broken_estimator_fails_the_check_of_its_fault(name: str, cls: Any, told: str) -> None:
    """It passes all checks before; the error names the check, what was expected and what came."""
    with pytest.raises(EstimatorCheckError) as raised:
        check_estimator(cls())
    assert raised.value.check == name, raised.value
    assert str(raised.value).startswith(f"{name}: given {raised.value.given}; expected ")
    assert told in str(raised.value)


def test_every_check_can_fail() -> None:
    """There is a broken estimator for each, and each is run in the order of CHECKS."""
    assert list(BROKEN) == [check.__name__ for check in CHECKS]
    assert CHECKS == CONTRACT + BEHAVIOUR


def test_the_contract_alone() -> None:
    """strict=False passes what a sound estimator may do, and nothing that breaks the tracker."""
    demanded = {check.__name__ for check in CONTRACT}
    for name, cls, _ in FAULTS:
        if name in demanded:
            with pytest.raises(EstimatorCheckError):
                check_estimator(cls(), strict=False)
        else:
            check_estimator(cls(), strict=False)


def test_a_class_is_no_estimator() -> None:
    """The forgotten parentheses are told."""
    with pytest.raises(EstimatorCheckError, match="came the class AlphaBeta: call it"):
        check_estimator(AlphaBeta)  # type: ignore[arg-type]


def test_the_estimators_own_error_is_the_cause() -> None:
    """So that the traceback shows its line; and the error survives a worker process."""
    with pytest.raises(EstimatorCheckError) as raised:
        check_estimator(NeedsATrack())
    assert isinstance(raised.value.__cause__, ValueError)
    again = pickle.loads(pickle.dumps(raised.value))
    assert str(again) == str(raised.value)
    assert again.check == "check_shapes"


def test_a_dataclass_state_passes() -> None:
    """Several arrays, tracks first."""

    class OnRows(AlphaBeta):
        def start(self, position: Any, noise: Any) -> Any:
            values = super().start(position, noise)
            return Rows(values, np.zeros(len(values)))

        def predict(self, state: Any, dt: float) -> Any:
            return replace(state, values=super().predict(state.values, dt), more=state.more + 1)

        def update(self, state: Any, position: Any, noise: Any) -> Any:
            return replace(state, values=super().update(state.values, position, noise))

        def position(self, state: Any) -> Any:
            return state.values[:, :2]

        def velocity(self, state: Any) -> Any:
            return state.values[:, 2:4]

        def covariance(self, state: Any) -> Any:
            return super().covariance(state.values)

        def diagnostics(self, state: Any) -> Any:
            return {"age": state.more, "doubt": np.where(state.more > 1, np.nan, 0.0)}

    check_estimator(OnRows())


def test_the_scenes_hold_what_the_checks_speak_of() -> None:
    """Gaps, but never in the first frame; a standing car; the same numbers every time."""
    from mdkf.checking import scene

    z = scene(5, 500, gaps=True)
    assert np.isfinite(z[0]).all()
    missing = np.isnan(z[..., 0])
    assert 0.1 < missing.mean() < 0.6
    runs = [len(list(g)) for k in range(5) for m, g in itertools.groupby(missing[:, k]) if m]
    assert min(runs) < 5
    assert max(runs) >= 20
    assert np.nanstd(z[:, 0], axis=0).max() < 0.3
    assert z.tobytes() == scene(5, 500, gaps=True).tobytes()


def test_pytest_is_not_needed() -> None:
    """`mdkf.testing` is for users: importing mdkf imports no test tool."""
    code = "import sys, mdkf; mdkf.testing.check_estimator; print('pytest' in sys.modules)"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout == "False\n"
    assert mdkf.testing.check_estimator is check_estimator
