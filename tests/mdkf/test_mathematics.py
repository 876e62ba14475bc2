"""Claim: the filters obey the identities that the mathematics of estimation promises."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import block_diag

from mdkf import Kalman, MotionDynamics
from mdkf.motion import START_VARIANCE, transition
from tests.mdkf.scenes import (
    EVERY,
    IMM,
    KALMAN,
    MD,
    Array,
    assert_same_moments,
    contents,
    covariances,
    journey,
    last,
    rotation,
)

FRAMES, TRACKS = 60, 4
orders = pytest.mark.parametrize("order", [1, 2, 3])
coupling = pytest.mark.parametrize("correlated", [False, True], ids=["uncoupled", "coupled"])


def moments(state: Any) -> tuple[Array, Array]:
    """Mean and covariance of the whole state."""
    return state.mean, state.covariance


def noise(seed: int, correlated: bool = True, frames: int = FRAMES) -> Array:
    """Each detection's own covariance (frames, TRACKS, 2, 2) [m2]."""
    return covariances(np.random.default_rng(seed), (frames, TRACKS), correlated=correlated)


def midway(estimator: Any, seed: int, correlated: bool) -> Any:
    """States in the middle of a journey, x and y correlated or not."""
    state = last(estimator, journey(seed, 20, TRACKS), noise(seed, correlated, 20))
    m = state.mean.shape[-1] // 2
    assert (np.abs(state.covariance[..., :m, m:]).max() > 0) == correlated
    return state


@orders
@coupling
@given(first=st.floats(1e-3, 2.0), second=st.floats(1e-3, 2.0))
@settings(max_examples=60, deadline=None, derandomize=True)
def test_two_predictions_are_one_of_both_steps(
    order: int, correlated: bool, first: float, second: float
) -> None:
    """F(a) F(b) = F(a + b), and Q is the exact integral, so no step is special."""
    estimator = Kalman(order=order)
    state = midway(estimator, order, correlated)
    halves = estimator.predict(estimator.predict(state, first), second)
    whole = estimator.predict(state, first + second)
    assert_same_moments(moments(halves), moments(whole), 1e-12)


@pytest.mark.parametrize("name", [*KALMAN, *MD])
@coupling
def test_the_order_of_simultaneous_measurements_does_not_matter(
    name: str, correlated: bool
) -> None:
    """Bayes' rule is commutative: A then B is B then A, with their own R each."""
    estimator = EVERY[name]
    state = estimator.predict(midway(estimator, 1, correlated), 0.1)
    rng = np.random.default_rng(2)
    position = estimator.position(state)
    A, B = (
        (position + rng.normal(0, 0.5, (TRACKS, 2)), covariances(rng, (TRACKS,), correlated=kind))
        for kind in (correlated, False)
    )
    forth = estimator.update(estimator.update(state, *A), *B)
    back = estimator.update(estimator.update(state, *B), *A)
    assert np.abs(estimator.position(forth) - position).max() > 0.1
    assert_same_moments(moments(forth), moments(back), 1e-12)


@pytest.mark.parametrize("name", [*KALMAN, "md2-F-raw-keep-joint", "md3-FW-raw-keep-independent"])
@coupling
def test_one_measurement_is_two_of_twice_the_covariance(name: str, correlated: bool) -> None:
    """Information adds: R^-1 = (2R)^-1 + (2R)^-1."""
    estimator = EVERY[name]
    state = estimator.predict(midway(estimator, 3, correlated), 0.1)
    z = estimator.position(state) + 0.3
    R = covariances(np.random.default_rng(3), (TRACKS,), correlated=correlated)
    once = estimator.update(state, z, R)
    twice = estimator.update(estimator.update(state, z, 2 * R), z, 2 * R)
    assert_same_moments(moments(twice), moments(once), 1e-12)


@pytest.mark.parametrize("name", EVERY)
def test_moving_the_scene_moves_positions_and_nothing_else(name: str) -> None:
    """By 1000 m, velocities, covariances, weights, probabilities, innovations stay."""
    estimator, d = EVERY[name], np.array([1000.0, -2000.0])
    z, R = journey(4, FRAMES, TRACKS), noise(4)
    here, there = (last(estimator, scene, R) for scene in (z, z + d))
    m = estimator.order + 1
    for field, array in contents(here).items():
        moved = contents(there)[field].copy()
        if field == "mean":
            moved[..., ::m] -= d
        elif field == "window":
            # The entries that count: what was never filled is zero in both.
            valid = np.arange(moved.shape[1]) >= moved.shape[1] - here.filled[:, None]
            moved, array = moved[valid] - d, array[valid]
        np.testing.assert_allclose(moved, array, rtol=1e-9, atol=1e-9, err_msg=field)


def rotated(state: Any, G: Array) -> tuple[Array, Array]:
    """Moments of a state turned by G (2, 2): every derivative is a vector."""
    m = state.mean.shape[-1] // 2
    turn = np.kron(G, np.eye(m))
    return state.mean @ turn.T, turn @ state.covariance @ turn.T


def turned(estimator: Any, G: Array, correlated: bool = True) -> tuple[Any, Any]:
    """Last states of a scene, and of the scene and its noise turned by G."""
    z, R = journey(5, FRAMES, TRACKS), noise(5, correlated)
    return last(estimator, z, R), last(estimator, z @ G.T, G @ R @ G.T)


ISOTROPIC = [n for n in MD if n.endswith("joint") and "literal" not in n]


@pytest.mark.parametrize("name", [*KALMAN, *IMM, *ISOTROPIC])
@pytest.mark.parametrize("angle", [0.4, 2.0])
def test_turning_the_scene_turns_the_result(name: str, angle: float) -> None:
    """No direction is special: Kalman, IMM, and MD with joint weights."""
    estimator, G = EVERY[name], rotation(angle)
    before, after = turned(estimator, G)
    assert_same_moments(moments(after), rotated(before, G), 1e-9)
    for field in ("probability", "weight", "nis"):
        if hasattr(before, field):
            np.testing.assert_allclose(getattr(after, field), getattr(before, field), rtol=1e-7)
    if hasattr(before, "weight"):
        assert (before.weight < 1).any()


@pytest.mark.parametrize("order", [2, 3])
@pytest.mark.parametrize("choice", ["independent", "literal"])
def test_what_has_no_direction_of_its_own_depends_on_the_axes(order: int, choice: str) -> None:
    """Weights by axis (the paper) damp an oblique car otherwise than one along an axis: what
    `axes="joint"` is for. And `literal` denoising subtracts H K diag(R), the variances along the
    axes, which do not turn like a vector: the one option that joint weights do not mend."""
    joint = MotionDynamics(order=order, denoise="raw", axes="joint")
    if choice == "literal":
        estimator = replace(joint, denoise="literal")
    else:
        estimator = replace(joint, axes="independent")
    G = rotation(0.4)
    before, after = turned(estimator, G)
    difference = np.abs(estimator.velocity(after) - estimator.velocity(before) @ G.T).max()
    assert difference > 1e-3


@pytest.mark.parametrize("name", EVERY)
def test_exchanging_x_and_y_exchanges_the_result(name: str) -> None:
    """Neither axis comes first: a mirror, under which even axis-wise options hold."""
    estimator = EVERY[name]
    mirror = np.array([[0.0, 1.0], [1.0, 0.0]])
    before, after = turned(estimator, mirror)
    assert_same_moments(moments(after), rotated(before, mirror), 1e-10)
    if isinstance(estimator, MotionDynamics):
        np.testing.assert_allclose(after.weight, before.weight[:, ::-1], atol=1e-9)


def scaled(estimator: Any, c: float) -> Any:
    """The estimator for lengths measured in another unit: x -> c x."""
    change: dict[str, Any] = {
        "process_density": tuple(c * c * q for q in estimator.process_density),
        "start_variance": tuple(c * c * s for s in estimator.start_variance),
    }
    if isinstance(estimator, MotionDynamics):
        change["factors"] = tuple(c * f for f in estimator.motion_factors)
    return replace(estimator, **change)


@pytest.mark.parametrize("name", [n for n in EVERY if "literal" not in n])
@pytest.mark.parametrize("power", [-3, 10])
def test_another_unit_of_length_scales_the_result(name: str, power: int) -> None:
    """Scaled by a power of two, so to the last bit: no length is written into the code."""
    estimator, c = EVERY[name], 2.0**power
    z, R = journey(6, FRAMES, TRACKS), noise(6)
    before, after = last(estimator, z, R), last(scaled(estimator, c), c * z, c * c * R)
    factor = {"mean": c, "covariance": c * c, "innovation": c, "window": c}
    for field, array in contents(before).items():
        assert np.array_equal(
            contents(after)[field], array * factor.get(field, 1), equal_nan=True
        ), field


def test_literal_denoising_depends_on_the_unit_of_length() -> None:
    """Why it is not among the above: it subtracts variances, square metres, from metres."""
    estimator, c = EVERY["md2-F-literal-keep-independent"], 2.0
    z, R = journey(6, FRAMES, TRACKS), noise(6)
    before, after = last(estimator, z, R), last(scaled(estimator, c), c * z, c * c * R)
    assert np.abs(after.weight - before.weight).max() > 1e-3


@pytest.mark.parametrize("name", EVERY)
def test_a_correlation_that_vanishes_changes_nothing(name: str) -> None:
    """The kernels for coupled and for uncoupled axes are one filter."""
    estimator = EVERY[name]
    z, R = journey(7, FRAMES, TRACKS), noise(7, correlated=False)
    nearly = R.copy()
    nearly[..., 0, 1] = nearly[..., 1, 0] = 1e-13 * np.minimum(R[..., 0, 0], R[..., 1, 1])
    apart, together = last(estimator, z, R), last(estimator, z, nearly)
    m = estimator.order + 1
    if name not in IMM:
        assert not apart.covariance[:, :m, m:].any()
        assert together.covariance[:, :m, m:].any()
    assert_same_moments(moments(together), moments(apart), 1e-8)
    for field in ("probability", "weight", "nis", "innovation"):
        if hasattr(apart, field):
            np.testing.assert_allclose(
                getattr(together, field), getattr(apart, field), rtol=1e-8, atol=1e-8
            )


@orders
@coupling
def test_without_process_noise_it_is_least_squares(order: int, correlated: bool) -> None:
    """The posterior is the batch solution by `numpy.linalg.lstsq`: prior and measurements each
    whitened by its own covariance, uneven steps, a gap."""
    rng = np.random.default_rng(8)
    T, m = 25, order + 1
    dt = rng.uniform(0.02, 0.6, T - 1)
    z, R = rng.normal(0, 5, (T, 1, 2)), covariances(rng, (T, 1), correlated=correlated)
    z[12:15] = np.nan
    state = last(Kalman(order=order, process_density=(0.0,) * order), z, R, dt)

    P0 = np.diag(np.tile(START_VARIANCE[:m], 2))
    x0 = np.zeros(2 * m)
    x0[::m] = z[0, 0]
    root = np.linalg.inv(np.linalg.cholesky(P0))
    rows, values = [root], [root @ x0]
    F = np.eye(2 * m)
    for k in range(1, T):
        step = transition(order, dt[k - 1])
        F = block_diag(step, step) @ F
        if not np.isnan(z[k, 0, 0]):
            root = np.linalg.inv(np.linalg.cholesky(R[k, 0]))
            rows.append(root @ F[::m])
            values.append(root @ z[k, 0])
    A = np.vstack(rows)
    x, *_ = np.linalg.lstsq(A, np.concatenate(values))
    P = F @ np.linalg.inv(A.T @ A) @ F.T
    assert_same_moments(moments(state), ((F @ x)[None], P[None]), 1e-9)
