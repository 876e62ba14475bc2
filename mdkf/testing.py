"""Checks that an estimator of one's own keeps the contract of `mdkf.Estimator`.

    import mdkf
    mdkf.testing.check_estimator(MyEstimator())

Each check is a function of an estimator, named after what it looks at; the first that fails
raises `EstimatorCheckError`. With pytest, one test for each:

    @pytest.mark.parametrize("check", mdkf.testing.CHECKS, ids=lambda check: check.__name__)
    def test_my_estimator(check):
        check(MyEstimator())

Nothing here needs pytest. The scenes are seeded; metres and seconds throughout.
"""

import copy
import re
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mdkf.checking import (
    DT,
    NOISE,
    Broken,
    Check,
    EstimatorCheckError,
    bytes_of,
    error_of,
    given,
    history,
    noise_of,
    outputs,
    require_array,
    require_diagnostics,
    require_growth,
    require_same,
    require_state,
    scene,
    stacked,
    states,
)
from mdkf.estimator import Estimator, join, take
from mdkf.tables import Detections
from mdkf.tracker import Tracker

__all__ = ["BEHAVIOUR", "CHECKS", "CONTRACT", "EstimatorCheckError", "check_estimator"]

METHODS = ("start", "predict", "update", "position", "velocity", "covariance", "diagnostics")
"""The methods of `mdkf.Estimator`."""


def check_estimator(estimator: Estimator, *, strict: bool = True) -> None:
    """Run all checks in order; `EstimatorCheckError` at the first that fails.

    strict=False runs `CONTRACT` only: what `Tracker` and the experiments rely upon. The others
    (`BEHAVIOUR`) a sound estimator may fail on purpose: one bound to a map is not the same
    everywhere, one that holds the last position has no velocity.
    """
    for check in CHECKS if strict else CONTRACT:
        check(estimator)


@given("the estimator itself")
def check_methods(estimator: Estimator) -> None:
    """It is an object (no class) with all methods."""
    if isinstance(estimator, type):
        raise Broken("an object", f"the class {estimator.__name__}: call it")
    missing = [name for name in METHODS if not callable(getattr(estimator, name, None))]
    if missing:
        raise Broken("the methods of mdkf.Estimator", f"none named {', '.join(missing)}")


@given("7 tracks")
def check_state(estimator: Estimator) -> None:
    """States are arrays, or dataclasses of arrays, with the tracks first; rows can be moved."""
    z, noise = scene(7, 2).copy(), np.tile(NOISE, (7, 1, 1))
    state = estimator.start(z[0], noise)
    require_state(state, 7, "start")
    state = estimator.predict(state, DT)
    require_state(state, 7, "predict")
    state = estimator.update(state, z[1], noise)
    require_state(state, 7, "update")
    first, second = np.array([5, 0, 2]), np.array([6, 1])
    moved = estimator.position(join(take(state, first), take(state, second)))
    wanted = estimator.position(state)[[*first, *second]]
    require_same(moved, wanted, "positions that move with the rows")


@given("1 track, then 3, then none")
def check_shapes(estimator: Estimator) -> None:
    """position (n, 2), velocity (n, 2), covariance (n, 2, 2) in float64; diagnostics (n,).

    No tracks are what a tracker has after the last was deleted.
    """
    z, names = scene(3, 2).copy(), list[str]()
    state: Any = None
    for n in (1, 3, 0):
        noise = np.tile(NOISE, (n, 1, 1))
        state = estimator.start(z[0, :n], noise) if n else take(state, np.arange(0))
        after = {"start" if n else "take": state}
        after["predict"] = state = estimator.predict(state, DT)
        after["update"] = state = estimator.update(state, z[1, :n], noise)
        for method, told in after.items():
            which = f"{n} track{'s' * (n != 1)} after {method}"
            require_array(estimator.position(told), "position", (n, 2), which)
            require_array(estimator.velocity(told), "velocity", (n, 2), which)
            require_array(estimator.covariance(told), "covariance", (n, 2, 2), which)
            diagnostics = estimator.diagnostics(told)
            require_diagnostics(diagnostics, n, which)
            names = names or list(diagnostics)
            if list(diagnostics) != names:
                raise Broken(f"diagnostics named {names} as before", f"{[*diagnostics]}", which)


@given("read-only measurements, their noise broadcast from one matrix")
def check_read_only(estimator: Estimator) -> None:
    """Measurements are not written to, and the noise may have strides of zero."""
    for _ in states(estimator, scene(3, 3)):
        pass


@given("the same state to one method after the other")
def check_state_is_kept(estimator: Estimator) -> None:
    """predict, update and the methods that read a state leave it as it was."""
    z = scene(3, 12, gaps=True)
    for state in states(estimator, z):
        before = bytes_of(state)
        for method in ("predict", "update", "position", "velocity", "covariance", "diagnostics"):
            more = {"predict": (DT,), "update": (z[1], noise_of(3))}.get(method, ())
            getattr(estimator, method)(state, *more)
            if bytes_of(state) != before:
                raise Broken("a state that stays as it was", f"other values after {method}")


@given("3 tracks of which one, then all, are not measured (rows of NaN)")
def check_gap(estimator: Estimator) -> None:
    """A row of NaN leaves its track as predicted, and the other tracks' updates as they were."""
    z = scene(3, 22)
    *_, state = states(estimator, z[:21])
    predicted = estimator.predict(state, DT)
    before = outputs(estimator, predicted)
    full = outputs(estimator, estimator.update(predicted, z[21], noise_of(3)))
    for missing in ([1], [0, 1, 2]):
        measured = z[21].copy()
        measured[missing] = np.nan
        came = outputs(estimator, estimator.update(predicted, measured, noise_of(3)))
        seen = np.setdiff1d(np.arange(3), missing)
        for name in ("position", "velocity", "covariance"):
            require_same(came[name][missing], before[name][missing], f"{name} as predicted")
            require_same(came[name][seen], full[name][seen], f"{name} of the others as without NaN")


@given("5 tracks over 500 frames with gaps of up to 30, at last a jump of 10 km")
def check_numbers(estimator: Estimator) -> None:
    """Numbers stay finite, covariances symmetric and positive definite."""
    z = scene(5, 500, gaps=True).copy()
    z[-1] = 1e4
    for state in states(estimator, z, between=True):
        for name, values in outputs(estimator, state).items():
            # A diagnostic may be NaN where it has nothing to tell.
            diagnostic = name not in ("position", "velocity", "covariance")
            if not (np.isfinite(values) | (diagnostic & np.isnan(values))).all():
                raise Broken(f"finite {name}", f"{values.tolist()}")
        P = estimator.covariance(state)
        symmetric = np.isclose(P[:, 0, 1], P[:, 1, 0], rtol=1e-6, atol=1e-12)
        determinant = P[:, 0, 0] * P[:, 1, 1] - P[:, 0, 1] * P[:, 1, 0]
        good = symmetric & (P[:, 0, 0] > 0) & (determinant > 0)
        if not good.all():
            worst = P[np.argmin(good)].tolist()
            raise Broken("symmetric, positive definite covariances", f"{worst}")


@given("the same measurements twice, and to a deep copy of the estimator")
def check_determinism(estimator: Estimator) -> None:
    """The same inputs give the same bytes."""
    z = scene(4, 60, gaps=True)
    first = history(estimator, z)
    again = {"the same object": estimator}
    with suppress(Exception):  # what cannot be copied need not be
        again["its copy"] = copy.deepcopy(estimator)
    for who, built in again.items():
        for name, values in history(built, z).items():
            if values.tobytes() != first[name].tobytes():
                raise Broken(f"the same bytes of {name} from {who}", "others")


@given("two sets of tracks, every call for the one after a call for the other")
def check_memory(estimator: Estimator) -> None:
    """Nothing is remembered between calls but in the states."""
    z, other = scene(3, 40, gaps=True), scene(3, 40, seed=1)
    alone = stacked(estimator, states(estimator, z, between=True))
    turns = zip(
        states(estimator, z, between=True),
        states(estimator, other, dt=2.5 * DT, between=True),
        strict=True,
    )
    for name, values in stacked(estimator, (state for state, _ in turns)).items():
        require_same(values, alone[name], f"the {name} that the set has alone")


@given("4 tracks together, each alone, and in another order")
def check_rows(estimator: Estimator) -> None:
    """A track depends neither on its neighbours nor on its row."""
    z = scene(4, 60, gaps=True)
    together = history(estimator, z)
    for rows in ([0], [1], [2], [3], [2, 0, 3, 1]):
        for name, values in history(estimator, z[:, rows]).items():
            require_same(values, together[name][:, rows], f"{name} of tracks {rows} as among all")


@given("two cars 10 m apart at 5 m/s, detected in 40 frames, one of them not in 3")
def check_tracker(estimator: Estimator) -> None:
    """`mdkf.Tracker` follows two clearly seen cars as two tracks without a break."""
    frame, car = np.repeat(np.arange(40), 2), np.tile([0, 1], 40)
    columns: dict[str, NDArray[Any]] = dict.fromkeys(Detections.column_types(), np.ones(80))
    columns |= {"frame": frame, "source": car, "x": 0.5 * frame, "y": 10.0 * car}
    columns["score"] = np.full(80, 10.0)
    seen = (car == 0) | (frame < 20) | (frame > 22)
    columns = {name: values[seen] for name, values in columns.items()}
    tracker = Tracker(estimator)
    tracks = tracker.run(Detections.from_columns(columns, n_frames=40, dt=DT))
    rows = [len(tracks.rows_of(int(identifier))) for identifier in tracks.ids()]
    if rows != [40, 40]:
        limit = f"a position's variance of {tracker.settings.max_variance:g} m2 ends a track"
        raise Broken("2 tracks of 40 frames", f"tracks of {rows} frames ({limit})")


@given("repr(estimator)")
def check_repr(estimator: Estimator) -> None:
    """Its repr, which is written beside its tracks, says what it is, not where in memory."""
    if re.search(r"\bat 0x[0-9a-fA-F]+", repr(estimator)):
        raise Broken("no address in it (a dataclass has a good repr)", repr(estimator))


@given("5 tracks over 60 frames, then 40 predictions without a measurement")
def check_gap_uncertainty(estimator: Estimator) -> None:
    """Uncertainty does not shrink while nothing is seen."""
    z = scene(5, 100).copy()
    z[60:] = np.nan
    covariance = history(estimator, z)["covariance"]
    require_growth(np.trace(covariance, axis1=2, axis2=3)[59:], "with every miss")


@given("a prediction by a microsecond")
def check_short_step(estimator: Estimator) -> None:
    """Position and covariance are continuous in time: a tiny step changes them little."""
    for state in states(estimator, scene(4, 40)):
        before, after = (outputs(estimator, s) for s in (state, estimator.predict(state, 1e-6)))
        for name in ("position", "covariance"):
            change = float(np.abs(after[name] - before[name]).max())
            if not change < 1e-3:
                raise Broken(f"{name} changed by less than 0.001", f"a change by {change:.3g}")


@given("predictions by 0.05, 0.1, 0.2, 0.5 and 1 s from one state")
def check_longer_step(estimator: Estimator) -> None:
    """The longer the step, the larger the predicted covariance, or at least no smaller."""
    for state in states(estimator, scene(4, 40)):
        later = [estimator.predict(state, dt) for dt in (0.05, 0.1, 0.2, 0.5, 1.0)]
        covariance = np.stack([estimator.covariance(s) for s in later])
        require_growth(np.trace(covariance, axis1=2, axis2=3), "with the step")


@given("a scene, and the same moved by (1000, -2000) m")
def check_translation(estimator: Estimator) -> None:
    """Moving the scene moves the positions and leaves velocities and covariances."""
    z, offset = scene(4, 80, gaps=True), np.array([1000.0, -2000.0])
    here, there = history(estimator, z), history(estimator, z + offset)
    require_same(there["position"] - offset, here["position"], "positions moved as much", 1e-6)
    for name in ("velocity", "covariance"):
        require_same(there[name], here[name], f"the same {name}", 1e-6)


@given("50 exact positions of a target that moves at (10, -5) m/s")
def check_follows(estimator: Estimator) -> None:
    """A target of constant velocity is followed: position to 0.1 m, velocity to 1 m/s."""
    velocity = np.array([10.0, -5.0])
    z = (DT * np.arange(50)[:, None] * velocity)[:, None]
    *_, state = states(estimator, z)
    for name, came, true, limit in (
        ("position", estimator.position(state)[0], z[-1, 0], 0.1),
        ("velocity", estimator.velocity(state)[0], velocity, 1.0),
    ):
        if not np.hypot(*(came - true)) < limit:
            raise Broken(f"{name} within {limit} of {true.tolist()}", f"{came.tolist()}")


@given("bad input")
def check_bad_input(estimator: Estimator) -> None:
    """What cannot be used is refused by `ValueError`, and the state stays as it was.

    Three functions of `mdkf.estimator` do it: `checked_start(position, noise)` in start,
    `check_step(dt)` in predict and `checked_measurement(len(state), position, noise)` in update.
    """
    z, noise = scene(2, 5), noise_of(2)
    *_, state = states(estimator, z[:4])
    half, infinite, none = z[4].copy(), z[4].copy(), np.full((2, 2), np.nan)
    half[1, 0], infinite[0, 1] = np.nan, np.inf
    predict, update = partial(estimator.predict, state), partial(estimator.update, state)
    before = bytes_of(state)
    for what, call in {
        "a track that starts at NaN": partial(estimator.start, none, noise),
        "a track that starts at infinity": partial(estimator.start, infinite, noise),
        "a step of 0 s": partial(predict, 0.0),
        "a step of -0.1 s": partial(predict, -0.1),
        "a step of NaN s": partial(predict, float("nan")),
        "a measurement with one infinite number": partial(update, infinite, noise),
        "a measurement of NaN and a number": partial(update, half, noise),
        "3 measurements of 2 tracks": partial(update, np.zeros((3, 2)), noise_of(3)),
        "measurements (2, 3) of 2 tracks": partial(update, np.zeros((2, 3)), noise),
        "noise (2, 2) for 2 tracks": partial(update, z[4], NOISE),
        "noise of negative variance": partial(update, z[4], -noise),
    }.items():
        came = "no error"
        try:
            call()
        except ValueError:
            came = ""
        except Exception as error:
            came = error_of(error)
        if came:
            raise Broken("ValueError", came, what)
        if bytes_of(state) != before:
            raise Broken("the state as before the error", "other values in it", what)


CONTRACT: tuple[Check, ...] = (
    check_methods,
    check_state,
    check_shapes,
    check_read_only,
    check_state_is_kept,
    check_gap,
    check_numbers,
    check_determinism,
    check_memory,
    check_rows,
    check_tracker,
)
"""What `mdkf.Tracker` and the experiments rely upon, in the order of running."""

BEHAVIOUR: tuple[Check, ...] = (
    check_repr,
    check_gap_uncertainty,
    check_short_step,
    check_longer_step,
    check_translation,
    check_follows,
    check_bad_input,
)
"""What a filter of free motion does besides; all built-in estimators pass."""

CHECKS: tuple[Check, ...] = CONTRACT + BEHAVIOUR
"""All checks, in the order in which `check_estimator` runs them."""
