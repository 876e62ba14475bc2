"""Claim: the side of what is visible is exact, checked against casting 4000 rays at every box.

The reference clips rays by the slabs of each box in the box's own frame; it knows no wall
equations, no sweep and no cut. Boxes are of one height and the sensor looks from half of it, so
that they hide one another from the ground up.
"""

import json
import math
import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from sim_bridge import line_of_sight
from sim_bridge.line_of_sight import visible_fractions, visible_sides
from tests.sim_bridge.worlds import corners

Floats = NDArray[np.float64]

HEIGHT = 1.5  # m
SENSOR = np.array([3.0, -2.0, HEIGHT / 2])
RAYS = 4000
EXACT = 1e-12  # [rad] allowance for rounding

seeds = st.integers(0, 2**32 - 1)
seeded = settings(deadline=None, derandomize=True)


def box(
    distance: float, azimuth: float, heading: float, length: float = 4.5, width: float = 1.8
) -> list[float]:
    """As seen from the sensor; the heading is relative to the line of sight."""
    x, y = SENSOR[0] + distance * math.cos(azimuth), SENSOR[1] + distance * math.sin(azimuth)
    return [x, y, HEIGHT / 2, azimuth + heading, length, width, HEIGHT]


def scene(seed: int, n: int) -> Floats:
    """Up to n boxes in a bunch, so that they hide one another, every other time across the cut."""
    rng = np.random.default_rng(seed)
    towards = rng.choice([rng.uniform(-math.pi, math.pi), math.pi])
    boxes: list[list[float]] = []
    for _ in range(n):
        other = box(
            rng.uniform(5.0, 40.0),
            towards + rng.uniform(-0.4, 0.4),
            rng.uniform(-3.0, 3.0),
            *rng.uniform((0.4, 0.4), (12.0, 2.5)),
        )
        # Circles around both footprints do not touch, nor the sensor.
        radii = [math.hypot(*b[4:6]) / 2 for b in (other, *boxes)]
        gaps = [math.dist(other[:2], b[:2]) for b in boxes]
        free = all(g > r + radii[0] for g, r in zip(gaps, radii[1:], strict=True))
        if free and math.dist(other[:2], SENSOR[:2]) > radii[0] + 0.1:
            boxes.append(other)
    return np.array(boxes).reshape(-1, 7)


def sides(boxes: Floats) -> Floats:
    return visible_sides(SENSOR[None], [0, len(boxes)], boxes)


def fractions(boxes: Floats) -> Floats:
    return visible_fractions(SENSOR[None], [0, len(boxes)], boxes)


def silhouette(box: Floats) -> tuple[float, float]:
    """Azimuths of its right and its left end [rad], the latter beyond pi across the cut."""
    ends = corners(box[None, [0, 1, 3, 4, 5]])[0] - SENSOR[:2]
    middle = math.atan2(box[1] - SENSOR[1], box[0] - SENSOR[0])
    relative = np.angle((ends[:, 0] + 1j * ends[:, 1]) * np.exp(-1j * middle))
    return middle + float(relative.min()), middle + float(relative.max())


def range_along(box: Floats, azimuths: Floats) -> Floats:
    """Distance at which rays enter a footprint [m], inf where they miss it."""
    turn = np.exp(-1j * box[3])
    origin = complex(*(SENSOR[:2] - box[:2])) * turn
    heading = np.exp(1j * azimuths) * turn
    enter, leave = np.zeros(len(azimuths)), np.full(len(azimuths), np.inf)
    for o, h, half in (
        (origin.real, heading.real, box[4] / 2),
        (origin.imag, heading.imag, box[5] / 2),
    ):
        h = np.where(np.abs(h) < 1e-300, 1e-300, h)
        t1, t2 = (-half - o) / h, (half - o) / h
        enter, leave = np.maximum(enter, np.minimum(t1, t2)), np.minimum(leave, np.maximum(t1, t2))
    return np.where(leave > enter, enter, np.inf)


def cast(boxes: Floats) -> tuple[Floats, Floats, Floats]:
    """Fractions, sides [rad] and angular widths [rad] of all boxes, by `RAYS` rays each."""
    fraction, side, width = np.zeros((3, len(boxes)))
    for i, target in enumerate(boxes):
        right, left = silhouette(target)
        azimuths = right + (left - right) * (np.arange(RAYS) + 0.5) / RAYS
        nearest = np.min([range_along(other, azimuths) for other in boxes], axis=0)
        visible = range_along(target, azimuths) <= nearest
        fraction[i], width[i] = visible.mean(), left - right
        if visible.any():
            side[i] = azimuths[visible].mean() - (left + right) / 2
    return fraction, side, width


# --- against casting rays --------------------------------------------------------------------


@settings(seeded, max_examples=150)
@given(seed=seeds, n=st.integers(2, 9))
def test_equals_casting_rays(seed: int, n: int) -> None:
    """Of each end of a visible stretch, n or fewer to a side, casting knows to half a ray where it
    is, which moves the middle of a visible fraction f by a quarter of a ray / f at most."""
    boxes = scene(seed, n)
    fraction, expected, width = cast(boxes)
    ray = width / RAYS
    np.testing.assert_allclose(fractions(boxes), fraction, atol=n / RAYS)
    clear = fraction > 0.02
    error = np.abs(sides(boxes) - expected)[clear]
    assert (error <= (0.5 * n * ray / fraction.clip(0.02))[clear]).all()


def test_scenes_have_boxes_hidden_on_either_side_and_across_the_cut() -> None:
    """What the claim above is about does occur: sides of both signs, also at +-pi."""
    found = {(cut, sign): 0 for cut in (False, True) for sign in (-1, 1)}
    for seed in range(60):
        boxes = scene(seed, 8)
        for target, side in zip(boxes, cast(boxes)[1], strict=True):
            if abs(side) > 0.01:
                cut = np.ptp(np.floor((np.array(silhouette(target)) - math.pi) / math.tau)) > 0
                found[bool(cut), int(np.sign(side))] += 1
    assert min(found.values()) >= 5, found


# --- by hand --------------------------------------------------------------------------------

TOWARDS = pytest.mark.parametrize("azimuth", [0.0, 1.1, -2.6, math.pi, -math.pi, math.pi - 0.05])


@TOWARDS
@pytest.mark.parametrize("hidden", [-1, 1])
def test_the_side_is_where_it_can_be_seen(azimuth: float, hidden: int) -> None:
    """A broad wall whose left (1) or right (-1) part is hidden: the middle of the rest is half of
    the hidden angle to the other side; left is positive."""
    wall = box(20.0, azimuth, math.pi / 2, length=8.0, width=0.5)
    screen = box(10.0, azimuth + hidden * 0.2, math.pi / 2, length=3.0, width=0.2)
    # Near faces: the wall's at 19.75 m reaches 4 m to either side; the screen's inner end is the
    # one nearest to the line of sight, at +-1.5 m across and 9.9 m or 10.1 m away.
    end = math.atan2(4.0, 19.75)
    inner = 0.2 - max(math.atan2(1.5, 9.9), math.atan2(1.5, 10.1))
    side, nothing = sides(np.array([wall, screen]))
    assert side == pytest.approx(-hidden * (end - inner) / 2, abs=EXACT)
    assert nothing == pytest.approx(0.0, abs=EXACT)


@TOWARDS
@pytest.mark.parametrize("n", [1, 2])
def test_what_hides_the_middle_or_both_ends_alike_moves_nothing(azimuth: float, n: int) -> None:
    """A post in the middle, or one on either side."""
    wall = box(20.0, azimuth, math.pi / 2, length=8.0, width=0.5)
    places = [azimuth] if n == 1 else [azimuth - 0.15, azimuth + 0.15]
    posts = [box(10.0, place, 0.3 * k, 0.5, 0.5) for k, place in enumerate(places)]
    if n == 2:  # each the other's mirror image
        posts[0][3], posts[1][3] = places[0] - 0.3, places[1] + 0.3
    boxes = np.array([wall, *posts])
    assert 0.3 < fractions(boxes)[0] < 0.95
    assert sides(boxes)[0] == pytest.approx(0.0, abs=EXACT)


@TOWARDS
def test_full_view_and_hidden_have_no_side(azimuth: float) -> None:
    """Alone, beside another box, before another box: 0 up to rounding; wholly behind: 0."""
    front = box(10.0, azimuth, math.pi / 2, length=8.0)
    beside = box(12.0, azimuth + 1.0, 0.4)
    behind = box(30.0, azimuth + 0.02, 0.4)
    boxes = np.array([behind, front, beside])
    np.testing.assert_allclose(fractions(boxes), [0.0, 1.0, 1.0], atol=EXACT)
    side = sides(boxes)
    assert side[0] == 0.0
    np.testing.assert_allclose(side[1:], 0.0, atol=EXACT)


@pytest.mark.parametrize("turn", [0.3, 1.0, 2.0, math.pi, -1.7])
def test_turning_the_world_changes_no_side(turn: float) -> None:
    """All boxes turned about the sensor, some of them over the cut at +-pi."""
    boxes = scene(3, 9)
    turned = boxes.copy()
    place = (boxes[:, 0] - SENSOR[0] + 1j * (boxes[:, 1] - SENSOR[1])) * np.exp(1j * turn)
    turned[:, 0], turned[:, 1] = SENSOR[0] + place.real, SENSOR[1] + place.imag
    turned[:, 3] += turn
    assert np.abs(sides(boxes)).max() > 0.02
    np.testing.assert_allclose(sides(turned), sides(boxes), atol=1e-9)


@settings(seeded, max_examples=40)
@given(seed=seeds, n=st.integers(2, 12))
def test_a_mirror_changes_the_sign(seed: int, n: int) -> None:
    """Left and right are treated alike."""
    boxes = scene(seed, n)
    mirrored = boxes.copy()
    mirrored[:, 1] = 2 * SENSOR[1] - boxes[:, 1]
    mirrored[:, 3] = -boxes[:, 3]
    np.testing.assert_allclose(sides(mirrored), -sides(boxes), atol=1e-9)


# --- properties -----------------------------------------------------------------------------


def any_heights(seed: int, n: int) -> Floats:
    """Boxes that also look over and under one another."""
    boxes = scene(seed, n)
    rng = np.random.default_rng(seed)
    boxes[:, 6] = rng.uniform(0.3, 4.0, len(boxes))
    boxes[:, 2] = boxes[:, 6] / 2 + rng.choice([0.0, 1.0], len(boxes))
    return boxes


@settings(seeded, max_examples=60)
@given(seed=seeds, n=st.integers(1, 12))
def test_the_middle_of_what_is_visible_is_within_the_box(seed: int, n: int) -> None:
    """Whatever the heights: visible v of a width w, the middles are at most w / 2 apart, and with
    boxes of one height (1 - v) w / 2."""
    for boxes, of_one_height in ((any_heights(seed, n), False), (scene(seed, n), True)):
        right, left = np.array([silhouette(b) for b in boxes]).reshape(-1, 2).T
        visible = fractions(boxes)
        most = (left - right) / 2 * (1.0 - visible if of_one_height else 1.0)
        assert (np.abs(sides(boxes)) <= most + 1e-9).all()


def test_all_frames_at_once_equal_frame_by_frame() -> None:
    """No frame leaves anything behind for the next."""
    frames = [any_heights(seed, n) for seed, n in ((1, 4), (2, 0), (3, 9), (4, 1))]
    sensors = np.tile(SENSOR, (4, 1))
    at_once = visible_sides(sensors, np.cumsum([0, *map(len, frames)]), np.vstack(frames))
    singly = np.concatenate([sides(boxes) for boxes in frames])
    assert at_once.tobytes() == singly.tobytes()
    assert visible_sides(np.empty((0, 3)), [0], np.empty((0, 7))).shape == (0,)


def test_sides_leave_the_fractions_as_they_are() -> None:
    """One sweep fills both: fractions found with sides are those found without, bit for bit."""
    boxes = any_heights(5, 12)
    given = np.ascontiguousarray(SENSOR[None]), np.array([0, len(boxes)]), boxes
    together = line_of_sight._swept(*given, sides=True)
    alone = line_of_sight._swept(*given, sides=False)
    assert together[0].tobytes() == alone[0].tobytes() == fractions(boxes).tobytes()
    assert together[1].tobytes() == sides(boxes).tobytes()
    assert alone[1].shape == (0,)


def test_plain_python_gives_the_same_bits() -> None:
    """The kernel runs without numba's compiler, in another process as it is chosen on import."""
    boxes = any_heights(5, 12)
    program = (
        "import json, sys; from sim_bridge.line_of_sight import visible_sides\n"
        "sensor, boxes = json.load(sys.stdin)\n"
        "print(json.dumps(visible_sides([sensor], [0, len(boxes)], boxes).tolist()))"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error::RuntimeWarning", "-c", program],
        input=json.dumps([SENSOR.tolist(), boxes.tolist()]),
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == sides(boxes).tolist()


# --- errors ---------------------------------------------------------------------------------


def test_a_sensor_within_a_footprint_names_the_row() -> None:
    """As for fractions."""
    boxes = np.array([box(20.0, 0.0, 0.0), box(1.0, 0.0, 0.0)])
    with pytest.raises(ValueError, match=r"boxes: row 1 has the sensor inside"):
        sides(boxes)
    with pytest.raises(ValueError, match="rising from 0 to 2 rows"):
        visible_sides(SENSOR[None], [0, 1], boxes)
