"""Claim: what cannot be used is refused by an error that shows it, and changes nothing."""

from typing import Any

import numpy as np
import pytest

from mdkf import InteractingMultipleModel, Kalman, MotionDynamics, filter_sequence
from tests.mdkf.scenes import BUILT_IN, DT, Array, bytes_of, covariances, journey, last

every = pytest.mark.parametrize("name", BUILT_IN)
nan, inf = float("nan"), float("inf")

ROW = 1
"""The row of two that is spoilt."""

POSITIONS = {
    "nan, 0": ([nan, 0.0], r"measurement 1 is \[ *nan +0\."),
    "0, nan": ([0.0, nan], r"measurement 1 is \[ *0\. +nan"),
    "inf, 0": ([inf, 0.0], r"measurement 1 is \[ *inf +0\."),
    "0, -inf": ([0.0, -inf], r"measurement 1 is \[ *0\. +-inf"),
    "nan, inf": ([nan, inf], r"measurement 1 is \[ *nan +inf"),
}

NOISES = {
    "negative": ([[-0.1, 0.0], [0.0, 0.2]], r"noise 1 is \[\[-0\.1"),
    "both negative": ([[-0.1, 0.0], [0.0, -0.2]], r"noise 1 is \[\[-0\.1"),
    "zero": ([[0.0, 0.0], [0.0, 0.2]], r"noise 1 is \[\[0\.0"),
    "nan": ([[0.1, 0.0], [0.0, nan]], r"noise 1 is .*nan"),
    "nan covariance": ([[0.1, nan], [nan, 0.1]], r"noise 1 is .*nan"),
    "infinite": ([[inf, 0.0], [0.0, 0.1]], r"noise 1 is \[\[inf"),
    "infinite covariance": ([[0.1, inf], [inf, 0.1]], r"noise 1 is .*inf"),
    "asymmetric": ([[0.1, 0.05], [0.04, 0.1]], r"noise 1 is .*0\.05.*0\.04"),
    "half a matrix": ([[0.1, 0.05], [0.0, 0.1]], r"noise 1 is .*0\.05"),
    "indefinite": ([[0.1, 0.3], [0.3, 0.1]], r"noise 1 is .*0\.3"),
    "singular": ([[0.25, 0.25], [0.25, 0.25]], r"noise 1 is .*0\.25"),
}

SHAPES: dict[str, tuple[Any, Any]] = {
    "too many positions": (np.zeros((3, 2)), np.tile(np.eye(2), (3, 1, 1))),
    "too few positions": (np.zeros((1, 2)), np.tile(np.eye(2), (1, 1, 1))),
    "positions in 3 dimensions": (np.zeros((2, 3)), np.tile(np.eye(2), (2, 1, 1))),
    "a flat position": (np.zeros(2), np.tile(np.eye(2), (2, 1, 1))),
    "one matrix": (np.zeros((2, 2)), np.eye(2)),
    "variances": (np.zeros((2, 2)), np.ones((2, 2))),
    "3 x 3 noise": (np.zeros((2, 2)), np.tile(np.eye(3), (2, 1, 1))),
    "noise of one track": (np.zeros((2, 2)), np.eye(2)[None]),
}


def good() -> tuple[Array, Array]:
    """Positions (2, 2) and noise (2, 2, 2) that can be used."""
    return np.array([[1.0, 2.0], [3.0, 4.0]]), covariances(np.random.default_rng(0), (2,))


def spoilt(position: Any = None, noise: Any = None) -> tuple[Array, Array]:
    """The same with one row replaced."""
    z, R = good()
    if position is not None:
        z[ROW] = position
    if noise is not None:
        R[ROW] = noise
    return z, R


def midway(name: str) -> Any:
    """A state with history: windows filled, x and y correlated."""
    R = covariances(np.random.default_rng(1), (30, 2))
    return last(BUILT_IN[name], journey(1, 30, 2, gaps=False), R)


BAD = {
    **{f"position {k}": (spoilt(position=p), told) for k, (p, told) in POSITIONS.items()},
    **{f"noise {k}": (spoilt(noise=R), told) for k, (R, told) in NOISES.items()},
}


@every
def test_bad_measurements(name: str) -> None:
    """In start and in update: the row and its value are told, the state keeps its bytes."""
    estimator, state = BUILT_IN[name], midway(name)
    before = bytes_of(state)
    for what, ((z, R), told) in BAD.items():
        copies = z.tobytes(), R.tobytes()
        with pytest.raises(ValueError, match=told):
            estimator.update(state, z, R)
        with pytest.raises(ValueError, match=told):
            estimator.start(z, R)
        assert bytes_of(state) == before, what
        assert (z.tobytes(), R.tobytes()) == copies, what


@every
def test_the_same_rows_are_accepted_when_they_are_sound(name: str) -> None:
    """What the refusals are held against: the unspoilt rows pass, in start and update; a row of
    NaN passes in update, whatever its noise is, and is refused in start."""
    estimator, state = BUILT_IN[name], midway(name)
    estimator.start(*good())
    estimator.update(state, *good())
    z, R = spoilt(position=[nan, nan], noise=np.full((2, 2), nan))
    after = estimator.update(state, z, R)
    assert np.array_equal(estimator.position(after)[ROW], estimator.position(state)[ROW])
    with pytest.raises(ValueError, match=r"first position 1 is \[ *nan +nan"):
        estimator.start(z, R)


@every
def test_noise_that_rounding_made_asymmetric_is_accepted(name: str) -> None:
    """A covariance turned by G R G' is symmetric but for its last digits."""
    z, R = good()
    R[:, 0, 1] *= 1 + 1e-15
    assert (R[:, 0, 1] != R[:, 1, 0]).any()
    BUILT_IN[name].update(midway(name), z, R)


@every
def test_wrong_shapes(name: str) -> None:
    """In start and update; the shapes that came and those expected are told."""
    estimator, state = BUILT_IN[name], midway(name)
    before = bytes_of(state)
    for what, (z, R) in SHAPES.items():
        with pytest.raises(ValueError, match=r"have shapes .* expected \(2, 2\) and \(2, 2, 2\)"):
            estimator.update(state, z, R)
        if not what.startswith("too"):
            with pytest.raises(ValueError, match="have shapes"):
                estimator.start(z, R)
        assert bytes_of(state) == before, what


@every
@pytest.mark.parametrize("dt", [0.0, -0.1, nan, inf, -inf])
def test_bad_steps(name: str, dt: float) -> None:
    """In predict, and in `filter_sequence` as a number and among others."""
    estimator, state = BUILT_IN[name], midway(name)
    before, told = bytes_of(state), rf"dt is {dt} s"
    with pytest.raises(ValueError, match=told):
        estimator.predict(state, dt)
    assert bytes_of(state) == before
    z, (_, R) = journey(1, 4, 2, gaps=False), good()
    for steps in (dt, [DT, dt, DT]):
        with pytest.raises(ValueError, match=told):
            filter_sequence(estimator, z, R, steps)


@every
def test_bad_sequences(name: str) -> None:
    """`filter_sequence` refuses the same rows, in the compiled pass and in the loop."""
    estimator = BUILT_IN[name]
    for steps in (DT, np.full(3, DT)):
        for (bad_z, bad_R), told in BAD.values():
            z, R = journey(1, 4, 2, gaps=False), np.tile(good()[1], (4, 1, 1, 1))
            z[2], R[2] = bad_z, bad_R
            with pytest.raises(ValueError, match=told.replace(" 1 is", " of frame 2, track 1 is")):
                filter_sequence(estimator, z, R, steps)
        z = journey(1, 4, 2, gaps=False)
        z[0, ROW] = nan
        with pytest.raises(ValueError, match="first position 1 is"):
            filter_sequence(estimator, z, good()[1], steps)


@every
def test_sequences_of_wrong_shape(name: str) -> None:
    """Positions that are not (T, n, 2), noise and steps that do not fit them."""
    estimator, (_, R) = BUILT_IN[name], good()
    z = journey(1, 4, 2, gaps=False)
    for positions in (z[0], z[:0], z[..., :1], z[..., None], 0.0):
        with pytest.raises(ValueError, match=r"expected \(T, n, 2\)"):
            filter_sequence(estimator, positions, R, DT)
    for noise in (0.1, [0.1, 0.2], np.eye(3), np.ones((3, 2, 2)), np.tile(R, (3, 1, 1, 1))):
        with pytest.raises(ValueError, match=r"noise has shape .* expected \(2, 2\)"):
            filter_sequence(estimator, z, noise, DT)
    for steps in (np.full(4, DT), np.full(2, DT), np.full((3, 2), DT)):
        with pytest.raises(ValueError, match=r"dt has shape .* expected one number or 3"):
            filter_sequence(estimator, z, R, steps)


def options(kind: Any, *orders: int) -> list[Any]:
    """Bad values of the options that all three estimators have."""
    top = orders[-1]
    return [
        *[(kind, {"order": order}, f"order is {order}") for order in (-1, 0, 4, 2.5, nan)],
        *[
            (kind, {"order": top, "process_density": density}, "process_density is")
            for density in ((0.1,), (), (0.1, -0.01, 0.001), (0.1, nan, 0.0), (inf, 0.1, 0.1))
        ],
        *[
            (kind, {"order": top, "start_variance": variance}, "start_variance is")
            for variance in ((2.0, 4.0), (), (2.0, 4.0, 0.0, 8.0), (-2.0, 4.0, 8.0, 8.0))
        ],
        (kind, {"order": top, "start_variance": (2.0, nan, 8.0, 8.0)}, "start_variance is .*nan"),
        (kind, {"order": top, "start_variance": (2.0, inf, 8.0, 8.0)}, "start_variance is .*inf"),
    ]


@pytest.mark.parametrize(
    ("kind", "option", "told"),
    [
        *options(Kalman, 1, 2, 3),
        *options(InteractingMultipleModel, 2, 3),
        *options(MotionDynamics, 2, 3),
        (InteractingMultipleModel, {"order": 1}, "order is 1"),
        (MotionDynamics, {"order": 1}, "order is 1"),
        *[
            (InteractingMultipleModel, {"stay": stay}, f"stay is {stay}")
            for stay in (0.0, 1.0, -0.1, 1.5, nan, inf)
        ],
        (InteractingMultipleModel, {"mixing": "both"}, "mixing is 'both', expected one of"),
        *[(MotionDynamics, {"window": k}, f"window is {k}") for k in (1, 0, -3, 20.5, nan)],
        *[
            (MotionDynamics, {"factors": factors}, "factors are")
            for factors in ((), (0.1,), (0.1, 0.2, 0.3), (0.0, 0.2), (0.1, -0.2), (nan, 0.1))
        ],
        (MotionDynamics, {"factors": (0.1, inf)}, "factors are .*inf"),
        (MotionDynamics, {"order": 3, "factors": (0.1, 0.2)}, "factors are .*expected 3"),
        *[
            (MotionDynamics, {option: "else"}, f"{option} is 'else', expected one of")
            for option in ("covariance_by", "denoise", "after_gap", "axes")
        ],
    ],
)
def test_bad_options(kind: Any, option: dict[str, Any], told: str) -> None:
    """Refused when the estimator is built, by name and value."""
    with pytest.raises(ValueError, match=told):
        kind(**option)
