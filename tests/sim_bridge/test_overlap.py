"""Claim: two boxes overlap exactly where they have area in common."""

import numpy as np
import pytest

from mdkf.tables import FloatArray
from sim_bridge.overlap import first_overlap
from tests.sim_bridge.worlds import corners

Box = tuple[float, float, float, float, float]  # x, y [m], yaw [rad], length, width [m]
Corner = tuple[float, float]


def overlap(a: Box | FloatArray, b: Box | FloatArray) -> bool:
    """Whether two boxes of one frame are reported; the answer must not depend on their order."""
    found = [
        tuple(first_overlap(np.array([0, 2]), np.array(pair, dtype=float)))
        for pair in ([a, b], [b, a])
    ]
    assert found in ([(0, 1), (0, 1)], [(-1, -1), (-1, -1)])
    return found[0] == (0, 1)


def common_area(a: FloatArray, b: FloatArray) -> float:
    """Area of the intersection: box a clipped by every edge of box b (Sutherland and Hodgman)."""
    polygon = [complex(*corner) for corner in corners(a[None])[0]]
    edges = [complex(*corner) for corner in corners(b[None])[0]]
    for start, stop in zip(edges, edges[1:] + edges[:1], strict=True):

        def inside(p: complex, start: complex = start, stop: complex = stop) -> float:
            return ((stop - start).conjugate() * (p - start)).imag

        clipped = []
        for p, q in zip(polygon, polygon[1:] + polygon[:1], strict=True):
            here, there = inside(p), inside(q)
            if here >= 0:
                clipped.append(p)
            if here * there < 0:
                clipped.append(p + (q - p) * here / (here - there))
        polygon = clipped
    pairs = zip(polygon, polygon[1:] + polygon[:1], strict=True)
    return sum((p.conjugate() * q).imag for p, q in pairs) / 2


CAR: Box = (0.0, 0.0, 0.0, 4.0, 2.0)
DIAGONAL = np.pi / 4


@pytest.mark.parametrize(
    ("other", "expected"),
    [
        ((4.0, 0.0, 0.0, 4.0, 2.0), False),  # bumper to bumper
        ((0.0, 2.0 + 1e-9, 0.0, 4.0, 2.0), False),  # side by side
        ((4.0, 2.0, 0.0, 4.0, 2.0), False),  # corner to corner
        ((3.999, 0.0, 0.0, 4.0, 2.0), True),
        ((3.999, 1.999, 0.0, 4.0, 2.0), True),
        ((0.0, 0.0, np.pi / 2, 8.0, 0.5), True),  # crossing: no corner inside the other
        ((0.2, 0.1, 0.3, 1.0, 0.5), True),  # one within the other
        (CAR, True),
        # A square on its corner, half a diagonal sqrt(2) from the bumper at x = 2.
        ((2.0 + np.sqrt(2) - 1e-6, 0.0, DIAGONAL, 2.0, 2.0), True),
        ((2.0 + np.sqrt(2) + 1e-6, 0.0, DIAGONAL, 2.0, 2.0), False),
        # It faces the corner (2, 1) with its flat side: circles and upright boxes would meet.
        ((2.72, 1.72, DIAGONAL, 2.0, 2.0), False),
        ((2.70, 1.70, DIAGONAL, 2.0, 2.0), True),
        ((0.0, 100.0, 0.0, 4.0, 2.0), False),
    ],
)
def test_hand_made_pairs(other: Box, expected: bool) -> None:
    """Touching is no overlap, crossing is, and rotated corners are told to a micrometre."""
    assert overlap(CAR, other) is expected


def test_random_pairs_agree_with_clipping() -> None:
    """Reported exactly where the intersection has an area."""
    rng = np.random.default_rng(5)
    answers = []
    for _ in range(1500):
        a, b = np.column_stack(
            [rng.normal(0, 2.2, (2, 2)), rng.uniform(-4, 4, 2), rng.uniform(0.4, 6, (2, 2))]
        )
        area = common_area(a, b)
        if 0 < area < 1e-9:
            continue  # touching, to rounding
        assert overlap(a, b) == (area > 0), (a, b, area)
        answers.append(area > 0)
    assert 0.3 < np.mean(answers) < 0.7


def test_only_boxes_of_one_frame_meet() -> None:
    """The same place in another frame is no collision; the first pair is named by its rows."""
    far: Box = (50.0, 0.0, 0.0, 4.0, 2.0)
    apart = np.array([CAR, far, CAR, far])
    assert first_overlap(np.array([0, 2, 4]), apart) == (-1, -1)
    assert first_overlap(np.array([0, 3, 4]), apart) == (0, 2)
    assert first_overlap(np.array([0, 0, 1, 4]), np.array([CAR, CAR, far, far])) == (2, 3)


def test_an_empty_road_has_no_overlap() -> None:
    """Frames without boxes, and no frames at all."""
    assert first_overlap(np.array([0, 0, 0]), np.empty((0, 5))) == (-1, -1)
    assert first_overlap(np.array([0]), np.empty((0, 5))) == (-1, -1)


def test_exactly_touching_boxes_do_not_overlap() -> None:
    """Side by side and end to end, where not even rounding moves them apart."""
    for x, y in ((0.0, 2.0), (4.0, 0.0), (4.0, 2.0)):
        pair = np.array([[0.0, 0.0, 0.0, 4.0, 2.0], [x, y, 0.0, 4.0, 2.0]])
        assert first_overlap(np.array([0, 2]), pair) == (-1, -1)
