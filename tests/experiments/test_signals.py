"""Claim: signals are what the filters believe, and separations and delays are what they are by
definition: areas under the curve, and the steps that fit best."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.stats import mannwhitneyu

from experiments.studies.signals import onset, release, separation, signals
from mdkf import Estimator, MotionDynamics, estimator
from mdkf.reference import filterpy_imm, filterpy_kalman
from mdkf.tables import FloatArray

R = np.diag([0.02, 0.01])


def track(seed: int, frames: int = 40) -> FloatArray:
    """Measured positions (frames, 2) of a car that speeds up at an angle."""
    random = np.random.default_rng(seed)
    time = 0.1 * np.arange(frames)
    along = 3.0 * time + 0.8 * time**2
    return np.outer(along, [0.8, -0.6]) + random.normal(0.0, 0.1, (frames, 2))


def told(model: Estimator, z: FloatArray) -> dict[str, FloatArray]:
    """The signals of one track after all its measurements."""
    state = model.start(z[:1], R[None])
    for k in range(1, len(z)):
        state = model.update(model.predict(state, 0.1), z[k : k + 1], R[None])
    return signals(model, state)


@pytest.mark.parametrize("name", ["cv", "ca", "cj"])
def test_speed_and_acceleration_are_filterpys(name: str) -> None:
    """The norms of the estimated derivatives; CV has no acceleration to tell of."""
    order = ("cv", "ca", "cj").index(name) + 1
    z = track(order)
    oracle = filterpy_kalman(z[0], order, 0.1)
    for one in z[1:]:
        oracle.predict()
        oracle.update(one, R=R)
    x, y = oracle.x.reshape(2, -1)
    found = told(estimator(name), z)
    assert found["speed"] == pytest.approx([np.hypot(x[1], y[1])], rel=1e-9)
    assert list(found) == (["speed"] if order == 1 else ["speed", "acceleration"])
    if order > 1:
        assert found["acceleration"] == pytest.approx([np.hypot(x[2], y[2])], rel=1e-9)


@pytest.mark.parametrize("order", [2, 3])
def test_imms_signals_are_filterpys(order: int) -> None:
    """Probability of all models but the first, and the derivatives of the mixture."""
    z = track(7)
    oracle = filterpy_imm(z[0], order, 0.1)
    for model in oracle.filters:
        model.R = R
    for one in z[1:]:
        oracle.predict()
        oracle.update(one)
    x, y = np.asarray(oracle.x).reshape(2, -1)
    found = told(estimator("imm-zero" if order == 2 else "imm3-zero"), z)
    assert found["not cv"] == pytest.approx([1.0 - oracle.mu[0]], abs=1e-8)
    assert found["speed"] == pytest.approx([np.hypot(x[1], y[1])], rel=1e-7)
    assert found["acceleration"] == pytest.approx([np.hypot(x[2], y[2])], rel=1e-7)


@pytest.mark.parametrize("order", [2, 3])
def test_mds_signals_are_the_larger_weights(order: int) -> None:
    """Standard deviations of the last ten positions, first and second differences over the
    factors, at most 1, of the axis that has more."""
    factors = (3.0, 0.5, 0.4)[:order]
    z = track(3)
    found = told(MotionDynamics(order=order, denoise="raw", factors=factors), z)
    for d, (name, factor) in enumerate(zip(("w_v", "w_a", "w_j")[:order], factors, strict=True)):
        deviation = np.diff(z, d, axis=0)[-10:].std(axis=0, ddof=1)
        assert found[name] == pytest.approx([min(deviation.max() / factor, 1.0)], rel=1e-9)
        assert found[name] < 1.0
    assert ("w_j" in found) == (order == 3)


@pytest.mark.parametrize("draw", [np.random.Generator.normal, np.random.Generator.integers])
def test_separation_is_mann_whitneys_u(draw: Callable[..., FloatArray]) -> None:
    """Per pair, with and without ties, for each row of values on its own."""
    random = np.random.default_rng(5)
    values, null = draw(random, 1, 6, (3, 40)) + 0.0, draw(random, 0, 5, 70) + 0.0
    expected = [mannwhitneyu(row, null).statistic / (40 * 70) for row in values]
    np.testing.assert_allclose(separation(values, null), expected, rtol=1e-12)


def test_separation_of_the_obvious() -> None:
    """Always larger, never, always equal, as often as not; and nothing to compare."""
    null = np.array([1.0, 2.0])
    rows = np.array([[3.0, 4.0], [0.0, -1.0], [1.0, 2.0], [1.5, 1.5]])
    np.testing.assert_array_equal(separation(rows, null), [1.0, 0.0, 0.5, 0.5])
    assert np.isnan(separation(np.empty(0), null))
    assert np.isnan(separation(null, np.empty(0)))


@pytest.mark.parametrize("frames", [0, 1, 7, 19])
def test_the_delay_of_a_step_is_its_place(frames: int) -> None:
    """From chance to certain, and from certain to chance."""
    step = np.where(np.arange(20) < frames, 0.5, 1.0)
    assert onset(step) == frames
    assert release(np.ones(5), 1.5 - step) == frames


def test_the_delay_of_a_slow_rise_is_half_way() -> None:
    """The first frame that is nearer to certain than to chance."""
    curve = np.linspace(0.5, 1.0, 30)
    assert onset(curve) == np.argmax(curve > 0.75)
    assert release(np.ones(5), curve[::-1]) == np.argmax(curve[::-1] < 0.75)


def test_a_single_stray_frame_is_no_response() -> None:
    """Neither before the step nor after it."""
    curve = np.where(np.arange(40) < 20, 0.5, 1.0)
    curve[[4, 30]] = 1.0, 0.5
    assert onset(curve) == 20


def test_no_response_has_no_delay() -> None:
    """At chance throughout; never back at chance; and at chance before there was anything."""
    chance, certain = np.full(20, 0.5), np.ones(20)
    assert np.isnan(onset(chance))
    assert np.isnan(release(np.ones(5), certain))
    assert np.isnan(release(np.full(5, 0.6), chance))


def test_a_response_that_does_not_last_is_none() -> None:
    """A rise in the last frames counts from as many on as are asked for; a fall likewise."""
    late = np.where(np.arange(40) < 36, 0.5, 1.0)
    assert onset(late, held=4) == 36
    assert np.isnan(onset(late, held=9))
    assert onset(np.where(np.arange(40) < 30, 0.5, 1.0), held=10) == 30
    assert release(np.ones(5), 1.5 - late, held=4) == 36
    assert np.isnan(release(np.ones(5), 1.5 - late, held=9))
