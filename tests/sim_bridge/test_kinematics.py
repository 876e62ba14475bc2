"""Claim: smooth motion is what its equations say, and its columns are each other's derivatives."""

from math import comb, factorial

import numpy as np
import pytest

from mdkf.tables import FloatArray
from sim_bridge.kinematics import Motion, raw_motion, smooth_motion

LENGTH = 4.5  # m
WHEELBASE = 0.8 * LENGTH
CONTROL = 0.5  # s
TICK = 0.01  # s
COLUMNS = ("x", "y", "yaw", "vx", "vy", "ax", "ay", "jx", "jy", "yaw_rate")
DERIVATIVES = COLUMNS[3:]


def straight(n: int = 30, speed: float = 9.0) -> tuple[FloatArray, FloatArray]:
    """Constant velocity along a line that is no axis."""
    heading = np.full(n, 0.7)
    s = speed * CONTROL * np.arange(n)
    return np.column_stack([3 + s * np.cos(heading), -8 + s * np.sin(heading)]), heading


def accelerated(n: int = 30, rate: float = -1.5) -> tuple[FloatArray, FloatArray]:
    """Constant deceleration from 30 m/s."""
    t = CONTROL * np.arange(n)
    s = 30.0 * t + rate * t**2 / 2
    return np.column_stack([s, 0 * s]), np.zeros(n)


RADIUS, OMEGA = 15.0, 0.6  # of the circle's samples [m], [rad/s]
# A quintic B-spline averages its control points with a six-fold box: sinc to the sixth power.
BUMPER_RADIUS = RADIUS * np.sinc(OMEGA * CONTROL / 2 / np.pi) ** 6
REAR_RADIUS = np.sqrt(BUMPER_RADIUS**2 - WHEELBASE**2)
CENTRE_RADIUS = np.hypot(REAR_RADIUS, WHEELBASE - LENGTH / 2)


def circle(n: int = 60) -> tuple[FloatArray, FloatArray]:
    """Constant speed on a circle about the origin; the heading of the steady tractrix."""
    angle = OMEGA * CONTROL * np.arange(n)
    front = RADIUS * np.column_stack([np.cos(angle), np.sin(angle)])
    return front, angle + np.pi / 2 - np.arcsin(WHEELBASE / BUMPER_RADIUS)


def city(seed: int = 1, n: int = 80) -> tuple[FloatArray, FloatArray]:
    """Random bends and speeds, with a halt of 5 s (ten equal points) from point 40 on."""
    rng = np.random.default_rng(seed)
    speed = np.clip(8 + np.cumsum(rng.normal(0, 0.5, n)), 2, 14)
    speed[40:50] = 0.0
    turn = np.clip(np.cumsum(rng.normal(0, 0.03, n)), -0.25, 0.25)
    heading = np.cumsum(turn * (speed > 0))
    step = speed * CONTROL * np.exp(1j * heading)
    p = np.cumsum(step) - 40 + 25j
    return np.column_stack([p.real, p.imag]), heading


PATHS = {"straight": straight, "accelerated": accelerated, "circle": circle, "city": city}


def motion_of(path: tuple[FloatArray, FloatArray], first_tick: int = 0, stride: int = 1) -> Motion:
    motion = smooth_motion(first_tick, *path, LENGTH, stride)
    assert motion is not None
    return motion


def differences(column: FloatArray) -> FloatArray:
    """Central differences of fourth order, without the two values at either end."""
    near, far = column[3:-1] - column[1:-3], column[4:] - column[:-4]
    return (8 * near - far) / (12 * TICK)


def bumper(motion: Motion) -> FloatArray:
    yaw = motion.yaw
    centre = np.column_stack([motion.x, motion.y])
    return centre + LENGTH / 2 * np.column_stack([np.cos(yaw), np.sin(yaw)])


def cardinal_spline(points: FloatArray, u: FloatArray) -> FloatArray:
    """The uniform quintic B-spline at u [control points], by truncated powers."""
    x = u[:, None] - np.arange(len(points)) + 3
    weights = sum(
        (-1) ** i * comb(6, i) * np.where((x > i) & (x < 6), np.maximum(x - i, 0.0) ** 5, 0.0)
        for i in range(7)
    )
    return weights / factorial(5) @ points


@pytest.mark.parametrize("name", PATHS)
def test_columns_are_each_others_derivatives(name: str) -> None:
    """Numerical derivatives of position, v and a are v, a and j; of the heading, the yaw rate."""
    motion = motion_of(PATHS[name]())
    for below, above, allowed in (("", "v", 1e-6), ("v", "a", 1e-4), ("a", "j", 1e-3)):
        for axis in "xy":
            column = getattr(motion, f"{below}{axis}")
            expected = getattr(motion, f"{above}{axis}")[2:-2]
            np.testing.assert_allclose(differences(column), expected, atol=allowed)
    yaw = np.unwrap(motion.yaw)
    np.testing.assert_allclose(differences(yaw), motion.yaw_rate[2:-2], atol=1e-6)


@pytest.mark.parametrize("name", PATHS)
def test_the_bumper_follows_the_quintic_spline(name: str) -> None:
    """The front bumper is where the closed form of the B-spline of its samples is."""
    front, heading = PATHS[name]()
    motion = motion_of((front, heading))
    expected = cardinal_spline(front, motion.tick * TICK / CONTROL)
    np.testing.assert_allclose(bumper(motion), expected, atol=1e-9)


@pytest.mark.parametrize("name", PATHS)
def test_the_rear_axle_rolls_without_slip(name: str) -> None:
    """The velocity of the point 0.8 lengths behind the bumper has no part across the heading."""
    motion = motion_of(PATHS[name]())
    across = motion.vy * np.cos(motion.yaw) - motion.vx * np.sin(motion.yaw)
    behind = WHEELBASE - LENGTH / 2
    np.testing.assert_allclose(across - behind * motion.yaw_rate, 0.0, atol=1e-9)


def test_a_straight_path_is_reproduced_at_its_time() -> None:
    """Constant velocity comes back exactly, half a length behind the samples, at the same ticks."""
    front, heading = straight(speed=9.0)
    motion = motion_of((front, heading), first_tick=-730)
    direction = np.array([np.cos(0.7), np.sin(0.7)])
    way = 9.0 * TICK * (motion.tick + 730) - LENGTH / 2
    np.testing.assert_allclose(motion.x, 3 + way * direction[0], atol=1e-10)
    np.testing.assert_allclose(motion.y, -8 + way * direction[1], atol=1e-10)
    np.testing.assert_allclose(np.hypot(motion.vx, motion.vy), 9.0, atol=1e-10)
    np.testing.assert_allclose(motion.yaw, 0.7, atol=1e-12)
    for name in DERIVATIVES[2:]:
        np.testing.assert_allclose(getattr(motion, name), 0.0, atol=1e-9)


def test_constant_acceleration_is_reproduced() -> None:
    """v and a are those of the path, jerk is zero, and x is off by the spline's known a T2/4."""
    motion = motion_of(accelerated(rate=-1.5))
    t = motion.tick * TICK
    np.testing.assert_allclose(motion.vx, 30 - 1.5 * t, atol=1e-9)
    np.testing.assert_allclose(motion.ax, -1.5, atol=1e-9)
    np.testing.assert_allclose(motion.jx, 0.0, atol=1e-8)
    expected = 30 * t - 0.75 * t**2 - 1.5 * CONTROL**2 / 4 - LENGTH / 2
    np.testing.assert_allclose(motion.x, expected, atol=1e-9)


def test_a_circle_is_the_steady_tractrix() -> None:
    """On a circle the rear axle is at sqrt(R2 - l2), and every derivative is a power of omega."""
    motion = motion_of(circle())
    np.testing.assert_allclose(np.hypot(*bumper(motion).T), BUMPER_RADIUS, rtol=1e-7)
    back = WHEELBASE - LENGTH / 2
    rear = np.hypot(motion.x - back * np.cos(motion.yaw), motion.y - back * np.sin(motion.yaw))
    np.testing.assert_allclose(rear, REAR_RADIUS, rtol=1e-7)
    np.testing.assert_allclose(np.hypot(motion.x, motion.y), CENTRE_RADIUS, rtol=1e-7)
    np.testing.assert_allclose(motion.yaw_rate, OMEGA, rtol=1e-5)
    for power, (x, y) in enumerate((("vx", "vy"), ("ax", "ay"), ("jx", "jy")), start=1):
        size = np.hypot(getattr(motion, x), getattr(motion, y))
        np.testing.assert_allclose(size, OMEGA**power * CENTRE_RADIUS, rtol=1e-4)
    turned = np.unwrap(motion.yaw)
    assert turned[-1] - turned[0] > 4 * np.pi
    assert np.abs(motion.yaw).max() <= np.pi


def test_a_wrong_heading_decays_as_the_tractrix_does() -> None:
    """Towed along a line, tan(h / 2) falls by exp(-v t / l): the heading needs no good start."""
    speed, start = 6.0, 0.8
    front = np.column_stack([speed * CONTROL * np.arange(20), np.zeros(20)])
    motion = motion_of((front, np.full(20, start)))
    t = (motion.tick - motion.tick[0]) * TICK
    expected = 2 * np.arctan(np.tan(start / 2) * np.exp(-speed * t / WHEELBASE))
    np.testing.assert_allclose(motion.yaw, expected, atol=1e-9)


def test_six_equal_control_points_are_standstill() -> None:
    """Where six points are equal, v, a, j and yaw rate are zero, not merely small; x, y, yaw
    stay."""
    motion = motion_of(city())
    # Points 39..49 are equal, so the curve rests from 41 to 47.
    rest = (motion.tick >= 41 * 50) & (motion.tick <= 47 * 50)
    assert rest.sum() == 301
    for name in DERIVATIVES:
        assert (getattr(motion, name)[rest] == 0.0).all(), name
    for name in ("x", "y", "yaw"):
        assert np.ptp(getattr(motion, name)[rest]) < 1e-12
    assert np.hypot(motion.vx, motion.vy)[~rest].min() > 0.0


def test_five_equal_control_points_are_no_standstill() -> None:
    """One point fewer and the curve only passes through zero speed."""
    front, heading = straight()
    front = np.concatenate([front[:11], np.repeat(front[10:11], 4, axis=0), front[11:]])
    motion = motion_of((front, np.full(len(front), heading[0])))
    assert (np.hypot(motion.vx, motion.vy) == 0.0).sum() <= 1


@pytest.mark.parametrize("stride", [2, 10, 15])
@pytest.mark.parametrize("first_tick", [0, -130, 1237])
def test_the_motion_is_the_same_at_every_stride(stride: int, first_tick: int) -> None:
    """At common ticks all columns agree bit for bit; ticks are all multiples of the stride."""
    fine, coarse = motion_of(city(), first_tick), motion_of(city(), first_tick, stride)
    common = fine.tick % stride == 0
    np.testing.assert_array_equal(coarse.tick, fine.tick[common])
    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(coarse, name), getattr(fine, name)[common])
    # Two control points at either end only shape the motion.
    assert (fine.tick[0], fine.tick[-1]) == (first_tick + 100, first_tick + 50 * 77)
    assert (np.diff(fine.tick) == 1).all()


def test_short_lives_are_no_motion() -> None:
    """A quintic needs six control points; with six there is one interval of 0.5 s."""
    front, heading = city()
    for n in range(6):
        assert smooth_motion(0, front[:n], heading[:n], LENGTH, 1) is None
    np.testing.assert_array_equal(motion_of((front[:6], heading[:6])).tick, np.arange(100, 151))
    # None of its ticks may fall on a frame.
    assert len(motion_of((front[:6], heading[:6]), stride=1000).tick) == 0


def test_far_from_the_origin_derivatives_are_the_same() -> None:
    """Moved by a million metres (samples on a binary grid, so the move itself rounds nothing),
    the derivatives and the heading are the same bits."""
    front, heading = city()
    front, offset = np.round(front * 1024) / 1024, np.array([1e6, -1e6])
    here, there = motion_of((front, heading)), motion_of((front + offset, heading))
    for name in ("yaw", *DERIVATIVES):
        np.testing.assert_array_equal(getattr(there, name), getattr(here, name))
    np.testing.assert_allclose(there.x - 1e6, here.x, atol=1e-9)
    np.testing.assert_allclose(there.y + 1e6, here.y, atol=1e-9)


def test_a_turned_path_is_turned_motion() -> None:
    """Turning the samples turns every vector and the heading, and nothing else."""
    front, heading = city()
    angle = 2.1
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    plain, turned = motion_of((front, heading)), motion_of((front @ turn, heading + angle))
    for x, y in (("x", "y"), ("vx", "vy"), ("ax", "ay"), ("jx", "jy")):
        expected = np.column_stack([getattr(plain, x), getattr(plain, y)]) @ turn
        np.testing.assert_allclose(getattr(turned, x), expected[:, 0], atol=1e-8)
        np.testing.assert_allclose(getattr(turned, y), expected[:, 1], atol=1e-8)
    off = np.angle(np.exp(1j * (turned.yaw - plain.yaw - angle)))
    np.testing.assert_allclose(off, 0.0, atol=1e-10)
    np.testing.assert_allclose(turned.yaw_rate, plain.yaw_rate, atol=1e-10)


def test_raw_motion_keeps_the_simulators_numbers() -> None:
    """Position, heading and speed are as sampled; one sample alone is no motion."""
    rng = np.random.default_rng(2)
    n, step = 25, 0.1
    front, speed = rng.normal(0, 30, (n, 2)), rng.uniform(0, 12, n)
    heading = rng.uniform(-3.1, 3.1, n)
    tick = np.arange(n) * 10
    motion = raw_motion(tick, front, heading, speed, LENGTH, step)
    assert motion is not None
    np.testing.assert_allclose(bumper(motion), front, atol=1e-12)
    np.testing.assert_allclose(motion.yaw, heading, atol=1e-12)
    np.testing.assert_allclose(motion.vx + 1j * motion.vy, speed * np.exp(1j * heading), atol=1e-12)
    np.testing.assert_allclose(motion.ax[1:-1], (motion.vx[2:] - motion.vx[:-2]) / (2 * step))
    assert raw_motion(tick[:1], front[:1], heading[:1], speed[:1], LENGTH, step) is None
