"""Claim: compiled or interpreted, whole or frame by frame, a tracker gives the same bits."""

import gc
import json
import os
import subprocess
import sys
import tracemalloc
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mdkf
from mdkf import Detections, Tracker, Tracks
from mdkf.association import Room
from mdkf.engines import SLOTS
from tests.mdkf.scenes import BUILT_IN, IMM, KALMAN, MD

ROOT = Path(mdkf.__file__).parents[1]

EVERY = {
    **KALMAN,
    **IMM,
    "md2": MD["md2-F-literal-reset-independent"],
    "md3": mdkf.MotionDynamics(3),
}

OPTIONS: dict[str, dict[str, Any]] = {
    "robmot": {"position": "measurement"},
    "optimal": {"assignment": "optimal", "max_missed": 6},
    "mahalanobis": {"cost": "mahalanobis", "gate": 3.0},
    "no coasting": {"coasting": False, "score": 3.0, "confirmed_score": 1.0},
}


def traffic(seed: int, frames: int, objects: int, missed: float = 0.2) -> Detections:
    """Cars that come, drive, stop and go, at random in a square; some missed, some false, some
    scored low, some at the very place of another."""
    rng = np.random.default_rng(seed)
    velocity = rng.normal(0, 5, (objects, 2)) * (rng.random((frames, objects, 1)) < 0.7)
    place = rng.uniform(0, 6 * np.sqrt(objects), (objects, 2)) + 0.1 * np.cumsum(velocity, axis=0)
    place += rng.normal(0, 0.1, place.shape)
    seen = rng.random((frames, objects)) >= missed
    born, gone = np.sort(rng.integers(0, frames, (2, objects)), axis=0)
    time = np.arange(frames)[:, None]
    frame, source = np.nonzero(seen & (time >= born) & (time <= gone))
    xy = place[frame, source]
    false = rng.integers(0, frames, objects)
    frame = np.concatenate([frame, false, false])
    elsewhere = np.tile(rng.uniform(0, 6 * np.sqrt(objects), (objects, 2)), (2, 1))
    n = len(frame)
    columns = {
        "frame": frame,
        "source": np.concatenate([source, np.full(2 * objects, -1)]),
        **dict(zip("xy", np.concatenate([xy, elsewhere]).T, strict=True)),
        "z": rng.normal(0.8, 0.1, n),
        "yaw": rng.uniform(-np.pi, np.pi, n),
        "score": rng.normal(4, 2, n),
        **{name: rng.uniform(1.5, 4.5, n) for name in ("length", "width", "height")},
    }
    return Detections.from_columns(columns, n_frames=frames, dt=0.1)


class Own:
    """A user's estimator: everything of a built-in one, but what the compiled pass needs; what it
    calls `batch` is its own affair."""

    batch = 32

    def __init__(self, estimator: Any) -> None:
        for name in (
            "start",
            "predict",
            "update",
            "position",
            "velocity",
            "covariance",
            "diagnostics",
        ):
            setattr(self, name, getattr(estimator, name))


def assert_same_bits(came: Tracks, wanted: Tracks) -> None:
    assert came.content_hash() == wanted.content_hash()
    assert list(came.columns()) == list(wanted.columns())


@pytest.mark.parametrize("options", OPTIONS)
@pytest.mark.parametrize("name", EVERY)
def test_an_interpreted_estimator_gives_the_compiled_ones_bits(name: str, options: str) -> None:
    """All columns, diagnostics included, with more tracks than there are slots at first."""
    seen = traffic(0, 60, 60)
    compiled = Tracker(EVERY[name], "pvrcnn", **OPTIONS[options]).run(seen)
    assert len(compiled.ids()) > 30
    assert_same_bits(Tracker(Own(EVERY[name]), "pvrcnn", **OPTIONS[options]).run(seen), compiled)


def test_a_subclass_is_what_it_says() -> None:
    """One that changes a built-in estimator's prediction is not run by the built-in's kernels."""

    class Standing(mdkf.Kalman):
        def predict(self, state: Any, dt: float) -> Any:
            state = super().predict(state, dt)
            state.mean[:, 1::3] = 0.0
            return state

    seen = traffic(6, 60, 10)
    coasted = Tracker(Standing(), "pvrcnn").run(seen)
    assert (coasted.vx[coasted.coasted] == 0.0).all()
    z = np.cumsum(np.ones((20, 3, 2)), axis=0)
    z[10:] = np.nan
    told = mdkf.filter_sequence(Standing(), z, np.eye(2), 0.1)
    assert (told.velocity[10:] == 0.0).all()


@pytest.mark.parametrize("own", [False, True])
@pytest.mark.parametrize("options", OPTIONS)
@pytest.mark.parametrize("name", ["kalman2", "imm2-zero", "md2"])
def test_steps_are_the_run_to_the_bit(name: str, options: str, own: bool) -> None:
    """One frame after another, joined; also after a reset, and with runs in between."""
    seen = traffic(1, 60, 40)
    estimator = Own(EVERY[name]) if own else EVERY[name]
    tracker = Tracker(estimator, "pvrcnn", confirmation="online", **OPTIONS[options])
    whole = tracker.run(seen)
    assert len(whole) > 100
    for _ in range(2):
        stepped = [tracker.step(frame_of(seen, k)) for k in range(seen.n_frames)]
        tracker.run(frame_of(seen, 3))
        columns = {
            name: np.concatenate([t.columns()[name] for t in stepped if len(t)])
            for name in whole.columns()
            if name != "frame"
        }
        columns["frame"] = np.repeat(np.arange(seen.n_frames), [len(t) for t in stepped])
        diagnostics = {name: columns.pop(name) for name in whole.diagnostics}
        joined = Tracks.from_columns(
            columns, n_frames=seen.n_frames, dt=seen.dt, diagnostics=diagnostics
        )
        assert_same_bits(joined, whole)
        tracker.reset()


def frame_of(seen: Detections, k: int) -> Detections:
    """One frame as a table of its own."""
    rows = seen.frame_rows(k)
    columns = {name: values[rows] for name, values in seen.columns().items()}
    columns["frame"] = np.zeros(rows.stop - rows.start, dtype=np.int64)
    return Detections.from_columns(columns, n_frames=1, dt=seen.dt)


@pytest.mark.parametrize("own", [False, True])
def test_steps_may_be_uneven(own: bool) -> None:
    """A step's dt is the time since the last: one object's track is its estimator run by hand."""
    rng = np.random.default_rng(2)
    estimator = mdkf.MotionDynamics()
    tracker = Tracker(
        Own(estimator) if own else estimator, "pvrcnn", confirmation="online", validity=1
    )
    seen = frame_of(traffic(2, 40, 10), 25).take(np.array([0]))
    R = np.diag([tracker.settings.x_var, tracker.settings.y_var])[None]
    state: Any = None
    for k, dt in enumerate(rng.choice([0.05, 0.1, 0.3], 40)):
        x = 0.2 * k + rng.normal(0, 0.1)
        columns = seen.columns() | {"x": np.array([x]), "score": np.array([2.0])}
        told = tracker.step(Detections.from_columns(columns, n_frames=1, dt=dt))
        z = np.array([[x, seen.y[0]]])
        if state is None:
            state = estimator.start(z, R)
        else:
            state = estimator.update(estimator.predict(state, dt), z, R)
        assert (told.x[0], told.y[0]) == tuple(estimator.position(state)[0])


def test_a_step_says_what_it_needs() -> None:
    """One frame, and a confirmation that does not look ahead."""
    seen = traffic(3, 5, 5)
    with pytest.raises(ValueError, match="a step takes one frame, not 5"):
        Tracker(mdkf.Kalman(), confirmation="online").step(seen)
    with pytest.raises(ValueError, match="confirmation='online'"):
        Tracker(mdkf.Kalman()).step(frame_of(seen, 0))


@pytest.mark.parametrize("own", [False, True])
def test_after_a_step_that_failed_half_way_there_is_no_next(
    own: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Here for want of memory in a frame that brings more than there is room for; then it is the
    tracker from the start."""
    seen = traffic(7, 20, 200)
    estimator = Own(mdkf.Kalman()) if own else mdkf.Kalman()
    tracker = Tracker(estimator, "pvrcnn", confirmation="online", validity=1)
    few, many = frame_of(seen, 10).take(np.arange(5)), frame_of(seen, 10)
    assert len(many) > 2 * SLOTS

    def none_left(*_: int) -> Room:
        raise MemoryError

    first = tracker.step(few)
    with monkeypatch.context() as patched:
        patched.setattr(Room, "of", none_left)
        with pytest.raises(MemoryError):
            tracker.step(many)
    with pytest.raises(RuntimeError, match="failed half-way; reset starts anew"):
        tracker.step(many)
    tracker.reset()
    assert_same_bits(tracker.step(few), first)
    assert len(tracker.step(many)) > 0


@pytest.mark.parametrize("own", [False, True])
def test_steps_take_constant_memory(own: bool) -> None:
    """What a tracker holds after 4000 frames, in which hundreds of tracks came and went, is what
    it held after 2000: less than 10 bytes a frame more, where a row of a report alone has 160."""
    seen = traffic(4, 500, 40)
    estimator = Own(mdkf.MotionDynamics()) if own else mdkf.MotionDynamics()
    tracker = Tracker(estimator, "pvrcnn", confirmation="online")
    frames = [frame_of(seen, k) for k in range(seen.n_frames)]
    held = []
    tracemalloc.start()
    for _ in range(8):
        for now in frames:
            tracker.step(now)
        gc.collect()
        held.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert held[7] - held[3] < 20_000, held


def test_the_same_source_without_the_jit_gives_the_same_bits() -> None:
    """Interpreted by Python, the whole tracker with every built-in estimator and option."""
    run = subprocess.run(
        [sys.executable, "-m", "tests.mdkf.test_engines"],
        cwd=ROOT,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert json.loads(run.stdout) == digests()


def digests() -> Mapping[str, str]:
    """A hash of the tracks of each built-in estimator, and of each set of options."""
    seen = traffic(5, 60, 10, missed=0.02)
    found = {
        name: Tracker(built, "pvrcnn", validity=5).run(seen).content_hash()
        for name, built in BUILT_IN.items()
    }
    for name, options in OPTIONS.items():
        found[name] = Tracker(mdkf.MotionDynamics(), "pvrcnn", **options).run(seen).content_hash()
    return found


def test_the_digests_tell_the_runs_apart() -> None:
    """They would notice a change."""
    found = digests()
    assert len(set(found.values())) == len(found)


if __name__ == "__main__":
    json.dump(digests(), sys.stdout)
