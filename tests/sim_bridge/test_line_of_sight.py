"""The visible fraction is exact: checked against ray casting, quadrature and hand formulas."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from sim_bridge import line_of_sight
from sim_bridge.line_of_sight import visible_fraction, visible_fractions
from tests.sim_bridge.sight_oracle import cast_fractions, quad_fraction
from tests.sim_bridge.worlds import BUS, CAR, ROOF_SENSOR, on_ground

Floats = NDArray[np.float64]

EXACT = 1e-12  # allowance for rounding where two computations are equal in exact arithmetic

# --- scenes ---------------------------------------------------------------------------------


def scattered(rng: np.random.Generator, n: int, extent: float, origin: Floats) -> Floats:
    """Up to n boxes that overlap neither each other nor the origin (circumcircles apart)."""
    boxes: list[Floats] = []
    for _ in range(40 * n):
        size = rng.uniform((0.4, 0.4, 0.5), (9.0, 3.0, 3.5))
        place = origin + rng.uniform(-extent, extent, 2)
        radius = math.hypot(size[0], size[1]) / 2
        gap = [math.dist(place, b[:2]) - radius - math.hypot(b[4], b[5]) / 2 for b in boxes]
        if math.dist(place, origin) > radius + 0.3 and min(gap, default=1.0) > 0.0:
            lift = rng.uniform(-0.5, 1.0)
            boxes.append(
                np.array([*place, lift + size[2] / 2, rng.uniform(-math.pi, math.pi), *size])
            )
        if len(boxes) == n:
            break
    return np.array(boxes)


def scene(seed: int, n: int, extent: float = 25.0) -> tuple[Floats, Floats]:
    rng = np.random.default_rng(seed)
    sensor = np.array([*rng.uniform(-50.0, 50.0, 2), rng.uniform(0.2, 4.0)])
    return sensor, scattered(rng, n, extent, sensor[:2])


def layered(seed: int) -> tuple[Floats, Floats]:
    """Slanted walls one behind the other whose shadows cross on the last one's top and bottom."""
    rng = np.random.default_rng(seed)
    sensor = np.array([3.0, -2.0, rng.uniform(-3.0, 7.0)])
    boxes = []
    for distance in (10.0, 20.0, 30.0, 40.0):  # [m] apart by more than two circumradii
        theta = 1.0 + rng.uniform(-0.1, 0.1)
        shadow = rng.uniform(0.8, 2.2)  # [m] height it reaches at 40 m; the target spans 1 to 2
        top = 2.0 if distance == 40.0 else sensor[2] + (shadow - sensor[2]) * distance / 40.0
        place = sensor[:2] + distance * np.array([math.cos(theta), math.sin(theta)])
        size = (rng.uniform(4.0, 9.0), rng.uniform(0.2, 2.0), 1.0)
        boxes.append([*place, top - 0.5, rng.uniform(-math.pi, math.pi), *size])
    return sensor, np.array(boxes)


seeds = st.integers(0, 2**32 - 1)
seeded = settings(deadline=None, derandomize=True)

# --- against independent references ---------------------------------------------------------


@settings(seeded, max_examples=60)
@given(seed=seeds, n=st.integers(1, 9))
def test_equals_ray_casting_on_random_scenes(seed: int, n: int) -> None:
    """Midpoint sums over N azimuths are off by at most the variation of the integrand / N.

    Each other box makes the visible share jump or turn at no more than its four corners, and the
    share lies within [0, 1]; the bisection leaves 2^-24 of the height.
    """
    n_azimuth = 1500
    sensor, boxes = scene(seed, n)
    expected = cast_fractions(sensor, boxes, n_azimuth)
    tolerance = 4 * max(len(boxes) - 1, 1) / n_azimuth + 1e-6
    np.testing.assert_allclose(visible_fraction(sensor, boxes), expected, rtol=0, atol=tolerance)


@settings(seeded, max_examples=40)
@given(seed=seeds, n=st.integers(2, 6))
def test_equals_quadrature_to_nine_digits(seed: int, n: int) -> None:
    """Adaptive quadrature between all corners agrees to 1e-9."""
    sensor, boxes = scene(seed, n, extent=14.0)
    got = visible_fraction(sensor, boxes)
    for i in range(len(boxes)):
        assert got[i] == pytest.approx(quad_fraction(sensor, boxes, i), abs=1e-9)


@settings(seeded, max_examples=60)
@given(seed=seeds)
def test_crossing_shadows_equal_quadrature(seed: int) -> None:
    """Where the highest shadow changes hands, or meets a top or a bottom, between two corners."""
    sensor, boxes = layered(seed)
    expected = quad_fraction(sensor, boxes, 3)
    assert visible_fraction(sensor, boxes)[3] == pytest.approx(expected, abs=1e-9)


def test_crowded_street_equals_ray_casting() -> None:
    """Sixty boxes, where shadows of many boxes compete for one target."""
    rng = np.random.default_rng(5)
    sensor = np.array(ROOF_SENSOR)
    boxes = scattered(rng, 60, 40.0, sensor[:2])
    assert len(boxes) == 60
    error = visible_fraction(sensor, boxes) - cast_fractions(sensor, boxes, 400)
    assert np.abs(error).max() < 0.02
    assert np.abs(error).mean() < 5e-4


# --- by hand --------------------------------------------------------------------------------


def test_no_boxes_no_fractions() -> None:
    assert visible_fraction(ROOF_SENSOR, np.empty((0, 7))).shape == (0,)
    assert visible_fractions(np.empty((0, 3)), [0], []).shape == (0,)


def test_lone_box_is_fully_visible() -> None:
    assert visible_fraction(ROOF_SENSOR, [on_ground(10, 3, 0.4, CAR)]).tolist() == [1.0]


def test_bus_hides_car_behind_it() -> None:
    boxes = [on_ground(10, 0, math.pi / 2, BUS), on_ground(16, 0, math.pi / 2, CAR)]
    assert visible_fraction(ROOF_SENSOR, boxes).tolist() == [1.0, 0.0]


def wall_pair(near: float, near_size: Floats, far: float, far_size: Floats) -> list[list[float]]:
    """Two boxes broadside on, the near one wide enough to cover the far one's whole azimuth."""
    return [
        [near, 0.0, near_size[2] / 2, 0.0, *near_size],
        [far, 0.0, far_size[2] / 2, 0.0, *far_size],
    ]


def test_car_in_front_leaves_the_upper_part_of_a_bus() -> None:
    """Both walls face the sensor squarely: r_bus / r_car is constant, so the shadow is level.

    Sensor above the car: the shadow line starts at the car's far edge.
    """
    near, far = 10.0, 20.0
    boxes = wall_pair(near, np.array([1.8, 12.0, 1.5]), far, np.array([2.5, 12.0, 3.0]))
    shadow = 1.73 + (1.5 - 1.73) * (far - 1.25) / (near + 0.9)
    got = visible_fraction(ROOF_SENSOR, boxes)
    np.testing.assert_allclose(got, [1.0, (3.0 - shadow) / 3.0], rtol=0, atol=EXACT)
    low = visible_fraction((0.0, 0.0, 1.0), boxes)[1]  # sensor below the roof: the near edge counts
    shadow = 1.0 + (1.5 - 1.0) * (far - 1.25) / (near - 0.9)
    assert low == pytest.approx((3.0 - shadow) / 3.0, abs=EXACT)


def test_car_behind_car_shows_a_strip_under_the_roof_line() -> None:
    """The occluder is narrower than the target: a level strip in the middle, all at the sides."""
    near, far = 10.0, 16.0
    boxes = np.array([on_ground(near, 0, math.pi / 2, CAR), on_ground(far, 0, math.pi / 2, CAR)])
    boxes[1, 4] = 9.0
    shadow = 1.73 + (1.5 - 1.73) * (far - 0.9) / (near + 0.9)
    # Behind the middle of the occluder the far edge is its far wall; towards the sides, seen past
    # the far corners, it is a side wall at |y| = 2.25, along which r = 2.25 / sin(theta).
    full, corner, side = (
        math.atan2(4.5, far - 0.9),
        math.atan2(2.25, near + 0.9),
        math.atan2(2.25, near - 0.9),
    )
    flat = (corner / full) * (1.5 - shadow) / 1.5
    # Integral of s + (H - s) (r_t / r_e) with r_t = (far - 0.9) / cos and 1 / r_e = sin / 2.25.
    sloped_height = 1.73 * (side - corner) + (1.5 - 1.73) * (far - 0.9) / 2.25 * math.log(
        math.cos(corner) / math.cos(side)
    )
    sloped = (1.5 * (side - corner) - sloped_height) / 1.5 / full
    expected = flat + sloped + (full - side) / full
    got = visible_fraction(ROOF_SENSOR, boxes)
    assert got[0] == 1.0
    assert got[1] == pytest.approx(expected, abs=EXACT)


@pytest.mark.parametrize("width", [6.0, 1e-3, 1e-6])
def test_half_covered_target_shows_half(width: float) -> None:
    """A tall box whose edge lies on the line of sight to the middle of a wall behind it."""
    boxes = [[10.0, 4.0, 2.0, 0.0, 1.0, 8.0, 4.0], [20.0, 0.0, 0.75, 0.0, 1.0, width, 1.5]]
    rounding = EXACT / min(width, 1.0)  # azimuths are known to 1e-16 rad, however narrow the target
    assert visible_fraction(ROOF_SENSOR, boxes)[1] == pytest.approx(0.5, abs=rounding)


def test_box_behind_the_sensor_across_the_cut() -> None:
    """The same pair ahead (+x) and behind (-x, across +-pi) gives the same values."""
    pair = np.array([on_ground(10, 0.3, 1.5, CAR), on_ground(17, -0.4, 1.4, (6.0, 2.0, 2.2))])
    behind = pair.copy()
    behind[:, :2] *= -1.0
    ahead = visible_fraction(ROOF_SENSOR, pair)
    assert 0.0 < ahead[1] < 1.0
    np.testing.assert_allclose(visible_fraction(ROOF_SENSOR, behind), ahead, rtol=0, atol=EXACT)


def test_boxes_with_corners_exactly_on_the_cut() -> None:
    """Corners at azimuth +pi, from above, from below and with a negative zero."""
    for y in (0.9, -0.9, -0.0):
        boxes = [on_ground(-10, y, 0.0, CAR), on_ground(-20, y, 0.0, CAR)]
        mirrored = [on_ground(10, y, 0.0, CAR), on_ground(20, y, 0.0, CAR)]
        np.testing.assert_allclose(
            visible_fraction(ROOF_SENSOR, boxes),
            visible_fraction(ROOF_SENSOR, mirrored),
            rtol=0,
            atol=EXACT,
        )


def test_touching_boxes_and_shared_corner_directions() -> None:
    """A parked row, bumper to bumper and door to door, some edges in line with the sensor."""
    row = [on_ground(5 + 4.5 * i, 0.9 + 1.8 * j, 0.0, CAR) for i in range(6) for j in range(4)]
    got = visible_fraction(ROOF_SENSOR, row)
    assert np.isfinite(got).all()
    assert ((got >= 0.0) & (got <= 1.0)).all()
    assert got[0] == 1.0
    # The car behind in line touches the first: its shadow line is at its own far edge, the roof.
    assert visible_fraction(ROOF_SENSOR, row[:1] + row[4:5])[1] < 0.35
    stack = [on_ground(10, 0, 0, (2.0, 2.0, 3.0)), on_ground(12, 0, 0, (2.0, 2.0, 3.0))]
    assert visible_fraction(ROOF_SENSOR, stack).tolist() == [1.0, 0.0]


# --- properties -----------------------------------------------------------------------------


@settings(seeded, max_examples=80)
@given(seed=seeds, turn=st.floats(-10.0, 10.0), dx=st.floats(-500, 500), dz=st.floats(-20, 20))
def test_moving_the_whole_scene_changes_nothing(
    seed: int, turn: float, dx: float, dz: float
) -> None:
    """Rotation about any point, translation, and numbering a box's yaw half a turn off."""
    sensor, boxes = scene(seed, 25, extent=40.0)
    c, s = math.cos(turn), math.sin(turn)
    rotation = np.array([(c, s), (-s, c)])
    moved = boxes.copy()
    moved[:, :2] = boxes[:, :2] @ rotation + (dx, -dx)
    moved[:, 2] += dz
    moved[:, 3] += turn + math.pi * (np.arange(len(boxes)) % 2)
    place = np.array([*(sensor[:2] @ rotation + (dx, -dx)), sensor[2] + dz])
    np.testing.assert_allclose(
        visible_fraction(place, moved), visible_fraction(sensor, boxes), rtol=0, atol=1e-9
    )


@settings(seeded, max_examples=80)
@given(seed=seeds, n=st.integers(2, 25))
def test_order_of_the_rows_does_not_matter(seed: int, n: int) -> None:
    sensor, boxes = scene(seed, n)
    order = np.random.default_rng(seed).permutation(len(boxes))
    np.testing.assert_allclose(
        visible_fraction(sensor, boxes[order]),
        visible_fraction(sensor, boxes)[order],
        rtol=0,
        atol=EXACT,
    )


@settings(seeded, max_examples=80)
@given(seed=seeds, azimuth=st.floats(-math.pi, math.pi))
def test_a_box_beyond_all_others_changes_no_other(seed: int, azimuth: float) -> None:
    sensor, boxes = scene(seed, 20)
    far = [
        sensor[0] + 90 * math.cos(azimuth),
        sensor[1] + 90 * math.sin(azimuth),
        2.0,
        azimuth + 0.7,
        30.0,
        20.0,
        4.0,
    ]
    with_far = visible_fraction(sensor, np.vstack([boxes, far]))
    np.testing.assert_allclose(with_far[:-1], visible_fraction(sensor, boxes), rtol=0, atol=EXACT)


@settings(seeded, max_examples=80)
@given(seed=seeds, n=st.integers(2, 25))
def test_removing_an_occluder_never_lowers_visibility(seed: int, n: int) -> None:
    sensor, boxes = scene(seed, n)
    gone = seed % len(boxes)
    rest = np.delete(np.arange(len(boxes)), gone)
    before = visible_fraction(sensor, boxes)[rest]
    assert (visible_fraction(sensor, boxes[rest]) >= before - EXACT).all()


@settings(seeded, max_examples=150)
@given(seed=seeds, n=st.integers(1, 40), scale=st.sampled_from([1e-3, 1.0, 1e6]))
def test_overlapping_boxes_stay_finite_and_within_bounds(seed: int, n: int, scale: float) -> None:
    """Also rows snapped to a grid, where corners, walls and lines of sight coincide."""
    rng = np.random.default_rng(seed)
    boxes = np.column_stack(
        [rng.integers(-9, 9, (n, 2)), rng.integers(0, 3, n), rng.integers(0, 4, n) * math.pi / 4]
    )
    boxes = np.column_stack([boxes, rng.integers(1, 5, (n, 3))]) * scale
    boxes[:, 3] /= scale
    sensor = scale * np.array([rng.integers(-12, 12), 12.0, rng.integers(0, 4)])
    got = visible_fraction(sensor, boxes)
    assert ((got >= 0.0) & (got <= 1.0)).all()


@pytest.mark.parametrize("gap", [1e-8, 1e-5, 1e-2])
@pytest.mark.parametrize("along", [0.0, 2.24, 2.25, 2.25 + 1e-12, 2.2500001, 3.0])
def test_sensor_beside_a_wall(gap: float, along: float) -> None:
    """Close to a wall or in line with one, every other box is still seen as quadrature sees it."""
    boxes = np.array(
        [on_ground(0, 0, 0, CAR), on_ground(1, 7, 0.3, BUS), on_ground(9, -1.7, 0.1, CAR)]
    )
    sensor = np.array([along, 0.9 + gap, 1.73])
    got = visible_fraction(sensor, boxes)
    expected = [quad_fraction(sensor, boxes, i) for i in range(3)]
    np.testing.assert_allclose(got, expected, rtol=0, atol=2e-7)


def test_same_input_same_bytes_and_the_plain_python_source_agrees() -> None:
    sensor, boxes = scene(11, 30)
    compiled = visible_fraction(sensor, boxes)
    assert visible_fraction(sensor, boxes).tobytes() == compiled.tobytes()
    plain = np.empty(len(boxes))
    sweep: Callable[..., int] = getattr(line_of_sight._sweep, "py_func", line_of_sight._sweep)
    assert sweep(sensor, boxes, plain, np.empty(0)) == -1
    np.testing.assert_allclose(plain, compiled, rtol=0, atol=EXACT)


def test_all_frames_at_once_equal_frame_by_frame() -> None:
    frames = [scene(seed, n) for seed, n in ((1, 4), (2, 0), (3, 9), (4, 1))]
    tables = [boxes.reshape(-1, 7) for _, boxes in frames]
    offsets = np.cumsum([0, *map(len, tables)])
    at_once = visible_fractions([sensor for sensor, _ in frames], offsets, np.vstack(tables))
    singly = np.concatenate(
        [visible_fraction(sensor, t) for (sensor, _), t in zip(frames, tables, strict=True)]
    )
    assert at_once.tobytes() == singly.tobytes()


# --- errors ---------------------------------------------------------------------------------


@pytest.mark.parametrize("place", [(10.0, 0.0), (12.25, 0.0), (8.0, 0.9)])
def test_sensor_inside_or_on_a_footprint_names_the_row(place: tuple[float, float]) -> None:
    boxes = [on_ground(30, 0, 0, CAR), on_ground(10, 0, 0, CAR)]
    with pytest.raises(ValueError, match=r"row 1 has the sensor inside"):
        visible_fraction((*place, 1.7), boxes)
    with pytest.raises(ValueError, match=r"row 3 has the sensor inside"):
        visible_fractions([ROOF_SENSOR, (*place, 1.7)], [0, 2, 4], boxes + boxes)


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        (0, math.nan, "row 1 has a value that is not finite"),
        (3, math.inf, "row 1 has a value that is not finite"),
        (4, 0.0, "row 1 has a length, width or height that is not positive"),
        (6, -1.5, "row 1 has a length, width or height that is not positive"),
    ],
)
def test_bad_box_names_the_row(column: int, value: float, message: str) -> None:
    boxes = np.array([on_ground(30, 0, 0, CAR), on_ground(10, 0, 0, CAR)])
    boxes[1, column] = value
    with pytest.raises(ValueError, match=message):
        visible_fraction(ROOF_SENSOR, boxes)


def test_wrong_shapes_are_refused() -> None:
    box = on_ground(30, 0, 0, CAR)
    with pytest.raises(ValueError, match=r"sensor: expected shape \(3,\)"):
        visible_fraction((0.0, 0.0), [box])
    with pytest.raises(ValueError, match=r"boxes: expected shape \(n, 7\)"):
        visible_fraction(ROOF_SENSOR, [box[:6]])
    with pytest.raises(ValueError, match="sensor: frame 1 is not finite"):
        visible_fractions([ROOF_SENSOR, (0.0, math.nan, 0.0)], [0, 0, 1], [box])
    with pytest.raises(ValueError, match="expected 2 integer offsets"):
        visible_fractions([ROOF_SENSOR], [0], [box])
    with pytest.raises(ValueError, match="rising from 0 to 1 rows"):
        visible_fractions([ROOF_SENSOR], [0, 2], [box])
