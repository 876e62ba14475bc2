"""Claims about paths through a road network: their geometry, speeds and conflicts."""

import numpy as np
import pytest
from highway_env.road.lane import CircularLane, StraightLane
from highway_env.road.road import RoadNetwork

from sim_bridge.highway_envs.paths import (
    BRAKING,
    CLEARANCE,
    LATERAL_ACCELERATION,
    MERGE,
    SPACING,
    Path,
    conflicts,
    path_along,
)


def network() -> RoadNetwork:
    """A road to the east that bends by 90 degrees to the right, and two roads that cross it."""
    net = RoadNetwork()
    net.add_lane("a", "b", StraightLane([0, 0], [100, 0]))
    net.add_lane("b", "c", CircularLane([100, 20], 20.0, -np.pi / 2, 0.0))
    net.add_lane("c", "d", StraightLane([120, 20], [120, 120]))
    net.add_lane("e", "f", StraightLane([50, -60], [50, 60]))
    net.add_lane("g", "h", StraightLane([120, 0], [120, 20]))
    return net


@pytest.fixture(scope="module")
def bend() -> Path:
    return path_along(network(), [("a", "b", 0), ("b", "c", 0), ("c", "d", 0)], approach=1)


def test_a_path_knows_its_course_and_curvature(bend: Path) -> None:
    """Samples are evenly spaced; course and curvature are those of line and circle."""
    steps = np.hypot(np.diff(bend.x), np.diff(bend.y))
    np.testing.assert_allclose(steps, SPACING, atol=1e-3)
    x, y, course, curvature, _ = bend.at(50.2)
    assert course == pytest.approx(0.0, abs=1e-9)
    assert curvature == pytest.approx(0.0, abs=1e-9)
    assert y == pytest.approx(0.0, abs=1e-9)
    assert x == pytest.approx(50.2, abs=3.0)
    middle = bend.at(100.0 + 5.0 * np.pi - 2.0)
    assert middle[3] == pytest.approx(1 / 20.0, rel=0.03)
    assert bend.course[-1] - bend.course[0] == pytest.approx(np.pi / 2, abs=1e-6)


def test_speeds_can_be_driven(bend: Path) -> None:
    """Lateral acceleration and braking stay within their limits, and straights allow any speed."""
    assert (bend.speed**2 * np.abs(bend.curvature) <= LATERAL_ACCELERATION + 1e-9).all()
    deceleration = -np.diff(bend.speed**2) / (2 * SPACING)
    assert deceleration.max() <= BRAKING + 1e-9
    assert bend.speed[-1] > 100.0


def test_the_line_is_before_the_end_of_the_approach(bend: Path) -> None:
    """The path is where its line says, a metre before the bend, and is not slower than asked."""
    x, y, *_ = bend.at(bend.line)
    assert (x, y) == (pytest.approx(99.0, abs=0.5), pytest.approx(0.0, abs=0.2))


def test_crossing_paths_conflict_within_the_clearance(bend: Path) -> None:
    """At a right angle: as long before as after the crossing, on both paths."""
    across = path_along(network(), [("e", "f", 0)])
    (conflict,) = conflicts(bend, across)
    assert not conflict.merges
    for path, stretch, of_place in ((bend, conflict.mine, 0), (across, conflict.theirs, 1)):
        begin, end = (path.at(place)[of_place] for place in stretch)
        centre = 50.0 if of_place == 0 else 0.0
        assert begin == pytest.approx(centre - CLEARANCE, abs=SPACING)
        assert end == pytest.approx(centre + CLEARANCE, abs=SPACING)
    (mirrored,) = conflicts(across, bend)
    assert mirrored.mine == pytest.approx(conflict.theirs, abs=SPACING)


def test_paths_that_become_one_merge(bend: Path) -> None:
    """The conflict is where they come together; before it and long after it there is none."""
    side = path_along(network(), [("g", "h", 0), ("c", "d", 0)])
    (conflict,) = conflicts(side, bend)
    assert conflict.merges
    assert conflict.mine[1] - conflict.mine[0] == MERGE
    x, y, *_ = side.at(conflict.mine[0])
    near = np.hypot(bend.x - x, bend.y - y).min()
    assert near == pytest.approx(CLEARANCE, abs=0.5)


def test_paths_from_one_start_do_not_conflict(bend: Path) -> None:
    """One follows the other."""
    short = path_along(network(), [("a", "b", 0)])
    assert conflicts(short, bend) == ()
