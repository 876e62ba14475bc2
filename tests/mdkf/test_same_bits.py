"""Claim: the same inputs give the same bytes, compiled or not, batched or not, in any process."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mdkf
from mdkf import filter_sequence
from mdkf.estimator import join
from tests.mdkf.scenes import (
    BUILT_IN,
    DT,
    EVERY,
    Array,
    bytes_of,
    contents,
    covariances,
    digests,
    journey,
    last,
    states,
)

ROOT = Path(mdkf.__file__).parents[1]
FRAMES, TRACKS = 100, 5


def digests_elsewhere(**environment: str) -> dict[str, str]:
    """What another process finds for `digests`."""
    run = subprocess.run(
        [sys.executable, "-m", "tests.mdkf.scenes"],
        cwd=ROOT,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    found: dict[str, str] = json.loads(run.stdout)
    return found


def test_the_same_source_without_the_jit_gives_the_same_bits() -> None:
    """Interpreted by Python, every bit of every state of every built-in estimator is the same:
    the compiler neither reorders nor fuses what is written."""
    assert os.environ.get("NUMBA_DISABLE_JIT", "0") == "0"
    assert digests_elsewhere(NUMBA_DISABLE_JIT="1") == digests()


def test_two_processes_give_the_same_bits() -> None:
    """Nothing depends on addresses, hash seeds or what ran before."""
    assert digests_elsewhere(PYTHONHASHSEED="1") == digests()


def test_the_digest_tells_the_estimators_apart() -> None:
    """It would notice a change: as many hashes as estimators."""
    found = digests()
    assert set(found) == set(BUILT_IN)
    assert len(set(found.values())) == len(found)


def noises(kind: str) -> Array:
    """R (2, 2), (n, 2, 2) or (T, n, 2, 2), as `filter_sequence` takes it."""
    rng = np.random.default_rng(2)
    shape = {"one": (), "by track": (TRACKS,), "by detection": (FRAMES, TRACKS)}[kind]
    R = covariances(rng, shape, correlated=kind != "one")
    if kind == "by detection":
        R[:, 0] *= np.eye(2)
    return R


@pytest.mark.parametrize("kind", ["one", "by track", "by detection"])
@pytest.mark.parametrize("name", EVERY)
def test_the_compiled_pass_is_the_frame_by_frame_calls(name: str, kind: str) -> None:
    """`filter_sequence` with one dt, its interpreted loop with that dt in every frame, and
    predict and update by hand: positions, velocities and covariances to the bit."""
    estimator = EVERY[name]
    z, R = journey(3, FRAMES, TRACKS), noises(kind)
    compiled = filter_sequence(estimator, z, R, DT)
    looped = filter_sequence(estimator, z, R, np.full(FRAMES - 1, DT))
    by_hand = list(states(estimator, z, R, DT))
    for quantity in ("position", "velocity", "covariance"):
        wanted = np.stack([getattr(estimator, quantity)(state) for state in by_hand])
        for estimates in (compiled, looped):
            came = np.ascontiguousarray(getattr(estimates, quantity))
            assert came.tobytes() == wanted.tobytes(), quantity


@pytest.mark.parametrize("name", EVERY)
def test_predicted_covariances_are_those_before_the_measurement(name: str) -> None:
    """Compiled, looped and by hand, to the bit; unasked for there are none, and the estimates are
    the same."""
    estimator, z, R = EVERY[name], journey(3, FRAMES, TRACKS), noises("by detection")
    by_hand = list(states(estimator, z, R, DT))
    ahead = [by_hand[0], *(estimator.predict(state, DT) for state in by_hand[:-1])]
    wanted = np.stack([estimator.covariance(state) for state in ahead])
    plain = filter_sequence(estimator, z, R, DT)
    assert len(plain.predicted) == 0
    for dt in (DT, np.full(FRAMES - 1, DT)):
        told = filter_sequence(estimator, z, R, dt, predicted=True)
        assert told.predicted.tobytes() == wanted.tobytes()
        for quantity in ("position", "velocity", "covariance"):
            assert getattr(told, quantity).tobytes() == getattr(plain, quantity).tobytes()


@pytest.mark.parametrize("name", EVERY)
def test_a_batch_is_its_single_tracks(name: str) -> None:
    """Every array of the state, whatever the neighbours do: gaps, correlated noise."""
    estimator = EVERY[name]
    z, R = journey(4, FRAMES, TRACKS), noises("by detection")
    together = last(estimator, z, R)
    single: Any = last(estimator, z[:, :1], R[:, :1])
    for k in range(1, TRACKS):
        single = join(single, last(estimator, z[:, [k]], R[:, [k]]))
    assert {f: a.shape for f, a in contents(single).items()} == {
        f: a.shape for f, a in contents(together).items()
    }
    assert bytes_of(single) == bytes_of(together)
