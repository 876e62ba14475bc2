"""Claim: a regime says what the speed along the path does, whichever way the path bends."""

import numpy as np
import pytest

from mdkf.tables import REGIMES, FloatArray
from sim_bridge.regimes import regimes, turning

Vector = tuple[float, float]

LARGEST_CONSTANT_VELOCITY = 0.3  # |s'| [m/s2]
LARGEST_CONSTANT_ACCELERATION = 0.5  # |s''| [m/s3]


def names(v: FloatArray, a: FloatArray, j: FloatArray) -> list[str]:
    return [REGIMES[code] for code in regimes(v, a, j)]


@pytest.mark.parametrize(
    ("v", "a", "j", "expected"),
    [
        ((0, 0), (0, 0), (0, 0), "stationary"),
        ((9, 0), (0, 0), (0, 0), "constant_velocity"),
        ((9, 0), (0.29, 0), (0.4, 0), "constant_velocity"),
        ((0, -9), (0, -0.31), (0, 0), "constant_acceleration"),
        ((9, 0), (2, 0), (0.4, 0), "constant_acceleration"),
        ((9, 0), (-2, 0), (-0.4, 0), "constant_acceleration"),
        ((9, 0), (2, 0), (-0.6, 0), "changing_acceleration"),
        ((9, 0), (0.1, 0), (0.6, 0), "changing_acceleration"),
        ((-9, 0), (0, 0), (0.6, 0), "changing_acceleration"),
        # Rolling away from a halt: slow, yet moving.
        ((1e-3, 0), (0.1, 0), (3, 0), "changing_acceleration"),
        # A lateral jerk that a curve's own a . a does not explain is no change of speed.
        ((9, 0), (0, 0), (0, 5), "constant_velocity"),
    ],
)
def test_hand_made_motions_have_their_names(v: Vector, a: Vector, j: Vector, expected: str) -> None:
    """Every regime, both signs, both sides of both thresholds."""
    assert names(*(np.array([vector], dtype=float) for vector in (v, a, j))) == [expected]


@pytest.mark.parametrize("omega", [-0.4, 0.08, 1.0])
def test_a_circle_at_constant_speed_is_constant_velocity_and_turns(omega: float) -> None:
    """a = omega2 r looks like 8 m/s2 to a filter, but the speed does not change; it only turns."""
    angle = np.linspace(0, 7, 50)
    v = 8.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    a = omega * np.column_stack([-v[:, 1], v[:, 0]])
    j = -(omega**2) * v
    assert names(v, a, j) == ["constant_velocity"] * 50
    assert turning(np.full(50, omega)).all()


def test_slow_turns_are_none() -> None:
    """Up to 0.05 rad/s, either way, a path counts as straight."""
    rates = np.array([0.0, 0.05, -0.05, 0.0501, -0.0501, 3.0])
    np.testing.assert_array_equal(turning(rates), [False, False, False, True, True, True])


def test_labels_follow_the_differentiated_speed() -> None:
    """On curved paths with analytic v, a, j the labels are those of s' and s'' taken by finite
    differences of s = |v|, wherever these are not at a threshold."""
    rng = np.random.default_rng(4)
    h = 1e-3  # s
    seen = set()
    for _ in range(20):
        amplitude, frequency = rng.normal(0, 0.5, (3, 2)), rng.uniform(0.2, 1.2, (3, 2))
        phase = rng.uniform(-3, 3, (3, 2))
        cruise = rng.uniform(2, 12, 2)

        def derivative(
            order: int,
            t: FloatArray,
            amplitude: FloatArray = amplitude,
            frequency: FloatArray = frequency,
            phase: FloatArray = phase,
            cruise: FloatArray = cruise,
        ) -> FloatArray:
            """The velocity's derivatives: a cruise with three waves on either axis."""
            waves = frequency**order * np.sin(
                frequency * t[:, None, None] + phase + order * np.pi / 2
            )
            return (amplitude * waves).sum(axis=1) + (cruise if order == 0 else 0.0)

        t = np.linspace(0, 20, 400)
        before, now, after = (np.hypot(*derivative(0, t + d).T) for d in (-h, 0.0, h))
        first, second = (after - before) / (2 * h), (after - 2 * now + before) / h**2
        labels = np.array(names(*(derivative(order, t) for order in range(3))))
        steady = np.abs(second) < LARGEST_CONSTANT_ACCELERATION
        slow = np.abs(first) < LARGEST_CONSTANT_VELOCITY
        expected = np.where(
            steady,
            np.where(slow, "constant_velocity", "constant_acceleration"),
            "changing_acceleration",
        )
        clear = np.abs(np.abs(second) - LARGEST_CONSTANT_ACCELERATION) > 1e-4
        clear &= np.abs(np.abs(first) - LARGEST_CONSTANT_VELOCITY) > 1e-4
        assert clear.mean() > 0.99
        np.testing.assert_array_equal(labels[clear], expected[clear])
        seen |= set(labels)
    assert seen == {"constant_velocity", "constant_acceleration", "changing_acceleration"}


def test_no_rows_have_no_regimes() -> None:
    """An empty road is no error."""
    empty = np.empty((0, 2))
    assert regimes(empty, empty, empty).shape == (0,)
    assert turning(np.empty(0)).shape == (0,)
