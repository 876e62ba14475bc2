"""Claim: in highway-env's scenes people do what the scenes are about: give way, overtake, hide.

Everything is read from the traces; the frame is right-handed, so eastbound traffic is south.
"""

from collections.abc import Iterator

import numpy as np
import pytest

from mdkf.tables import KINDS, REGIMES, BoolArray, FloatArray, IntArray, Trace
from sim_bridge.line_of_sight import visible_fractions
from tests.sim_bridge.worlds import world

STILL = REGIMES.index("stationary")
SEEN = 0.15  # of an object; what is scored


def lives(trace: Trace) -> Iterator[IntArray]:
    """The rows of every object, in order of frames."""
    for identity in trace.ids():
        rows = np.flatnonzero(trace.object_id == identity)
        yield rows[np.argsort(trace.frame[rows])]


def speed_of(trace: Trace) -> FloatArray:
    return np.hypot(trace.vx, trace.vy)


def waits_for_somebody(
    trace: Trace, where: BoolArray, crossing: BoolArray, near: float
) -> list[tuple[int, int]]:
    """Pairs of objects: one stands at `where`, and the other passes `crossing` before its eyes, at
    most `near` metres off; afterwards the first one drives on."""
    found = []
    for rows in lives(trace):
        standing = rows[(trace.regime[rows] == STILL) & where[rows]]
        if not len(standing) or trace.regime[rows[-1]] == STILL:
            continue
        at = standing[-1]
        there = np.isin(trace.frame, trace.frame[standing]) & crossing
        close = np.hypot(trace.x - trace.x[at], trace.y - trace.y[at]) < near
        bearing = np.arctan2(trace.y - trace.y[at], trace.x - trace.x[at]) - trace.yaw[at]
        passing = there & close & (np.cos(bearing) > 0.5)
        found += [(int(trace.object_id[at]), int(o)) for o in np.unique(trace.object_id[passing])]
    return found


def test_who_enters_the_roundabout_waits_for_who_is_in_it() -> None:
    """Somebody stands before the ring while another passes in it; nobody ever stands in the ring;
    the ego car goes more than half round."""
    trace = world("small_roundabout")
    radius = np.hypot(trace.x, trace.y)
    ring = (radius > 18.0) & (radius < 21.5)
    inwards = trace.x * np.cos(trace.yaw) + trace.y * np.sin(trace.yaw) < 0.0
    waiting = waits_for_somebody(trace, (radius > 24.0) & (radius < 40.0) & inwards, ring, 20.0)
    assert waiting
    assert not (ring & (trace.regime == STILL)).any()
    inside = np.hypot(trace.ego.x, trace.ego.y) < 22.0
    angle = np.unwrap(np.arctan2(trace.ego.y[inside], trace.ego.x[inside]))
    assert angle[-1] - angle[0] > np.pi


def test_the_minor_road_waits_for_the_major_one() -> None:
    """Somebody stands at the line of the minor road while another crosses on the major one, and
    crosses after him; others turn left and right."""
    trace = world("intersection")
    minor = (np.abs(trace.x) < 4.0) & (np.abs(trace.y) > 9.0) & (np.abs(trace.y) < 20.0)
    major = (np.abs(trace.y) < 4.0) & (np.abs(trace.x) < 12.0) & (speed_of(trace) > 3.0)
    major &= np.abs(np.cos(trace.yaw)) > 0.9
    assert waits_for_somebody(trace, minor, major, 25.0)
    turns = [np.unwrap(trace.yaw[rows])[[0, -1]] for rows in lives(trace)]
    turned = np.array([last - first for first, last in turns])
    assert (np.abs(turned - np.pi / 2) < 0.1).any()
    assert (np.abs(turned + np.pi / 2) < 0.1).any()
    assert (np.abs(turned) < 0.1).any()


def test_slow_ones_are_overtaken_through_the_oncoming_lane() -> None:
    """Cars leave their lane behind a slower one, come back before him, and meanwhile nobody who
    comes the other way gets close."""
    trace = world("overtaking")
    east, west = -4.0, 0.0
    moving = speed_of(trace) > 0.0
    same_way, oncoming = moving & (trace.vx > 0.0), moving & (trace.vx < 0.0)
    assert oncoming.any()
    overtaken = 0
    for rows in lives(trace):
        out = rows[same_way[rows] & (np.abs(trace.y[rows] - west) < 0.5)]
        for row in out:
            ahead = oncoming & (trace.frame == trace.frame[row]) & (trace.x > trace.x[row])
            assert (trace.x[ahead] - trace.x[row] > 40.0).all()
        begins, ends = (np.abs(trace.y[rows[k]] - east) < 0.2 for k in (0, -1))
        if not (len(out) and begins and ends):
            continue
        frame = np.intersect1d(trace.frame[rows], trace.frame[out])
        before, after = int(frame[0]), int(frame[-1])
        mine = {int(trace.frame[row]): float(trace.x[row]) for row in rows}
        for other in lives(trace):
            theirs = {int(trace.frame[row]): float(trace.x[row]) for row in other}
            if before in theirs and after in theirs and same_way[other].any():
                was, is_ahead = mine[before] < theirs[before], mine[after] > theirs[after]
                overtaken += was and is_ahead
    assert overtaken >= 1
    assert {KINDS.index("truck"), KINDS.index("bicycle")} & set(trace.kind[same_way].tolist())


@pytest.fixture(scope="module")
def street() -> Trace:
    return world("parked_truck")


def lorry_of(trace: Trace) -> int:
    """The long lorry that never moves."""
    never = [rows[0] for rows in lives(trace) if (trace.regime[rows] == STILL).all()]
    (lorry,) = (int(trace.object_id[row]) for row in never if trace.length[row] == 12.0)
    return lorry


def test_parked_cars_are_hidden_between_two_views_of_them(street: Trace) -> None:
    """Many are seen, hidden and seen again; one at least by the lorry alone: without it, it would
    have been seen all the time."""
    kept = street.object_id != lorry_of(street)
    box = ("x", "y", "z", "yaw", "length", "width", "height")
    boxes = np.column_stack([getattr(street, name) for name in box])[kept]
    sensor = np.column_stack([street.ego.x, street.ego.y, street.ego.z])
    start = np.searchsorted(street.frame[kept], np.arange(street.n_frames + 1))
    without = np.zeros(len(street))
    without[kept] = visible_fractions(sensor, start, boxes)
    by_any, by_the_lorry = 0, 0
    for rows in lives(street):
        if (street.regime[rows] == STILL).all():
            seen, would_be = street.visible[rows] >= SEEN, without[rows] >= SEEN
            views = np.flatnonzero(seen)
            gaps = [k for k in np.flatnonzero(~seen) if len(views) and views[0] < k < views[-1]]
            by_any += len(gaps) > 0
            by_the_lorry += any(would_be[k] for k in gaps)
    assert by_any >= 10
    assert by_the_lorry >= 1


def test_a_car_pulls_out_and_the_lorry_is_passed(street: Trace) -> None:
    """A car that stood at the kerb drives in a lane later, and somebody gets round the lorry."""
    lorry = street.object_id == lorry_of(street)
    x, y = float(street.x[lorry][0]), float(street.y[lorry][0])
    pulled_out = passed = False
    for rows in lives(street):
        aside = np.abs(street.y[rows] - np.where(street.y[rows] > -2.0, 0.0, -4.0))
        stood = (street.regime[rows[0]] == STILL) & (aside[0] > 3.0)
        pulled_out |= bool(stood and aside[-1] < 0.3 and street.regime[rows[-1]] != STILL)
        beside = np.abs(street.x[rows] - x) < 3.0
        past = beside & (street.vx[rows] > 1.0)
        passed |= bool(past.any() and (street.y[rows][past] - y > 2.5).all())
    assert pulled_out
    assert passed
