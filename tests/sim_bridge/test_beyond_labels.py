"""Claim: in recorded worlds the detector sees cars before and after their labels, as often and as
long as the law says, where they would be; in simulated worlds there is nothing beyond the truth.
"""

from dataclasses import replace

import numpy as np
import pytest

from mdkf.tables import CLUTTER, Trace
from sim_bridge import Profile, detect, load_profile
from sim_bridge.beyond_labels import (
    AFTER,
    BEFORE,
    LONGEST,
    TIME,
    of_unlabelled,
    with_unlabelled,
)
from sim_bridge.kitti import VIEW
from tests.sim_bridge.worlds import convoy

FRAMES, FIRST, LAST, CARS = 160, 60, 99, 30


def labels(trace: Trace) -> Trace:
    """The trace as if people had labelled it."""
    return replace(trace, provenance={**trace.provenance, "kinematics": "labels"})


def labelled_convoy(visible: float = 1.0) -> Trace:
    """`CARS` cars that drive 30 to 54 m ahead of the sensor as it does, 6 m and more apart,
    labelled in 40 frames."""
    heading = np.arctan2(-2.0, 5.0)
    distance, bearing = np.meshgrid(np.linspace(30.0, 54.0, 5), np.linspace(-0.6, 0.6, 6))
    cars = convoy(distance.ravel(), heading + bearing.ravel(), visible, FRAMES)
    return labels(cars.between(FIRST, LAST + 1))


def without_clutter() -> Profile:
    """A detector whose boxes are all of cars."""
    profile = load_profile("pointrcnn")
    none = {
        kind: getattr(profile.clutter, kind).model_copy(update={"density": 0.0})
        for kind in ("flashes", "ghosts")
    }
    return profile.model_copy(update={"clutter": profile.clutter.model_copy(update=none)})


def test_cars_are_beyond_their_labels_as_often_as_the_law_says() -> None:
    """Of 3000 cars, k frames before the first label share exp(-k dt / TIME) up to LONGEST, and of
    the last alike; four standard errors at most apart."""
    counts = np.zeros(FRAMES)
    for seed in range(100):
        trace, labelled = with_unlabelled(labelled_convoy(), ("law", seed))
        counts += np.bincount(trace.frame[~labelled], minlength=FRAMES) / (100 * CARS)
    for share, frames in (
        (BEFORE, FIRST - np.array([1, 5, 20, 45])),
        (AFTER, LAST + np.array([1, 5, 20, 45])),
    ):
        beyond = np.minimum(abs(frames - FIRST), abs(frames - LAST))
        expected = share * np.exp(-beyond * 0.1 / TIME)
        error = np.sqrt(expected * (1 - expected) / (100 * CARS))
        assert (np.abs(counts[frames] - expected) < 4 * error).all()
    farthest = round(LONGEST / 0.1)
    assert counts[FIRST - farthest - 1] == counts[LAST + farthest + 1] == 0.0


def test_labels_stay_what_they_are() -> None:
    """Every labelled row comes back with all its values, and nothing else is called a label."""
    labelled = labelled_convoy()
    joined, which = with_unlabelled(labelled, ("same",))
    assert len(joined) > len(labelled)
    assert joined.take(which) == labelled


def test_cars_go_on_as_they_did() -> None:
    """Those that kept their place by the sensor still do, with their size; standing ones stand."""
    moving = labelled_convoy()
    joined, _ = with_unlabelled(moving, ("place",))
    for identifier in range(0, CARS, 7):
        rows = joined.rows_of(identifier)
        ego = joined.ego
        for axis, own in (("x", ego.x), ("y", ego.y)):
            ahead = getattr(joined, axis)[rows] - own[joined.frame[rows]]
            np.testing.assert_allclose(ahead, ahead[0], atol=1e-9)
        assert np.unique(joined.length[rows]).size == 1
    rng = np.random.default_rng(0)
    still = replace(
        moving,
        x=moving.ego.x[80] + 40.0 + rng.normal(0.0, 0.02, len(moving)),
        y=moving.ego.y[80] - 60.0 + 5.0 * moving.object_id + rng.normal(0.0, 0.02, len(moving)),
    )
    joined, which = with_unlabelled(still, ("still",))
    assert not which.all()
    spread = np.abs(joined.x - still.ego.x[80] - 40.0)
    assert spread.max() < 0.1


def test_cars_are_no_more_visible_than_at_their_labels_end() -> None:
    """Nor than the line of sight lets them be: one behind another is hidden."""
    joined, which = with_unlabelled(labelled_convoy(visible=0.3), ("seen",))
    assert joined.visible[~which].max() <= 0.3
    heading = np.arctan2(-2.0, 5.0)
    column = convoy([20.0, 27.0], heading, 1.0, FRAMES)
    turned = replace(column, yaw=np.full(len(column), heading))
    behind = turned.object_id == 1
    late = labels(turned.take(~behind | (turned.frame >= FIRST)))
    for seed in range(20):
        joined, which = with_unlabelled(late, ("hidden", seed))
        beyond = ~which & (joined.object_id == 1)
        if beyond.any():
            assert joined.visible[beyond].max() < 0.2
            return
    pytest.fail("no car beyond its labels in 20 draws")


def test_cars_do_not_drive_into_others() -> None:
    """One that would come through another that stands is there only as far back as to it."""
    ahead = np.arctan2(-2.0, 5.0)
    both = convoy([20.0, 120.0], ahead, 1.0, FRAMES)
    first = both.object_id == 0
    # The nearer car is labelled throughout and stands 8 m behind where the other is at FIRST.
    still = (both.frame == FIRST) & ~first
    x, y = float(both.x[still][0]), float(both.y[still][0])
    parked = replace(
        both,
        x=np.where(first, x - 8.0 * np.cos(ahead), both.x),
        y=np.where(first, y - 8.0 * np.sin(ahead), both.y),
        yaw=np.full(len(both), ahead),
    )
    world = labels(parked.take(first | (both.frame >= FIRST)))
    reached = 0
    for seed in range(30):
        joined, which = with_unlabelled(world, ("drive", seed))
        mine = ~which & (joined.object_id == 1)
        gaps = np.hypot(joined.x[mine] - x, joined.y[mine] - y)
        reached = max(reached, int(mine.sum()))
        # 4.5 m long both: they touch after 3.5 m.
        assert gaps.max(initial=0.0) <= 3.5
    assert reached == int(3.5 / (np.hypot(5.0, 2.0) * 0.1))


def test_nothing_is_beyond_the_view() -> None:
    """Cars abreast of the sensor whose labels begin and end there do not go on."""
    heading = np.arctan2(-2.0, 5.0)
    side = convoy(20.0, heading + VIEW / 2 + np.linspace(0.01, 3.0, 100), 1.0, FRAMES)
    _, which = with_unlabelled(labels(side.between(FIRST, LAST + 1)), ("aside",))
    assert which.all()


def test_their_boxes_are_clutter_and_only_in_recorded_worlds() -> None:
    """The same cars: as labels they are reported before the first label too, by boxes of no
    source; as a simulated trace, never. The detector has no other clutter."""
    recorded = labelled_convoy()
    simulated = replace(recorded, provenance={})
    found = detect(recorded, without_clutter(), 3)
    beyond = found.source == CLUTTER
    assert beyond.sum() > 100
    assert found.frame[beyond].min() < FIRST - 10
    assert not np.any(beyond & (found.frame >= FIRST) & (found.frame <= LAST))
    assert of_unlabelled(recorded, found)[beyond].mean() > 0.98
    assert not of_unlabelled(recorded, found)[~beyond].any()
    assert found == detect(recorded, without_clutter(), 3)
    plain = detect(simulated, without_clutter(), 3)
    assert (plain.source != CLUTTER).all()
    assert plain.frame.min() >= FIRST
    assert plain.frame.max() <= LAST
