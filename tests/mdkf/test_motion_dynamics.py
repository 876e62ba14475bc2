"""Claim: MD's weights are the paper's, and each option changes exactly what it says."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mdkf import Kalman, MotionDynamics
from mdkf.motion import transition
from mdkf.motion_dynamics import MotionDynamicsState

DT = 0.1
R = np.diag([0.030874, 0.009379])
OPTIONS = {
    "covariance_by": ("F", "FW"),
    "denoise": ("literal", "innovation", "posterior", "raw"),
    "after_gap": ("reset", "keep"),
    "axes": ("independent", "joint"),
}


def measurements(steps: int = 60, gap: slice | None = None) -> np.ndarray:
    """Positions (steps, 2) of a car that sets off, with noise; NaN in the gap."""
    t = DT * np.arange(steps)
    z = np.stack([0.8 * np.maximum(t - 4, 0) ** 2, 0.3 * np.maximum(t - 4, 0) ** 2], axis=1)
    z += np.random.default_rng(6).normal(0, 0.05, z.shape)
    if gap is not None:
        z[gap] = np.nan
    return z


def states(md: MotionDynamics, z: np.ndarray) -> list[MotionDynamicsState]:
    """The state of one track after each frame."""
    state = md.start(z[:1], R[None])
    shown = [state]
    for row in z[1:]:
        state = md.update(md.predict(state, DT), row[None], R[None])
        shown.append(state)
    return shown


def test_weights_by_hand() -> None:
    """The paper's equation on a small example.

    Window k = 3, raw positions x = 0, .1, .3, .4 m (the y axis stands still): the last three
    are .1, .3, .4, mean .8/3, squared deviations sum to .14/3, so sigma(z) = sqrt(.07/3).
    Differences .1, .2, .1: mean .4/3, squares sum to .02/3, sigma(dz) = sqrt(.01/3).
    """
    md = MotionDynamics(window=3, denoise="raw", factors=(0.3, 0.2))
    *before, state = states(md, np.array([[0.0, 5.0], [0.1, 5.0], [0.3, 5.0], [0.4, 5.0]]))
    assert all((early.weight == 1).all() for early in before)
    np.testing.assert_allclose(
        state.weight[0, 0], [1, np.sqrt(0.07 / 3) / 0.3, np.sqrt(0.01 / 3) / 0.2], rtol=1e-12
    )
    assert np.array_equal(state.weight[0, 1], [1, 0, 0])
    W = np.diag(state.weight[0].ravel())
    F = np.kron(np.eye(2), transition(2, DT))
    predicted = md.predict(state, DT)
    np.testing.assert_allclose(predicted.mean[0], F @ W @ state.mean[0], rtol=1e-14)


def test_third_order_weights_by_hand() -> None:
    """Order 3, k = 2: second differences of 0, 1, 3, 4 are 1, -1: sigma = sqrt(2), l_j = 4."""
    md = MotionDynamics(order=3, window=2, denoise="raw", factors=(9.0, 9.0, 4.0))
    *before, state = states(md, np.array([[0.0, 0.0], [1, 0], [3, 0], [4, 0]]))
    assert all((early.weight == 1).all() for early in before)
    expected = [1, np.sqrt(0.5) / 9, np.sqrt(0.5) / 9, np.sqrt(2) / 4]
    np.testing.assert_allclose(state.weight[0, 0], expected, rtol=1e-14)


def test_weights_saturate_at_one() -> None:
    """w = min(sigma / l, 1): a car at 20 m/s keeps its whole velocity."""
    z = np.outer(np.arange(20) * 2.0, [1.0, 0.0])
    state = states(MotionDynamics(denoise="raw"), z)[-1]
    assert state.weight[0, 0, 1] == 1.0
    assert state.weight[0, 0, 2] < 1e-12


@pytest.mark.parametrize("order", [2, 3])
def test_with_unit_weights_it_is_the_plain_filter(order: int) -> None:
    """With factors so small that W = I, MD equals CA and CJ exactly, bit for bit."""
    md = MotionDynamics(order=order, factors=(1e-12,) * order)
    kalman = Kalman(order=order)
    z = measurements(200, slice(60, 80))
    state = kalman.start(z[:1], R[None])
    for row, weighted in zip(z[1:], states(md, z)[1:], strict=True):
        state = kalman.update(kalman.predict(state, DT), row[None], R[None])
        assert np.array_equal(state.mean, weighted.mean)
        assert np.array_equal(state.covariance, weighted.covariance)


def test_covariance_option_changes_the_predicted_covariance_alone() -> None:
    """From the same state: the same mean; F P F' + Q against F W P W F' + Q."""
    by_f, by_fw = MotionDynamics(), MotionDynamics(covariance_by="FW")
    state = states(by_f, measurements())[-1]
    f, fw = by_f.predict(state, DT), by_fw.predict(state, DT)
    assert np.array_equal(f.mean, fw.mean)
    F = np.kron(np.eye(2), transition(2, DT))
    W = np.diag(state.weight[0].ravel())
    assert (W.diagonal() < 1).any()
    P = state.covariance[0]
    np.testing.assert_allclose(
        fw.covariance[0] - f.covariance[0], F @ (W @ P @ W - P) @ F.T, rtol=1e-9, atol=1e-15
    )


def test_denoise_option_changes_the_remembered_position_alone() -> None:
    """From the same state: one update, four remembered positions, each by its formula."""
    state = states(MotionDynamics(), measurements())[-1]
    predicted = MotionDynamics().predict(state, DT)
    z = np.array([[7.0, 2.0]])
    S = MotionDynamics().covariance(predicted)[0] + R
    HK = MotionDynamics().covariance(predicted)[0] @ np.linalg.inv(S)
    innovation = z[0] - MotionDynamics().position(predicted)[0]
    after = {d: MotionDynamics(denoise=d).update(predicted, z, R[None]) for d in OPTIONS["denoise"]}
    expected = {
        "literal": z[0] - HK @ np.diag(R),
        "innovation": z[0] - HK @ innovation,
        "posterior": MotionDynamics().position(after["raw"])[0],
        "raw": z[0],
    }
    for denoise, new in after.items():
        np.testing.assert_allclose(new.window[0, -1], expected[denoise], rtol=1e-12)
        assert np.array_equal(new.window[:, :-1], state.window[:, 1:])
        assert np.array_equal(new.mean, after["raw"].mean)
        assert np.array_equal(new.covariance, after["raw"].covariance)


def test_joint_axes_share_one_weight_from_both() -> None:
    """From the same window: w = |(sigma_x, sigma_y)| / l on both axes; all else the same."""
    before = states(MotionDynamics(), measurements(30))[-1]
    predicted, z = MotionDynamics().predict(before, DT), measurements(31)[-1:]
    wide = (5.0, 5.0)
    each = MotionDynamics(factors=wide).update(predicted, z, R[None])
    joint = MotionDynamics(factors=wide, axes="joint").update(predicted, z, R[None])
    np.testing.assert_allclose(
        joint.weight[0, :, 1:], np.tile(np.hypot(*each.weight[0, :, 1:]), (2, 1)), rtol=1e-14
    )
    assert np.array_equal(each.mean, joint.mean)
    assert np.array_equal(each.window, joint.window)


@pytest.mark.parametrize("after_gap", OPTIONS["after_gap"])
def test_a_gap_keeps_the_weights_and_reset_clears_the_window(after_gap: Any) -> None:
    """In the gap W stays; the first measurement after it resets the window, or does not."""
    shown = states(MotionDynamics(after_gap=after_gap), measurements(60, slice(30, 37)))
    held = shown[29].weight
    assert (held[:, :, 1:] < 1).any()
    assert all(np.array_equal(state.weight, held) for state in shown[30:37])
    length = shown[0].window.shape[1]
    if after_gap == "reset":
        assert [int(state.filled[0]) for state in shown[37:]] == [
            min(k, length) for k in range(1, 24)
        ]
        assert all((state.weight == 1).all() for state in shown[37 : 37 + length - 1])
    else:
        assert all(state.filled[0] == length for state in shown[37:])
        assert (shown[37].weight[:, :, 1:] < 1).any()


def test_reset_and_keep_differ_only_after_a_gap() -> None:
    """Up to the last frame of the gap they are equal to the bit."""
    z = measurements(60, slice(30, 37))
    reset, keep = (states(MotionDynamics(after_gap=a), z) for a in ("reset", "keep"))
    for a, b in zip(reset[:37], keep[:37], strict=True):
        assert np.array_equal(a.mean, b.mean)
        assert np.array_equal(a.weight, b.weight)
    assert not np.array_equal(reset[-1].mean, keep[-1].mean)


def test_the_window_length_is_k_values_of_the_last_difference() -> None:
    """k second differences need k + 2 positions, k first differences k + 1."""
    for order in (2, 3):
        md = MotionDynamics(order=order, window=4)
        shown = states(replace(md, denoise="raw"), measurements(12))
        formed = [bool((state.weight != 1).any()) for state in shown]
        assert formed.index(True) == 4 + order - 2
