"""Intersections over union are shapely's on boxes of every kind, and TrackEval's in an image.

shapely intersects polygons by their corners; ours integrates along edges. The two share nothing but
the boxes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import shapely
from numpy.testing import assert_allclose, assert_array_equal
from trackeval.datasets._base_dataset import _BaseDataset

from experiments.metrics import (
    bird_iou,
    box_iou,
    centre_similarity,
    image_coverage,
    image_iou,
    sequence_from_rows,
)

Boxes = np.ndarray[Any, np.dtype[np.float64]]
TOLERANCE = 1e-9
GRID = 1e-12
"""Of shapely's overlay [m]. Without one it gives boxes that touch a whole box in common, and boxes
that are equal but for rounding nothing."""
N = 40  # boxes on either side: 1600 pairs


def random_boxes(rng: np.random.Generator, n: int = N) -> Boxes:
    """Rows x, y, yaw, length, width from bicycles to trams, so close that many pairs overlap."""
    sizes = np.column_stack([rng.uniform(0.3, 20.0, n), rng.uniform(0.3, 4.0, n)])
    return np.column_stack([rng.uniform(-6.0, 6.0, (n, 2)), rng.uniform(-7.0, 7.0, n), sizes])


def polygons(boxes: Boxes, origin: Boxes) -> Any:
    """Corners relative to `origin`: far from it, shapely's own sums would lose digits."""
    along, across = np.array([1, 1, -1, -1]) / 2, np.array([-1, 1, 1, -1]) / 2
    x, y = boxes[:, 3, None] * along, boxes[:, 4, None] * across
    cos, sin = np.cos(boxes[:, 2, None]), np.sin(boxes[:, 2, None])
    place = boxes[:, :2] - origin
    corners = np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1) + place[:, None]
    return shapely.polygons(corners)


def intersections(a: Boxes, b: Boxes) -> Boxes:
    """Common areas (n, m) [m2]."""
    first, second = polygons(a, a[0, :2]), polygons(b, a[0, :2])
    common: Boxes = shapely.area(shapely.intersection(first[:, None], second[None], grid_size=GRID))
    return common


def iou(a: Boxes, b: Boxes) -> Boxes:
    common = intersections(a, b)
    union = np.prod(a[:, 3:], axis=1)[:, None] + np.prod(b[:, 3:], axis=1) - common
    return np.divide(common, union, out=np.zeros_like(common), where=union > 0.0)


def moved(boxes: Boxes, *, along: Any = 0.0, across: Any = 0.0, turn: Any = 0.0) -> Boxes:
    """Boxes shifted in their own frame and turned about their centres."""
    cos, sin = np.cos(boxes[:, 2]), np.sin(boxes[:, 2])
    result = boxes.copy()
    result[:, 0] += cos * along - sin * across
    result[:, 1] += sin * along + cos * across
    result[:, 2] += turn
    return result


@pytest.mark.parametrize("seed", range(10))
def test_random_boxes(seed: int) -> None:
    """16 000 pairs, a third or more of which overlap."""
    rng = np.random.default_rng(seed)
    a, b = random_boxes(rng), random_boxes(rng)
    expected = iou(a, b)
    assert (expected > 0.0).mean() > 1 / 3
    assert_allclose(bird_iou(a, b), expected, rtol=0, atol=TOLERANCE)


def touching(a: Boxes, rng: np.random.Generator) -> Boxes:
    """End to end, side to side and corner to corner."""
    kind = rng.integers(0, 3, len(a))
    along, across = np.where(kind != 1, a[:, 3], 0.0), np.where(kind != 0, a[:, 4], 0.0)
    return moved(a, along=along, across=across)


def contained(a: Boxes, rng: np.random.Generator) -> Boxes:
    """A quarter as large and inside, turned as far as fits."""
    b = moved(a, along=0.2 * a[:, 3], across=-0.2 * a[:, 4])
    b[:, 3:] /= 4.0
    return b


def almost(exponent: int) -> Any:
    def change(a: Boxes, rng: np.random.Generator) -> Boxes:
        b = a + 10.0**exponent * rng.normal(size=a.shape)
        b[:, 3:] = np.abs(b[:, 3:])
        return b

    return change


def turned(exponent: int) -> Any:
    def change(a: Boxes, rng: np.random.Generator) -> Boxes:
        return moved(a, turn=10.0**exponent * rng.choice([-1.0, 1.0], len(a)))

    return change


def thin(a: Boxes, rng: np.random.Generator) -> Boxes:
    """A thousandth as wide, across the middle."""
    b = moved(a, turn=rng.uniform(-np.pi, np.pi, len(a)))
    b[:, 4] /= 1000.0
    return b


HARD = {
    "identical": lambda a, rng: a.copy(),
    "touching": touching,
    "contained": contained,
    "thin": thin,
    "at a right angle": lambda a, rng: moved(a, turn=np.pi / 2),
    "opposite": lambda a, rng: moved(a, turn=np.pi),
    **{f"moved by 1e{k}": almost(k) for k in (-3, -8, -12, -15)},
    **{f"turned by 1e{k}": turned(k) for k in (-3, -8, -12, -16)},
}


@pytest.mark.parametrize("kind", HARD)
@pytest.mark.parametrize("upright", [False, True], ids=["rotated", "axis-aligned"])
def test_hard_boxes(kind: str, upright: bool) -> None:
    """Each of 240 boxes against its own hard counterpart and 39 others, both ways round."""
    rng = np.random.default_rng(len(kind))
    for _ in range(6):
        a = random_boxes(rng)
        if upright:
            a[:, 2] = rng.integers(-2, 3, N) * np.pi / 2
        b = HARD[kind](a, rng)
        assert_allclose(bird_iou(a, b), iou(a, b), rtol=0, atol=TOLERANCE)
        assert_allclose(bird_iou(b, a), bird_iou(a, b).T, rtol=0, atol=1e-12)


def test_exact_answers() -> None:
    """By hand, to the last bit: the same box, two halves, a quarter inside, end to end, apart."""
    box = [3.0, -2.0, 0.0, 4.0, 2.0]
    others = [
        box,
        [5.0, -2.0, 0.0, 4.0, 2.0],
        [3.0, -2.0, 0.0, 2.0, 1.0],
        [7.0, -2.0, 0.0, 4.0, 2.0],
        [3.0, 0.0, 0.0, 4.0, 2.0],
        [90.0, 0.0, 0.0, 4.0, 2.0],
    ]
    assert_array_equal(bird_iou([box], others), [[1.0, 1 / 3, 1 / 4, 0.0, 0.0, 0.0]])
    assert_array_equal(bird_iou(others, [box]).T, bird_iou([box], others))


def test_equal_boxes_have_exactly_one() -> None:
    """Whatever their yaw, place and size; so does a box in space."""
    rng = np.random.default_rng(3)
    a = random_boxes(rng, 300) * [1e5, 1e5, 1e3, 1.0, 1.0]
    assert_array_equal(np.diag(bird_iou(a, a)), 1.0)
    space = in_space(a, rng)
    assert_array_equal(np.diag(box_iou(space, space)), 1.0)


def test_centres_are_as_near_as_trackeval_says() -> None:
    """Near, just at 2 m, farther, and none at all."""
    rng = np.random.default_rng(4)
    a, b = rng.uniform(-3.0, 3.0, (N, 2)), rng.uniform(-3.0, 3.0, (N, 2))
    b[0], b[1] = a[0], a[0] + (0.0, 2.0)
    expected = _BaseDataset._calculate_euclidean_similarity(a, b, zero_distance=2.0)
    assert 0.2 < (expected > 0.0).mean() < 0.8
    assert_allclose(centre_similarity(a, b), expected, rtol=0.0, atol=1e-15)
    assert (centre_similarity(a, b)[0, :2] == (1.0, 0.0)).all()
    assert centre_similarity(a, b[:0]).shape == (N, 0)


def test_a_diamond_in_a_square() -> None:
    """Unit squares at 45 degrees share a regular octagon of area 2 sqrt(2) - 2."""
    octagon = 2.0 * np.sqrt(2.0) - 2.0
    found = bird_iou([[0.0, 0.0, 0.0, 1.0, 1.0]], [[0.0, 0.0, np.pi / 4, 1.0, 1.0]])
    assert_allclose(found, octagon / (2.0 - octagon), rtol=1e-15)


@pytest.mark.parametrize("empty", [(0.0, 2.0), (4.0, 0.0), (0.0, 0.0)])
def test_an_empty_box_shares_nothing(empty: tuple[float, float]) -> None:
    """A line or a point is similar to no box, not even to itself."""
    a, line = random_boxes(np.random.default_rng(0)), np.array([[0.0, 0.0, 0.3, *empty]])
    assert_array_equal(bird_iou(line, a), np.zeros((1, N)))
    assert_array_equal(bird_iou(a, line), np.zeros((N, 1)))
    assert_array_equal(bird_iou(line, line), [[0.0]])
    flat = np.array([[0.0, 0.0, 0.0, 0.3, 4.0, 2.0, 0.0]])
    assert_array_equal(box_iou(flat, flat), [[0.0]])


def test_far_from_the_origin() -> None:
    """At (1e6, -1e6) m the places are those of near boxes, on a grid that a float64 holds."""
    rng = np.random.default_rng(4)
    a, b = random_boxes(rng), random_boxes(rng)
    grid = 2.0**-20
    for boxes in (a, b):
        boxes[:, :2] = np.round(boxes[:, :2] / grid) * grid
    offset = np.array([1e6, -1e6, 0.0, 0.0, 0.0])
    assert_array_equal(bird_iou(a + offset, b + offset), bird_iou(a, b))
    assert_allclose(bird_iou(a + offset, b + offset), iou(a, b), rtol=0, atol=TOLERANCE)
    assert not bird_iou(a, b + offset).any()


@pytest.mark.parametrize("seed", range(5))
def test_invariance(seed: int) -> None:
    """A rigid motion of the plane, half a turn of a box, or a mirror changes nothing."""
    rng = np.random.default_rng(seed)
    a, b = random_boxes(rng), random_boxes(rng)
    before = bird_iou(a, b)
    assert before.min() >= 0.0
    assert before.max() <= 1.0

    def motion(boxes: Boxes, angle: float = rng.uniform(-3.0, 3.0)) -> Boxes:
        cos, sin = np.cos(angle), np.sin(angle)
        result = boxes.copy()
        result[:, :2] = boxes[:, :2] @ [[cos, sin], [-sin, cos]] + [30.0, -20.0]
        result[:, 2] += angle
        return result

    mirror = [1.0, -1.0, -1.0, 1.0, 1.0]
    swapped = moved(b, turn=np.pi / 2)[:, [0, 1, 2, 4, 3]]
    for first, second in (
        (motion(a), motion(b)),
        (a, moved(b, turn=np.pi)),
        (a, swapped),
        (a * mirror, b * mirror),
    ):
        assert_allclose(bird_iou(first, second), before, rtol=0, atol=1e-13)
    assert_allclose(bird_iou(b, a).T, before, rtol=0, atol=1e-13)


def in_space(boxes: Boxes, rng: np.random.Generator) -> Boxes:
    """Rows x, y, z, yaw, length, width, height."""
    z, height = rng.uniform(-1.0, 1.0, len(boxes)), rng.uniform(0.5, 4.0, len(boxes))
    return np.column_stack([boxes[:, :2], z, boxes[:, 2:], height])


@pytest.mark.parametrize("seed", range(5))
def test_boxes_in_space(seed: int) -> None:
    """shapely's common area times the common height, over the union of the volumes."""
    rng = np.random.default_rng(seed)
    ground_a, ground_b = random_boxes(rng), random_boxes(rng)
    a, b = in_space(ground_a, rng), in_space(ground_b, rng)
    top = np.minimum.outer(a[:, 2] + a[:, 6] / 2, b[:, 2] + b[:, 6] / 2)
    bottom = np.maximum.outer(a[:, 2] - a[:, 6] / 2, b[:, 2] - b[:, 6] / 2)
    common = intersections(ground_a, ground_b) * np.maximum(top - bottom, 0.0)
    volume_a, volume_b = np.prod(a[:, 4:], axis=1), np.prod(b[:, 4:], axis=1)
    expected = common / (volume_a[:, None] + volume_b - common)
    assert (expected > 0.0).mean() > 0.3
    assert_allclose(box_iou(a, b), expected, rtol=0, atol=TOLERANCE)
    assert_allclose(box_iou(b, a), box_iou(a, b).T, rtol=0, atol=1e-13)


def test_boxes_of_one_height_compare_as_on_the_ground() -> None:
    """Same z and height: the height cancels. One above the other: nothing in common."""
    rng = np.random.default_rng(6)
    a, b = random_boxes(rng), random_boxes(rng)

    def at(boxes: Boxes, z: float) -> Boxes:
        return np.insert(np.insert(boxes, 2, z, axis=1), 6, 1.5, axis=1)

    assert_allclose(box_iou(at(a, 0.7), at(b, 0.7)), bird_iou(a, b), rtol=0, atol=1e-14)
    assert not box_iou(at(a, 0.7), at(b, 2.2)).any()


def image_boxes(rng: np.random.Generator) -> Boxes:
    """Rows left, top, right, bottom on whole, quarter or any pixels; some empty or inverted."""
    corner, size = rng.uniform(-20.0, 600.0, (N, 2)), rng.uniform(0.0, 300.0, (N, 2))
    size[: N // 8] *= rng.choice([0.0, -1.0, 1e-9], size[: N // 8].shape)
    boxes = np.column_stack([corner, corner + size])
    step = rng.choice([0.0, 0.25, 1.0])
    return np.round(boxes / step) * step if step else boxes


@pytest.mark.parametrize("seed", range(20))
def test_image_boxes_are_trackevals_to_the_last_bit(seed: int) -> None:
    """Official scores depend on every digit where similarities tie; equal and empty boxes too."""
    rng = np.random.default_rng(seed)
    a = image_boxes(rng)
    b = np.concatenate([image_boxes(rng), a])
    theirs = _BaseDataset._calculate_box_ious
    assert_array_equal(image_iou(a, b), theirs(a, b, box_format="x0y0x1y1"))
    covered = theirs(a, b, box_format="x0y0x1y1", do_ioa=True)
    assert_array_equal(image_coverage(a, b), covered)
    assert (covered > image_iou(a, b)).any()


@pytest.mark.parametrize(
    ("similarity", "boxes", "matrix"),
    [("bird", lambda rng: random_boxes(rng), bird_iou),
     ("box", lambda rng: in_space(random_boxes(rng), rng), box_iou),
     ("image", image_boxes, image_iou)],
)  # fmt: skip
def test_a_sequence_has_the_matrices_of_its_frames(
    similarity: Any, boxes: Any, matrix: Any
) -> None:
    """Frames of different sizes, one without truth and one without tracks."""
    rng = np.random.default_rng(7)
    truth, track = boxes(rng), boxes(rng)
    truth_frame, track_frame = np.repeat([0, 1, 3], [5, 20, 15]), np.repeat([1, 2, 3], [25, 5, 10])
    built = sequence_from_rows(
        truth_frame, np.arange(N), truth, track_frame, np.arange(N), track, 4, similarity
    )
    for frame in range(4):
        expected = matrix(truth[truth_frame == frame], track[track_frame == frame])
        assert_array_equal(built.frame_similarity(frame), expected)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: bird_iou(np.zeros((2, 4)), []), r"a: boxes of shape \(2, 4\), expected \(n, 5\)"),
        (lambda: box_iou([], np.zeros(7)), r"b: boxes of shape \(7,\), expected \(n, 7\) for"),
        (lambda: bird_iou([], [[0, 0, 0, 1, -1]]), r"b: row 0 has width -1.0, expected a finite s"),
        (lambda: box_iou([[0, 0, 0, 0, 1, 1, np.inf]], []), r"a: row 0 has height inf, expected a"),
        (lambda: image_iou([[0, 0, np.nan, 1]], []), r"row 0 has right nan, expected a finite num"),
    ],
)
def test_boxes_that_do_not_fit_are_named(call: Any, message: str) -> None:
    """What was given, what was expected, and where."""
    with pytest.raises(ValueError, match=message):
        call()


def test_no_boxes() -> None:
    """Matrices without rows or columns."""
    assert bird_iou([], np.ones((3, 5))).shape == (0, 3)
    assert image_iou(np.ones((2, 4)), []).shape == (2, 0)
