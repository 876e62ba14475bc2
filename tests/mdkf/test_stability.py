"""Claim: a million steps of the wildest input leave every number finite, exact and in its range.

Cars a thousand kilometres from the origin that jump by 1 km in every hundredth frame, go unseen
for up to 30 frames, and whose detections have variances from 1e-6 to 1e6 m2, half of them
correlated between x and y.
"""

from collections.abc import Iterator
from dataclasses import replace
from decimal import Decimal, localcontext
from fractions import Fraction
from functools import cache
from itertools import pairwise
from statistics import stdev
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from mdkf import Estimates, Kalman, MotionDynamics, filter_sequence
from mdkf.batch import filter_all
from mdkf.estimator import arrays
from mdkf.motion import process_noise, transition
from tests.mdkf.scenes import BUILT_IN, DT, EVERY, Array, covariances, states

ESTIMATORS = {**BUILT_IN, "md3-fw-joint": EVERY["md3-FW-posterior-reset-joint"]}
every = pytest.mark.parametrize("name", ESTIMATORS)
IMM_NAMES = [name for name in ESTIMATORS if name.startswith("imm")]

LONGEST_GAP = 30


@cache
def wild(seed: int, frames: int, tracks: int) -> tuple[Array, Array]:
    """Measured positions (T, n, 2) [m], NaN in gaps, and their covariances (T, n, 2, 2) [m2]."""
    rng = np.random.default_rng(seed)
    jump = rng.choice([-1000.0, 1000.0], (frames, tracks, 2))
    jump *= rng.random((frames, tracks, 1)) < 1e-2
    z = 1e6 + np.cumsum(jump + rng.normal(0, 1, jump.shape), axis=0)
    for track in range(tracks):
        for start in rng.integers(1, frames, frames // 60):
            z[start : start + rng.integers(1, LONGEST_GAP + 1), track] = np.nan
    R = covariances(rng, (frames, tracks), 1e-6, 1e6)
    R[rng.random((frames, tracks)) < 0.5] *= np.eye(2)
    z.flags.writeable = R.flags.writeable = False
    return z, R


def assert_positive(P: Array) -> None:
    """Covariances (.., d, d) symmetric to the bit and positive definite: the smallest eigenvalue
    of the correlations, which no unit and no large variance can hide."""
    assert np.isfinite(P).all()
    assert np.array_equal(P, np.swapaxes(P, -1, -2))
    variance = np.diagonal(P, axis1=-2, axis2=-1)
    assert (variance > 0).all()
    deviation = np.sqrt(variance)
    correlation = P / deviation[..., :, None] / deviation[..., None, :]
    if P.shape[-1] == 2:
        assert (np.abs(correlation[..., 0, 1]) < 1).all()
    else:
        assert (np.linalg.eigvalsh(correlation) > 0).all()


def assert_sound(estimator: Any, state: Any) -> None:
    """All that a whole state promises."""
    assert np.isfinite(state.mean).all()
    if hasattr(state, "probability"):
        m = estimator.order + 1
        for j in range(estimator.order):
            known = np.flatnonzero(np.tile(np.arange(m) <= j + 1, 2))
            assert_positive(state.covariance[:, j][:, known][:, :, known])
            unknown = np.setdiff1d(np.arange(2 * m), known)
            assert not state.covariance[:, j, unknown].any()
            assert not state.mean[:, j, unknown].any()
        assert ((state.probability >= 0) & (state.probability <= 1)).all()
        np.testing.assert_allclose(state.probability.sum(axis=1), 1.0, rtol=1e-15 * 8)
    else:
        assert_positive(state.covariance)
    if hasattr(state, "weight"):
        assert ((state.weight >= 0) & (state.weight <= 1)).all()
        assert np.isfinite(state.window).all()
    measured = ~np.isnan(state.nis)
    assert np.array_equal(measured, np.isfinite(state.innovation).all(axis=1))
    assert (state.nis[measured] >= 0).all()
    assert np.isfinite(state.nis[measured]).all()


@every
def test_a_million_steps_of_many_tracks(name: str) -> None:
    """100 tracks of 10 000 frames: estimates of every frame, every hundredth whole state, after
    its prediction and after its update."""
    estimator = ESTIMATORS[name]
    z, R = wild(0, 10_000, 100)
    for t, state in enumerate(states(estimator, z, R)):
        assert_positive(estimator.covariance(state))
        if t % 100 == 0:
            assert np.isfinite(estimator.velocity(state)).all()
            assert_sound(estimator, state)
            assert_sound(estimator, estimator.predict(state, DT))


@every
def test_a_million_steps_of_one_track(name: str) -> None:
    """Estimates of every frame."""
    estimator = ESTIMATORS[name]
    z, R = wild(1, 1_000_000, 1)
    estimates = filter_sequence(estimator, z, R, DT)
    for array in (estimates.position, estimates.velocity):
        assert np.isfinite(array).all()
    assert_positive(estimates.covariance)
    if name not in IMM_NAMES:
        # No measurement leaves more doubt than it has itself: (P^-1 + R^-1)^-1 <= R. An IMM's
        # mixture may, while its models disagree.
        measured = ~np.isnan(z[1:, 0, 0])
        left = np.diagonal(estimates.covariance[1:, 0], axis1=1, axis2=2)[measured]
        given = np.diagonal(R[1:, 0], axis1=1, axis2=2)[measured]
        assert (left <= given * (1 + 1e-9)).all()


@pytest.mark.parametrize("name", IMM_NAMES)
def test_two_far_measurements_at_once_leave_probabilities(name: str) -> None:
    """A model that the first rules out may be the nearest to the second; no gap is between them
    in which the Markov matrix would revive it."""
    imm = ESTIMATORS[name]
    noise = np.tile(np.eye(2), (3, 1, 1))
    state = imm.predict(imm.start(np.zeros((3, 2)), noise), 3.0)
    jump = np.array([[1e4, 0.0], [1e5, 0.0], [0.0, -1e6]])
    state = imm.update(state, jump, noise)
    for j in range(imm.order):
        place = np.ascontiguousarray(state.mean[:, j, :: imm.order + 1])
        assert_sound(imm, imm.update(state, place, 1e-4 * noise))


def exact_deviations(history: list[Array], k: int, order: int, joint: bool) -> Array:
    """sigma(z), sigma(dz), (sigma(d2z)) by axis, (order, 2) [m], in rational arithmetic."""
    found = np.zeros((order, 2))
    for axis in range(2):
        values = [Fraction(float(position[axis])) for position in history]
        for d in range(order):
            found[d, axis] = stdev(values[-k:])
            values = [b - a for a, b in pairwise(values)]
    return np.repeat(np.hypot(*found.T)[:, None], 2, axis=1) if joint else found


@pytest.mark.parametrize("axes", ["independent", "joint"])
@pytest.mark.parametrize("after_gap", ["reset", "keep"])
@pytest.mark.parametrize("order", [2, 3])
def test_window_deviations_are_exact_after_a_million_steps(
    order: int, after_gap: Any, axes: Any
) -> None:
    """Within 1e-6 m of the raw positions' exact ones, first and last, in every frame.

    The factors are so large that no weight reaches 1: weight times factor is the deviation.
    """
    k, factor, last = 10, 1e6, 300
    md = MotionDynamics(order, k, (factor,) * order, denoise="raw", after_gap=after_gap, axes=axes)
    z, R = wild(2, 1_000_000, 1)
    n = len(z) - last
    zero = np.empty((0, 1, 2, 2))
    out = Estimates(np.empty((n, 1, 2)), np.empty((n, 1, 2)), np.empty((n, 1, 2, 2)), zero)
    late = md.start(z[0], R[0])
    filter_all(md.batch(late, DT), z[:n], R[:n], *arrays(out))
    # The history that the window holds at frame n: since the last gap, or all.
    seen = ~np.isnan(z[:n, 0, 0])
    start = int(np.flatnonzero(~seen)[-1]) + 1 if after_gap == "reset" else n - 2000
    run(md, md.start(z[0], R[0]), z[1:last], R[1:last], [z[0, 0]], k)
    run(md, late, z[n:], R[n:], list(z[start:n, 0][seen[start:]]), k)


def run(md: MotionDynamics, state: Any, z: Array, R: Array, history: list[Array], k: int) -> None:
    """Compare the deviations in every frame in which they are formed anew."""
    compared, missed = 0, bool(state.missed[0])
    for measured, noise in zip(z, R, strict=True):
        state = md.update(md.predict(state, DT), measured, noise)
        if np.isnan(measured[0, 0]):
            missed = True
            continue
        if missed and md.after_gap == "reset":
            history = []
        missed = False
        history.append(measured[0])
        if len(history) >= k + md.order - 1:
            came = state.weight[0, :, 1:].T * md.motion_factors[0]
            wanted = exact_deviations(history[-k - 3 :], k, md.order, md.axes == "joint")
            np.testing.assert_allclose(came, wanted, rtol=0, atol=1e-6)
            compared += 1
        else:
            assert (state.weight == 1).all()
    assert compared > 100


Matrix = npt.NDArray[np.object_]


def literal_joseph(order: int, start: tuple[float, ...], R: Array, dt: Array) -> Iterator[Matrix]:
    """Covariances after each update, by the textbook's matrices in decimal arithmetic."""
    m = order + 1
    decimal = np.vectorize(lambda value: Decimal(float(value)), otypes=[object])
    P, identity = (decimal(np.diag(v)) for v in (np.tile(start[:m], 2), np.ones(2 * m)))
    H = identity[::m]
    for noise, step in zip(R, dt, strict=True):
        both = np.eye(2)
        F = decimal(np.kron(both, transition(order, step)))
        Q = decimal(np.kron(both, process_noise(order, step)))
        prior = F @ P @ F.T + Q
        S = H @ prior @ H.T + decimal(noise)
        inverse = np.array([[S[1, 1], -S[0, 1]], [-S[1, 0], S[0, 0]]])
        K = prior @ H.T @ (inverse / (S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0]))
        A = identity - K @ H
        P = A @ prior @ A.T + K @ decimal(noise) @ K.T
        yield P


@pytest.mark.parametrize("correlation", [0.0, 0.9, 0.999999])
@pytest.mark.parametrize("order", [1, 2, 3])
def test_covariance_is_as_accurate_as_josephs_form(order: int, correlation: float) -> None:
    """R in turn 1e-6 and 1e6 m2, P from 1e6, against 60 digits, after every update.

    Each sharp update shrinks a variance by up to 1e12, so that P - K H P loses twelve digits: on
    this input it is wrong by 2e-4 of the deviations. The textbook's Joseph form in doubles is
    wrong by up to 6.3e-9, whatever the correlation; the kernels must keep to three times that.
    """
    frames = 60
    start = (1e6, 1e6, 1e4, 1e4)
    rng = np.random.default_rng(order)
    size = np.where(np.arange(frames) % 2, 1e6, 1e-6) * rng.uniform(0.5, 1, frames)
    R = size[:, None, None] * np.array([[1, correlation], [correlation, 1]])
    dt = rng.uniform(0.05, 1.0, frames)
    with localcontext() as context:
        context.prec = 60
        exact = [P.astype(float) for P in literal_joseph(order, start, R, dt)]
    z, noise = np.zeros((frames + 1, 1, 2)), np.concatenate([R[:1], R])[:, None]
    kalman = replace(Kalman(order=order), start_variance=start)
    _, *came = (state.covariance[0] for state in states(kalman, z, noise, dt))
    assert len(came) == len(exact)
    for k, (P, wanted) in enumerate(zip(came, exact, strict=True)):
        deviation = np.sqrt(wanted.diagonal())
        error = np.abs(P - wanted) / np.outer(deviation, deviation)
        assert error.max() < 2e-8, f"update {k}"
