"""Point counts are exact: checked against casting every beam at every box in three dimensions."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from sim_bridge.lidar import HDL_64E, Lidar
from sim_bridge.line_of_sight import visible_fractions
from sim_bridge.point_count import lone_point_counts, point_counts
from tests.sim_bridge.beams import COARSE, apart, cast_counts, scene, street
from tests.sim_bridge.worlds import BUS, CAR, ROOF_SENSOR, on_ground

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

LEVEL = Lidar(lowest=-0.2, highest=0.2)


def one_frame(sensor: object, boxes: object, lidar: Lidar = HDL_64E) -> Ints:
    table = np.array(boxes, dtype=float).reshape(-1, 7)
    return point_counts(np.array([sensor]), [0, len(table)], table, lidar)


seeds = st.integers(0, 2**32 - 1)
seeded = settings(deadline=None, derandomize=True)

# --- against casting every beam --------------------------------------------------------------


@settings(seeded, max_examples=100)
@given(seed=seeds, n=st.integers(1, 12), rays=st.integers(16, 900), beams=st.integers(2, 64))
def test_equals_casting_every_beam(seed: int, n: int, rays: int, beams: int) -> None:
    """Near and far, over and under one another, across the cut at +-pi, any number of beams."""
    sensor, boxes = scene(seed, n)
    lidar = Lidar(rays=rays, beams=beams, lowest=-0.6, highest=0.3, max_range=30.0)
    np.testing.assert_array_equal(
        one_frame(sensor, boxes, lidar), cast_counts(sensor, boxes, lidar)
    )


@pytest.mark.parametrize(("n", "seed"), [(60, 1), (100, 2)])
def test_crowded_street_equals_casting_every_beam(n: int, seed: int) -> None:
    sensor, boxes = street(seed, n, 1.73)
    counts = one_frame(sensor, boxes)
    assert (counts == 0).any()
    np.testing.assert_array_equal(counts, cast_counts(sensor, boxes, HDL_64E))


def test_boxes_in_a_circle_each_behind_the_next() -> None:
    """A pinwheel: no order of whole boxes is right for all rays, so any painter's order fails."""
    boxes = []
    for k in range(
        3
    ):  # from 6 m away straight to 30 m, 140 degrees on: behind the next one's start
        start, end = 6.0 * np.exp(2.0943j * k), 30.0 * np.exp(1j * (2.0943 * k + 2.4435))
        middle, along = (start + end) / 2, end - start
        boxes.append([middle.real, middle.imag, 1.0, np.angle(along), abs(along), 0.5, 2.0])
    table = np.array(boxes)
    sensor = np.array([0.0, 0.0, 1.0])
    assert all(apart(a, b) for i, a in enumerate(table) for b in table[:i])
    hides = np.zeros((3, 3), dtype=bool)  # which one takes returns from which
    for i in range(3):
        alone = one_frame(sensor, table[i])[0]
        for j in range(3):
            hides[j, i] = i != j and one_frame(sensor, table[[i, j]])[0] < alone
    assert hides.sum() == 3
    assert (hides.sum(axis=0) == 1).all()
    assert (hides.sum(axis=1) == 1).all()
    np.testing.assert_array_equal(one_frame(sensor, table), cast_counts(sensor, table, HDL_64E))


@pytest.mark.parametrize("gap", [1e-8, 1e-5, 1e-2])
@pytest.mark.parametrize("along", [0.0, 2.24, 2.25, 2.25 + 1e-13, 2.2500001, 3.0])
def test_sensor_beside_a_wall_or_in_line_with_one(gap: float, along: float) -> None:
    boxes = np.array(
        [on_ground(0, 0, 0, CAR), on_ground(1, 7, 0.3, BUS), on_ground(9, 0.0, 0.0, CAR)]
    )
    for y in (0.9 + gap, -0.9 - gap):
        sensor = np.array([along, y, 1.2])
        np.testing.assert_array_equal(one_frame(sensor, boxes, COARSE), cast_counts(sensor, boxes))
    sensor = np.array([2.25 + gap, 0.9, 1.2])  # exactly in line with walls of two boxes
    np.testing.assert_array_equal(one_frame(sensor, boxes, COARSE), cast_counts(sensor, boxes))


@settings(seeded, max_examples=60)
@given(seed=seeds, n=st.integers(1, 12))
def test_overlapping_boxes_go_by_where_the_ray_enters_the_footprint(seed: int, n: int) -> None:
    sensor, _ = scene(seed, 0)
    rng = np.random.default_rng(seed)
    place = sensor[:2] + 16.0 * np.exp(1j * rng.uniform(0, 7, (n, 1))).view(float)
    boxes = np.column_stack([place, rng.uniform(0, 2, n), rng.uniform(-4, 4, n)])
    boxes = np.column_stack([boxes, rng.uniform(0.5, 12.0, (n, 3))])
    np.testing.assert_array_equal(
        one_frame(sensor, boxes, COARSE), cast_counts(sensor, boxes, COARSE, by_footprint=True)
    )


def test_of_equal_boxes_the_lower_row_has_the_returns() -> None:
    box = on_ground(10, 3, 0.4, CAR)
    far = on_ground(30, 9, 0.4, CAR)
    alone = one_frame(ROOF_SENSOR, box)[0]
    assert one_frame(ROOF_SENSOR, [far, box, box])[1:].tolist() == [alone, 0]


# --- boxes alone ----------------------------------------------------------------------------


def each_alone(sensor: Floats, boxes: Floats, lidar: Lidar) -> Ints:
    """Every box in a frame of its own."""
    n = len(boxes)
    return point_counts(np.tile(sensor, (n, 1)), np.arange(n + 1), boxes, lidar)


@settings(seeded, max_examples=100)
@given(seed=seeds, n=st.integers(1, 12), rays=st.integers(16, 900), beams=st.integers(2, 64))
def test_lone_counts_are_those_of_each_box_in_a_frame_of_its_own(
    seed: int, n: int, rays: int, beams: int
) -> None:
    """To the integer, and also by casting every beam; every other scene is moved on to the cut."""
    sensor, boxes = scene(seed, n)
    if seed % 2:
        boxes[:, 0] = sensor[0] - np.abs(boxes[:, 0] - sensor[0]) - 15.0
        boxes[:, 1] = sensor[1] + 0.1 * (boxes[:, 1] - sensor[1])
    lidar = Lidar(rays=rays, beams=beams, lowest=-0.6, highest=0.3, max_range=30.0)
    lone = lone_point_counts(sensor[None], [0, len(boxes)], boxes, lidar)
    np.testing.assert_array_equal(lone, each_alone(sensor, boxes, lidar))
    by_rays = [cast_counts(sensor, box[None], lidar)[0] for box in boxes]
    np.testing.assert_array_equal(lone, by_rays)


def test_lone_counts_in_a_crowded_street() -> None:
    """Hidden boxes too have returns, by the default LiDAR, in all frames at once."""
    frames = [street(seed, 60, 1.73) for seed in (1, 2)]
    offsets = np.cumsum([0, *(len(boxes) for _, boxes in frames)])
    sensors, boxes = [sensor for sensor, _ in frames], np.vstack([boxes for _, boxes in frames])
    lone = lone_point_counts(sensors, offsets, boxes)
    alone = [each_alone(sensor, boxes, HDL_64E) for sensor, boxes in frames]
    np.testing.assert_array_equal(lone, np.concatenate(alone))
    together = point_counts(sensors, offsets, boxes)
    assert (lone >= together).all()
    assert ((together == 0) & (lone > 0)).any()


@settings(seeded, max_examples=40)
@given(seed=seeds)
def test_lone_counts_on_a_grid(seed: int) -> None:
    """Where corners, walls and rays coincide, beside walls and in line with them."""
    rng = np.random.default_rng(seed)
    boxes = np.column_stack([rng.integers(-9, 9, (20, 3)), rng.integers(0, 4, 20) * math.pi / 4])
    boxes = np.column_stack([boxes, rng.integers(1, 5, (20, 3))]).astype(float)
    sensor = np.array([rng.integers(-12, 12), 12.0, 1.0])
    lone = lone_point_counts(sensor[None], [0, 20], boxes)
    np.testing.assert_array_equal(lone, each_alone(sensor, boxes, HDL_64E))


# --- by hand --------------------------------------------------------------------------------


def test_no_boxes_no_counts() -> None:
    assert one_frame(ROOF_SENSOR, []).shape == (0,)
    assert point_counts(np.empty((0, 3)), [0], []).dtype == np.int64


def test_a_broad_wall_has_beams_times_rays() -> None:
    """At 10 m, from 1 m below to 1 m above the sensor: the beams within atan(0.1), 5.71 degrees."""
    lidar = Lidar(rays=3600, lowest=math.radians(-10), highest=math.radians(10), beams=41)
    wall = [10.5, 0.0, 2.0, 0.0, 1.0, 2e6, 2.0]  # 0.5 degrees apart: 23 beams straight ahead
    near = one_frame((0.0, 0.0, 2.0), wall, lidar)[0]
    elevation = np.radians(np.arange(41) * 0.5 - 10.0)
    azimuth = np.radians((np.arange(3600) + 0.5) * 0.1 - 180.0)
    reach = np.where(np.cos(azimuth) > 0.0, np.cos(azimuth) / 10.0, 0.0)
    within = np.abs(np.tan(elevation)) < reach[:, None]
    within &= (reach > 1.0 / lidar.max_range)[:, None]
    assert np.count_nonzero(within[1800]) == 23
    assert near == np.count_nonzero(within)


def test_bus_hides_car_and_car_hides_only_the_foot_of_a_bus() -> None:
    bus, car = on_ground(10, 0, math.pi / 2, BUS), on_ground(16, 0, math.pi / 2, CAR)
    assert one_frame(ROOF_SENSOR, [car, bus]).tolist() == [0, one_frame(ROOF_SENSOR, bus)[0]]
    car, bus = on_ground(10, 0, math.pi / 2, CAR), on_ground(16, 0, math.pi / 2, BUS)
    both = one_frame(ROOF_SENSOR, [bus, car])
    assert both[1] == one_frame(ROOF_SENSOR, car)[0]
    assert 0 < both[0] < one_frame(ROOF_SENSOR, bus)[0]


def test_touching_boxes_share_no_return() -> None:
    """Bumper to bumper, seen along the row: together they are one long box."""
    row = [on_ground(10.0 + 4.5 * i, 1.0, 0.0, CAR) for i in range(3)]
    long = on_ground(14.5, 1.0, 0.0, (13.5, 1.8, 1.5))
    assert one_frame(ROOF_SENSOR, row).sum() == one_frame(ROOF_SENSOR, long)[0]


@pytest.mark.parametrize(("y", "yaw"), [(0.3, 1.5), (0.9, 0.0), (-0.9, 0.0), (0.0, 0.0)])
def test_a_turn_by_half_a_circle_changes_nothing(y: float, yaw: float) -> None:
    """The same boxes ahead (+x) and behind (-x, across +-pi or with corners exactly on it)."""
    ahead = np.array([on_ground(10, y, yaw, CAR), on_ground(17, -y, 1.4, (6.0, 2.0, 2.2))])
    behind = ahead.copy()
    behind[:, :2] *= -1.0
    counts = one_frame(ROOF_SENSOR, ahead)
    assert (counts > 0).all()
    assert one_frame(ROOF_SENSOR, behind).tolist() == counts.tolist()


def test_out_of_range_boxes_neither_return_nor_hide() -> None:
    near, far = on_ground(10, 0, math.pi / 2, CAR), on_ground(16, 0, math.pi / 2, CAR)
    assert one_frame(ROOF_SENSOR, [near, far], Lidar(max_range=9.0)).tolist() == [0, 0]
    within = one_frame(ROOF_SENSOR, [near, far], Lidar(max_range=13.0))
    assert within.tolist() == [one_frame(ROOF_SENSOR, near)[0], 0]


# --- estimates ------------------------------------------------------------------------------


def jittered(distance: float, size: tuple[float, float, float]) -> float:
    """Mean returns of a box at eye level, over shifts by fractions of a ray and of a beam."""
    rng = np.random.default_rng(7)
    n = 200
    shift, climb = rng.uniform(-0.01, 0.01, n), rng.uniform(-0.01, 0.01, n) * distance
    boxes = [[distance, d * distance, z, d, *size] for d, z in zip(shift, climb, strict=True)]
    counts = point_counts(np.zeros((n, 3)), np.arange(n + 1), boxes, LEVEL)
    return float(counts.mean())


@pytest.mark.parametrize("distance", [15.0, 30.0, 60.0])
def test_equals_the_solid_angle_of_a_wall(distance: float) -> None:
    """4 atan(a b / (d sqrt(d2 + a2 + b2))) of a wall 2a x 2b at d, per ray times beam."""
    a, b, thin = 2.25, 0.75, 0.01
    d = distance - thin / 2
    angle = 4.0 * math.atan(a * b / (d * math.sqrt(d * d + a * a + b * b)))
    per_beam = math.tau / LEVEL.rays * (LEVEL.highest - LEVEL.lowest) / (LEVEL.beams - 1)
    assert jittered(distance, (thin, 2 * a, 2 * b)) == pytest.approx(angle / per_beam, rel=0.02)


def test_returns_fall_with_the_square_of_the_distance() -> None:
    near, far = jittered(25.0, (0.01, 4.5, 1.5)), jittered(50.0, (0.01, 4.5, 1.5))
    assert near / far == pytest.approx(4.0, rel=0.03)


@pytest.mark.parametrize(
    ("reach", "shifts", "mean", "most"),
    [(25.0, 16, 0.005, 0.04), (None, 1, 0.03, 0.2)],
    ids=["1024 beams", "HDL-64E"],
)
def test_the_share_of_returns_is_the_visible_fraction(
    reach: float | None, shifts: int, mean: float, most: float
) -> None:
    """Fans of 64 beams from -25 to 25 degrees, shifted, agree to half a percent on average.

    What is left is that a fraction is of the height averaged over azimuth and has no roof. The
    HDL-64E is 1/9 as dense, and the tops of near buses are above it.
    """
    lowest, highest = HDL_64E.lowest, HDL_64E.highest
    if reach is not None:
        lowest, highest = -math.radians(reach), math.radians(reach)
    shift = (highest - lowest) / 63 / shifts
    lidars = [Lidar(lowest=lowest + k * shift, highest=highest + k * shift) for k in range(shifts)]
    differences = []
    for seed in range(4):
        sensor, boxes = street(seed, 60, 1.73)
        n = len(boxes)
        each = np.tile(sensor, (n, 1))
        together = sum(one_frame(sensor, boxes, lidar) for lidar in lidars)
        alone = sum(point_counts(each, np.arange(n + 1), boxes, lidar) for lidar in lidars)
        fractions = visible_fractions([sensor], [0, n], boxes)
        kept = alone >= 50
        differences.append(np.abs(together / np.maximum(alone, 1) - fractions)[kept])
    difference = np.concatenate(differences)
    assert len(difference) > 200
    assert difference.mean() < mean
    assert np.quantile(difference, 0.99) < most


# --- properties -----------------------------------------------------------------------------


@settings(seeded, max_examples=60)
@given(seed=seeds, n=st.integers(2, 25))
def test_order_of_the_rows_does_not_matter(seed: int, n: int) -> None:
    sensor, boxes = scene(seed, n)
    order = np.random.default_rng(seed).permutation(len(boxes))
    counts = one_frame(sensor, boxes, COARSE)
    assert one_frame(sensor, boxes[order], COARSE).tolist() == counts[order].tolist()


@settings(seeded, max_examples=60)
@given(seed=seeds, n=st.integers(2, 25))
def test_removing_a_box_never_takes_returns_from_others(seed: int, n: int) -> None:
    sensor, boxes = scene(seed, n)
    rest = np.delete(np.arange(len(boxes)), seed % len(boxes))
    before = one_frame(sensor, boxes, COARSE)[rest]
    assert (one_frame(sensor, boxes[rest], COARSE) >= before).all()


def test_same_input_same_bytes() -> None:
    sensor, boxes = scene(11, 30)
    assert one_frame(sensor, boxes).tobytes() == one_frame(sensor, boxes).tobytes()


def test_all_frames_at_once_equal_frame_by_frame() -> None:
    """No frame leaves anything behind for the next, neither boxes nor order."""
    frames = [scene(seed, n) for seed, n in ((1, 4), (2, 0), (3, 30), (4, 1), (5, 12))]
    offsets = np.cumsum([0, *(len(boxes) for _, boxes in frames)])
    at_once = point_counts(
        [sensor for sensor, _ in frames], offsets, np.vstack([boxes for _, boxes in frames])
    )
    singly = np.concatenate([one_frame(sensor, boxes) for sensor, boxes in frames])
    assert at_once.tolist() == singly.tolist()


def test_plain_python_gives_the_same_counts() -> None:
    """The kernels run without numba's compiler, in another process as it is chosen on import."""
    sensor, boxes = scene(5, 12)
    program = (
        "import json, sys\n"
        "from sim_bridge.lidar import Lidar\n"
        "from sim_bridge.point_count import point_counts\n"
        "sensor, boxes = json.load(sys.stdin)\n"
        "lidar = Lidar(rays=720, beams=33)\n"
        "print(point_counts([sensor], [0, len(boxes)], boxes, lidar).tolist())"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error::RuntimeWarning", "-c", program],
        input=json.dumps([sensor.tolist(), boxes.tolist()]),
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == one_frame(sensor, boxes, COARSE).tolist()


@settings(seeded, max_examples=40)
@given(seed=seeds, scale=st.sampled_from([1e-6, 1e-3, 1e3, 1e9, 1e150]))
def test_any_finite_box_has_a_count(seed: int, scale: float) -> None:
    """Also sizes that no road has, on a grid where corners, walls and rays coincide."""
    rng = np.random.default_rng(seed)
    n = 20
    boxes = np.column_stack([rng.integers(-9, 9, (n, 3)) * scale, rng.integers(0, 4, n)])
    boxes = np.column_stack([boxes, rng.integers(1, 5, (n, 3)) * scale])
    boxes[:, 3] *= math.pi / 4
    counts = one_frame(scale * np.array([12.0, -14.0, 1.0]), boxes)
    assert (counts >= 0).all()
    assert counts.sum() <= HDL_64E.rays * HDL_64E.beams


# --- errors ---------------------------------------------------------------------------------


each_count = pytest.mark.parametrize("count", [point_counts, lone_point_counts])


@each_count
@pytest.mark.parametrize("place", [(10.0, 0.0), (12.25, 0.0), (8.0, 0.9)])
def test_sensor_inside_or_on_a_footprint_names_the_row(
    place: tuple[float, float], count: Callable[..., Ints]
) -> None:
    boxes = [on_ground(30, 0, 0, CAR), on_ground(10, 0, 0, CAR)]
    with pytest.raises(ValueError, match=r"row 3 has the sensor inside"):
        count([ROOF_SENSOR, (*place, 1.7)], [0, 2, 4], boxes + boxes)


@each_count
def test_wrong_shapes_and_values_are_refused(count: Callable[..., Ints]) -> None:
    box = on_ground(30, 0, 0, CAR)
    with pytest.raises(ValueError, match=r"sensor: expected shape \(n_frames, 3\)"):
        count(ROOF_SENSOR, [0, 1], [box])
    with pytest.raises(ValueError, match=r"boxes: expected shape \(n, 7\)"):
        count([ROOF_SENSOR], [0, 1], [box[:6]])
    with pytest.raises(ValueError, match="row 0 has a length, width or height that is not"):
        count([ROOF_SENSOR], [0, 1], [[*box[:6], 0.0]])
    with pytest.raises(ValueError, match="sensor: frame 1 is not finite"):
        count([ROOF_SENSOR, (0.0, math.nan, 0.0)], [0, 0, 1], [box])
    with pytest.raises(ValueError, match="rising from 0 to 1 rows"):
        count([ROOF_SENSOR], [0, 2], [box])
