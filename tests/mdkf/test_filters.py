"""Claim: every estimator equals an independent implementation of its equations."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from mdkf import InteractingMultipleModel, Kalman, MotionDynamics
from mdkf.estimator import join, take
from mdkf.imm import ImmState
from mdkf.motion import process_noise, transition
from mdkf.reference import (
    NumpyMotionDynamics,
    UnbiasedImm,
    filterpy_imm,
    filterpy_kalman,
)

DT = 0.1
R = np.diag([0.030874, 0.009379])
STEPS = 1000


def walk(seed: int, steps: int = STEPS) -> Iterator[np.ndarray | None]:
    """Positions of a jerky journey with noise; None in gaps of 1 to 30 frames."""
    rng = np.random.default_rng(seed)
    position, velocity, acceleration = np.zeros(2), rng.normal(0, 8, 2), np.zeros(2)
    gap = 0
    for k in range(steps):
        if k % 50 == 0:
            acceleration = rng.normal(0, 2, 2) if rng.random() < 0.6 else np.zeros(2)
        velocity = np.clip(velocity + acceleration * DT, -15, 15)
        position = position + velocity * DT
        if gap == 0 and rng.random() < 0.05:
            gap = int(rng.integers(1, 31))
        if gap and k:
            gap -= 1
            yield None
        else:
            yield position + rng.normal(0, [0.17, 0.1])


def run(estimator: Any, seed: int) -> Iterator[tuple[Any, np.ndarray | None]]:
    """The states of one track over a walk, after each step."""
    state = None
    for z in walk(seed):
        if state is None:
            state = estimator.start(z[None], R[None])
        else:
            measured = np.full((1, 2), np.nan) if z is None else z[None]
            state = estimator.update(estimator.predict(state, DT), measured, R[None])
        yield state, z


def assert_close(actual: np.ndarray, expected: np.ndarray) -> None:
    """Agreement to 1e-9 of the largest value (a zero among metres carries no relative error)."""
    scale = np.abs(expected).max()
    np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-9 * scale)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_models_are_the_exact_integrals(order: int) -> None:
    """F and Q equal Van Loan's matrix exponential (scipy), for several steps."""
    size = order + 1
    A = np.diag(np.ones(order), 1)
    noise = np.diag([0.0, 0.1, 0.01, 0.001][:size])
    for dt in (0.01, 0.1, 0.7, 3.0):
        block = np.block([[-A, noise], [np.zeros((size, size)), A.T]])
        van_loan = expm(block * dt)
        F = van_loan[size:, size:].T
        np.testing.assert_allclose(transition(order, dt), F, rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(
            process_noise(order, dt), F @ van_loan[:size, size:], rtol=1e-11, atol=1e-14
        )


@pytest.mark.parametrize("order", [1, 2, 3])
def test_kalman_equals_filterpy(order: int) -> None:
    """State and covariance over 1000 steps with gaps, to 1e-9."""
    oracle = None
    for state, z in run(Kalman(order=order), seed=order):
        if oracle is None:
            oracle = filterpy_kalman(z, order, DT)
        else:
            oracle.predict()
            oracle.update(z, R=R)
        assert_close(state.mean[0], oracle.x)
        assert_close(state.covariance[0], oracle.P)


@pytest.mark.parametrize("order", [2, 3])
def test_imm_with_zero_mixing_equals_filterpy(order: int) -> None:
    """Mixture and mode probabilities over 1000 steps; gaps as our CoastingImm corrects them."""
    oracle = None
    estimator = InteractingMultipleModel(order=order, mixing="zero")
    for state, z in run(estimator, seed=10 + order):
        if oracle is None:
            oracle = filterpy_imm(z, order, DT)
            for model in oracle.filters:
                model.R = R
        else:
            oracle.predict()
            oracle.update(z)
        m = order + 1
        assert_close(state.probability[0], oracle.mu)
        assert_close(estimator.position(state)[0], oracle.x[[0, m]])
        assert_close(estimator.velocity(state)[0], oracle.x[[1, m + 1]])
        assert_close(estimator.covariance(state)[0], oracle.P[np.ix_([0, m], [0, m])])


@pytest.mark.parametrize("order", [2, 3])
def test_imm_with_unbiased_mixing_equals_numpy(order: int) -> None:
    """Against states of unequal size, augmented one by one."""
    oracle = None
    estimator = InteractingMultipleModel(order=order, mixing="unbiased")
    for state, z in run(estimator, seed=20 + order):
        if oracle is None:
            oracle = UnbiasedImm(z, order, DT)
        else:
            oracle.predict()
            oracle.update(z, R)
        assert_close(state.probability[0], oracle.mu)
        assert_close(estimator.position(state)[0], oracle.position)
        largest = oracle.models[-1]
        assert_close(state.mean[0, -1], largest.x)
        assert_close(state.covariance[0, -1], largest.P)


def test_filterpys_own_gap_is_not_a_gap() -> None:
    """Why CoastingImm exists: filterpy's update(None) keeps applying the last likelihood."""
    oracle = filterpy_imm(np.zeros(2), 2, DT)
    for model in oracle.filters:
        model.R = R
    for k in range(1, 20):
        oracle.predict()
        oracle.update(np.array([0.05 * k**2, 0.0]))
    before = oracle.mu.copy()
    oracle.predict()
    propagated = oracle.cbar.copy()
    super(type(oracle), oracle).update(None)
    assert np.abs(oracle.mu - propagated).max() > 1e-3
    np.testing.assert_allclose(propagated, before @ oracle.M)


@pytest.mark.parametrize("order", [2, 3])
def test_motion_dynamics_equals_numpy(order: int) -> None:
    """State and weights over 1000 steps with gaps, windows cleared and refilled."""
    oracle = None
    estimator = MotionDynamics(order=order)
    weighted = 0
    for state, z in run(estimator, seed=30 + order):
        if oracle is None:
            oracle = NumpyMotionDynamics(z, order, DT, 10, estimator.motion_factors)
        else:
            oracle.predict()
            oracle.update(z, R)
        assert_close(state.mean[0], oracle.filter.x)
        assert_close(state.covariance[0], oracle.filter.P)
        assert_close(state.weight[0].ravel(), oracle.W.diagonal())
        weighted += bool((state.weight < 1).any())
    assert weighted > 100


def test_motion_dynamics_with_unit_weights_is_constant_acceleration() -> None:
    """With factors so small that W = I, MD equals CA exactly, bit for bit."""
    md = MotionDynamics(factors=(1e-12, 1e-12))
    for (a, _), (b, _) in zip(run(md, seed=4), run(Kalman(order=2), seed=4), strict=True):
        assert np.array_equal(a.mean, b.mean)
        assert np.array_equal(a.covariance, b.covariance)


def test_weights_by_hand() -> None:
    """The paper's equation on a small example.

    Window k = 3, raw positions x = 0, .1, .3, .4 m (the y axis stands still): the last three
    are .1, .3, .4, mean .8/3, squared deviations sum to .14/3, so sigma(z) = sqrt(.07/3).
    Differences .1, .2, .1: mean .4/3, squares sum to .02/3, sigma(dz) = sqrt(.01/3).
    """
    md = MotionDynamics(window=3, denoise="raw", factors=(0.3, 0.2))
    state = md.start(np.array([[0.0, 5.0]]), R[None])
    for x in (0.1, 0.3):
        state = md.update(md.predict(state, DT), np.array([[x, 5.0]]), R[None])
        assert (state.weight == 1).all()
    state = md.update(md.predict(state, DT), np.array([[0.4, 5.0]]), R[None])
    np.testing.assert_allclose(
        state.weight[0, 0], [1, np.sqrt(0.07 / 3) / 0.3, np.sqrt(0.01 / 3) / 0.2], rtol=1e-12
    )
    np.testing.assert_allclose(state.weight[0, 1], [1, 0, 0], atol=1e-15)
    before = state.mean.copy()
    state = md.predict(state, DT)
    W = np.diag(state.weight[0].ravel())
    F = np.kron(np.eye(2), transition(2, DT))
    np.testing.assert_allclose(state.mean[0], F @ W @ before[0], rtol=1e-14)


def test_literal_denoising_is_a_shift() -> None:
    """z^ = z - H K D: the detector's variances through the gain, axis by axis."""
    literal, raw = MotionDynamics(), MotionDynamics(denoise="raw")
    z = np.array([[0.3, -0.2]])
    predicted = literal.predict(literal.start(np.zeros((1, 2)), R[None]), DT)
    shifted, plain = literal.update(predicted, z, R[None]), raw.update(predicted, z, R[None])
    S = literal.covariance(predicted)[0] + R
    HK = literal.covariance(predicted)[0] @ np.linalg.inv(S)
    np.testing.assert_allclose(plain.window[0, -1], z[0])
    np.testing.assert_allclose(shifted.window[0, -1], z[0] - HK @ np.diag(R), rtol=1e-12)


@pytest.mark.parametrize("after_gap", ["reset", "keep"])
def test_a_gap_keeps_the_weights_and_reset_clears_the_window(after_gap: str) -> None:
    """In the gap W stays; the first measurement after it resets the window, or does not."""
    md = MotionDynamics(after_gap=after_gap)  # type: ignore[arg-type]
    state = md.start(np.zeros((1, 2)), R[None])
    for _ in range(15):
        state = md.update(md.predict(state, DT), np.full((1, 2), 0.01), R[None])
    held = state.weight.copy()
    assert (held[:, :, 1:] < 1).all()
    for _ in range(7):
        state = md.update(md.predict(state, DT), np.full((1, 2), np.nan), R[None])
        assert np.array_equal(state.weight, held)
    state = md.update(md.predict(state, DT), np.full((1, 2), 0.01), R[None])
    if after_gap == "reset":
        assert state.count[0] == 1
        assert (state.weight == 1).all()
    else:
        assert state.count[0] == state.window.shape[1]
        assert (state.weight[:, :, 1:] < 1).all()


ALL = [
    Kalman(order=1),
    Kalman(order=2),
    InteractingMultipleModel(),
    InteractingMultipleModel(mixing="zero"),
    MotionDynamics(),
    MotionDynamics(order=3, covariance_by="FW", denoise="innovation", axes="joint"),
]


@pytest.mark.parametrize("estimator", ALL, ids=repr)
def test_a_track_does_not_depend_on_its_neighbours(estimator: Any) -> None:
    """Batched, alone, taken out or joined: the same bits."""
    rng = np.random.default_rng(5)
    z = rng.normal(0, 1, (40, 6, 2)).cumsum(axis=0)
    z[rng.random((40, 6)) < 0.2] = np.nan
    z[0] = 0.0
    noise = np.broadcast_to(R, (6, 2, 2))
    batch = estimator.start(z[0], noise)
    alone = [estimator.start(z[0, [k]], noise[:1]) for k in range(6)]
    for k in range(1, 40):
        batch = estimator.update(estimator.predict(batch, DT), z[k], noise)
        alone = [
            estimator.update(estimator.predict(one, DT), z[k, [i]], noise[:1])
            for i, one in enumerate(alone)
        ]
    joined = join(join(take(batch, np.arange(2)), alone[2]), take(batch, np.arange(3, 6)))
    for states in (joined, join(alone[0], take(batch, np.arange(1, 6)))):
        assert np.array_equal(estimator.position(states), estimator.position(batch))
        assert np.array_equal(estimator.covariance(states), estimator.covariance(batch))


@pytest.mark.parametrize("estimator", ALL, ids=repr)
def test_bad_measurements_are_refused_and_leave_the_state(estimator: Any) -> None:
    """Infinite positions, half a NaN, wrong shapes, bad noise, dt <= 0: errors that say what."""
    state = estimator.start(np.zeros((2, 2)), np.tile(R, (2, 1, 1)))
    before = estimator.position(state).copy()
    good, noise = np.zeros((2, 2)), np.tile(R, (2, 1, 1))
    for z, r, message in (
        (np.array([[0.0, np.inf], [0, 0]]), noise, "measurement 0"),
        (np.array([[0.0, 0], [np.nan, 0]]), noise, "measurement 1"),
        (np.zeros((3, 2)), noise, "shapes"),
        (good, -noise, "noise 0"),
    ):
        with pytest.raises(ValueError, match=message):
            estimator.update(state, z, r)
    for dt in (0.0, -1.0, np.nan):
        with pytest.raises(ValueError, match="dt is"):
            estimator.predict(state, dt)
    assert np.array_equal(estimator.position(state), before)


def test_a_huge_jump_gives_no_nan() -> None:
    """Ten kilometres in one frame underflow every likelihood; the probabilities stay sane."""
    imm = InteractingMultipleModel()
    state = imm.start(np.zeros((1, 2)), R[None])
    state = imm.update(imm.predict(state, DT), np.full((1, 2), 1e4), R[None])
    assert isinstance(state, ImmState)
    assert np.isfinite(imm.position(state)).all()
    np.testing.assert_allclose(state.probability.sum(), 1.0)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Kalman(order=4), "order is 4"),
        (lambda: InteractingMultipleModel(mixing="both"), "mixing is 'both'"),  # type: ignore
        (lambda: InteractingMultipleModel(stay=1.0), "stay is 1.0"),
        (lambda: MotionDynamics(window=1), "window is 1"),
        (lambda: MotionDynamics(factors=(0.1,)), "factors are"),
        (lambda: MotionDynamics(denoise="all"), "denoise is 'all'"),  # type: ignore
    ],
)
def test_bad_options_are_named(build: Any, message: str) -> None:
    """An option that does not exist is refused when the estimator is built."""
    with pytest.raises(ValueError, match=message):
        build()
