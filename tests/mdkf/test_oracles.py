"""Claim: every estimator, with every option, equals an independent implementation to 1e-9.

Over 1000 random steps with gaps, each time other models, noise (the same for all detections, per
detection, or correlated between x and y) and times between frames. The oracles are filterpy, or
plain numpy where filterpy has no such filter (`mdkf.reference`).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from mdkf import InteractingMultipleModel, Kalman, MotionDynamics
from mdkf.motion import process_noise, transition
from mdkf.reference import (
    NumpyMotionDynamics,
    UnbiasedImm,
    filterpy_imm,
    filterpy_kalman,
    set_step,
)

STEPS = 1000
AGREEMENT = 1e-9

orders = st.sampled_from([2, 3])
densities = st.tuples(*[st.floats(1e-4, 3.0)] * 3)
# Where a filter is 100 standard deviations off, the likelihoods' ratio exp(-1e4) has no digits
# left to compare: the banks get models that the journeys can have come from.
bank_densities = st.tuples(*[st.floats(0.1, 3.0)] * 3)
start_variances = st.tuples(st.floats(0.1, 10.0), *[st.floats(0.5, 100.0)] * 3)
seeds = st.integers(0, 2**32 - 1)
few = settings(
    derandomize=True,
    max_examples=12,
    deadline=None,
    suppress_health_check=list(HealthCheck),
    phases=[Phase.explicit, Phase.generate],
)


@dataclass(frozen=True)
class Journey:
    """Frames of a jerky journey: z (T, 2) with NaN in gaps, R (T, 2, 2), dt (T,) before each."""

    z: np.ndarray
    R: np.ndarray
    dt: np.ndarray

    def __iter__(self) -> Iterator[tuple[np.ndarray | None, np.ndarray, float]]:
        for z, R, dt in zip(self.z, self.R, self.dt, strict=True):
            yield None if np.isnan(z[0]) else z, R, float(dt)


@st.composite
def journeys(draw: st.DrawFn) -> Journey:
    """Accelerations that change every 50 frames, gaps of 1 to 30 frames."""
    rng = np.random.default_rng(draw(seeds))
    noise, even = draw(st.sampled_from(["same", "each", "correlated"])), draw(st.booleans())
    dt = np.full(STEPS, 0.1) if even else rng.uniform(0.02, 0.3, STEPS)
    acceleration = np.repeat(rng.normal(0, 1.5, (STEPS // 50, 2)), 50, axis=0)
    acceleration[rng.random(STEPS) < 0.3] = 0.0
    velocity = np.clip(np.cumsum(acceleration * dt[:, None], axis=0), -15, 15)
    position = np.cumsum(velocity * dt[:, None], axis=0) + rng.normal(0, 50, 2)
    sigma = np.full((STEPS, 2), [0.18, 0.1])
    if noise != "same":
        sigma = rng.uniform(0.05, 0.5, (STEPS, 2))
    R = np.einsum("ta,ab,tb->tab", sigma, np.eye(2), sigma)
    if noise == "correlated":
        R[:, 0, 1] = R[:, 1, 0] = rng.uniform(-0.9, 0.9, STEPS) * sigma.prod(axis=1)
    z = position + np.einsum("tab,tb->ta", np.linalg.cholesky(R), rng.normal(size=(STEPS, 2)))
    for start in np.flatnonzero(rng.random(STEPS) < draw(st.sampled_from([0.0, 0.03]))):
        z[max(start, 1) : start + rng.integers(1, 31)] = np.nan
    return Journey(z, R, dt)


def compare(
    estimator: Any,
    journey: Journey,
    make: Callable[[np.ndarray], Any],
    step: Callable[[Any, np.ndarray | None, np.ndarray, float], None],
    views: Callable[[Any, Any], list[tuple[np.ndarray, np.ndarray]]],
    follow: Callable[[Any, Any], None] | None = None,
) -> None:
    """Run both and compare what `views` shows of them after every step.

    follow(oracle, state) sets the oracle to our state before each step, so that each step is
    compared by itself.

    Each number is held to 1e-9 of the largest value that it takes on the journey: a velocity
    that passes through zero carries no relative error.
    """
    state = oracle = None
    shown: list[list[tuple[np.ndarray, np.ndarray]]] = []
    for z, R, dt in journey:
        if state is None:
            assert z is not None
            state, oracle = estimator.start(z[None], R[None]), make(z)
        else:
            measured = np.full((1, 2), np.nan) if z is None else z[None]
            if follow is not None:
                follow(oracle, state)
            state = estimator.update(estimator.predict(state, dt), measured, R[None])
            step(oracle, z, R, dt)
        shown.append([(np.array(a), np.array(b)) for a, b in views(state, oracle)])
    for pairs in zip(*shown, strict=True):
        ours, theirs = (np.array(values) for values in zip(*pairs, strict=True))
        error = np.abs(ours - theirs).max(axis=0)
        assert (error <= AGREEMENT * np.abs(theirs).max(axis=0)).all(), error.max()


@pytest.mark.parametrize("order", [1, 2, 3])
def test_models_are_the_exact_integrals(order: int) -> None:
    """F and Q equal Van Loan's matrix exponential (scipy), for steps of 1 ms to 3 s."""
    size = order + 1
    A = np.diag(np.ones(order), 1)
    noise = np.diag([0.0, 0.1, 0.01, 0.001][:size])
    for dt in (0.001, 0.01, 0.1, 0.7, 3.0):
        block = np.block([[-A, noise], [np.zeros((size, size)), A.T]])
        van_loan = expm(block * dt)
        F = van_loan[size:, size:].T
        np.testing.assert_allclose(transition(order, dt), F, rtol=1e-12, atol=1e-18)
        Q = F @ van_loan[:size, size:]
        np.testing.assert_allclose(process_noise(order, dt), Q, rtol=1e-9, atol=1e-18)


@pytest.mark.parametrize("order", [1, 2, 3])
@few
@given(journeys(), densities, start_variances)
def test_kalman_equals_filterpy(
    order: int, journey: Journey, density: tuple[float, ...], start: tuple[float, ...]
) -> None:
    """Mean, covariance, innovation."""

    def step(oracle: Any, z: np.ndarray | None, R: np.ndarray, dt: float) -> None:
        set_step(oracle, order, dt, density)
        oracle.predict()
        oracle.update(z, R=R)

    def views(state: Any, oracle: Any) -> list[tuple[np.ndarray, np.ndarray]]:
        measured = not np.isnan(state.innovation[0, 0])
        innovation = (state.innovation[0], np.ravel(oracle.y)) if measured else (0.0, 0.0)
        return [
            (state.mean[0], oracle.x),
            (state.covariance[0], oracle.P),
            tuple(np.broadcast_to(v, 2) for v in innovation),  # type: ignore[list-item]
        ]

    estimator = Kalman(order, density, start)
    compare(
        estimator,
        journey,
        lambda z: filterpy_kalman(z, order, 0.1, density, start),
        step,
        views,
    )


@pytest.mark.parametrize("order", [2, 3])
@few
@given(journeys(), st.floats(0.6, 0.99), bank_densities, start_variances)
def test_imm_with_zero_mixing_equals_filterpy(
    order: int, journey: Journey, stay: float, density: tuple[float, ...], start: tuple[float, ...]
) -> None:
    """Mixture and mode probabilities; gaps as our CoastingImm corrects them."""

    def step(oracle: Any, z: np.ndarray | None, R: np.ndarray, dt: float) -> None:
        for j, model in enumerate(oracle.filters):
            set_step(model, j + 1, dt, density)
            model.R = R
        oracle.predict()
        oracle.update(z)

    m = order + 1
    positions = np.ix_([0, m], [0, m])
    estimator = InteractingMultipleModel(order, "zero", stay, density, start)
    compare(
        estimator,
        journey,
        lambda z: filterpy_imm(z, order, 0.1, stay, density, start),
        step,
        lambda state, oracle: [
            (state.probability[0], oracle.mu),
            (estimator.position(state)[0], oracle.x[[0, m]]),
            (estimator.velocity(state)[0], oracle.x[[1, m + 1]]),
            (estimator.covariance(state)[0], oracle.P[positions]),
            (state.mean[0], np.array([model.x for model in oracle.filters])),
            (state.covariance[0], np.array([model.P for model in oracle.filters])),
        ],
    )


@pytest.mark.parametrize("order", [2, 3])
@few
@given(journeys(), st.floats(0.6, 0.99), bank_densities, start_variances)
def test_imm_with_unbiased_mixing_equals_numpy(
    order: int, journey: Journey, stay: float, density: tuple[float, ...], start: tuple[float, ...]
) -> None:
    """Against states of unequal size, augmented one by one."""

    def step(oracle: Any, z: np.ndarray | None, R: np.ndarray, dt: float) -> None:
        for j, model in enumerate(oracle.models):
            set_step(model, j + 1, dt, density)
        oracle.predict()
        oracle.update(z, R)

    def views(state: Any, oracle: Any) -> list[tuple[np.ndarray, np.ndarray]]:
        shown = [
            (state.probability[0], oracle.mu),
            (estimator.position(state)[0], oracle.position),
        ]
        for j, model in enumerate(oracle.models):
            used = np.flatnonzero(np.tile(np.arange(order + 1) < j + 2, 2))
            shown.append((state.mean[0, j, used], model.x))
            shown.append((state.covariance[0, j][np.ix_(used, used)], model.P))
        return shown

    estimator = InteractingMultipleModel(order, "unbiased", stay, density, start)
    compare(
        estimator,
        journey,
        lambda z: UnbiasedImm(z, order, 0.1, stay, density, start),
        step,
        views,
    )


@settings(few, max_examples=40)
@given(
    journeys(),
    orders,
    st.integers(2, 30),
    st.tuples(*[st.floats(0.02, 2.0)] * 3),
    st.fixed_dictionaries(
        {
            "covariance_by": st.sampled_from(["F", "FW"]),
            "denoise": st.sampled_from(["literal", "innovation", "posterior", "raw"]),
            "after_gap": st.sampled_from(["reset", "keep"]),
            "axes": st.sampled_from(["independent", "joint"]),
        }
    ),
    densities,
    start_variances,
)
def test_motion_dynamics_equals_numpy(
    journey: Journey,
    order: int,
    k: int,
    factors: tuple[float, ...],
    options: dict[str, Any],
    density: tuple[float, ...],
    start: tuple[float, ...],
) -> None:
    """State and weights, for every combination of the options.

    Where the weights feed back into the positions that they are formed from, the loop can be
    chaotic (most of all with k = 2) and no two roundings stay together for 1000 steps: there each
    step is compared by itself.
    """
    feedback = options["denoise"] in ("innovation", "posterior") or options["covariance_by"] == "FW"

    def follow(oracle: Any, state: Any) -> None:
        oracle.filter.x, oracle.filter.P = state.mean[0], state.covariance[0]
        oracle.W = np.diag(state.weight[0].ravel())
        oracle.positions = list(state.window[0, state.window.shape[1] - state.filled[0] :])

    def step(oracle: Any, z: np.ndarray | None, R: np.ndarray, dt: float) -> None:
        set_step(oracle.filter, order, dt, density)
        oracle.predict()
        oracle.update(z, R)

    estimator = MotionDynamics(
        order=order,
        window=k,
        factors=factors[:order],
        process_density=density,
        start_variance=start,
        **options,
    )
    compare(
        estimator,
        journey,
        lambda z: NumpyMotionDynamics(
            z,
            order,
            0.1,
            k,
            factors[:order],
            **options,
            density=density,
            start_variance=start,
        ),
        step,
        lambda state, oracle: [
            (state.mean[0], oracle.filter.x),
            (state.covariance[0], oracle.filter.P),
            (state.weight[0].ravel(), oracle.W.diagonal()),
        ],
        follow if feedback else None,
    )


def test_filterpys_own_gap_is_not_a_gap() -> None:
    """Why CoastingImm exists: filterpy's update(None) keeps applying the last likelihood."""
    oracle = filterpy_imm(np.zeros(2), 2, 0.1)
    for model in oracle.filters:
        model.R = np.diag([0.03, 0.01])
    for k in range(1, 20):
        oracle.predict()
        oracle.update(np.array([0.05 * k**2, 0.0]))
    before = oracle.mu.copy()
    oracle.predict()
    propagated = oracle.cbar.copy()
    super(type(oracle), oracle).update(None)
    assert np.abs(oracle.mu - propagated).max() > 1e-3
    np.testing.assert_allclose(propagated, before @ oracle.M)
