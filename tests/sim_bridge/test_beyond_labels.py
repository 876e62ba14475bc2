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

FRAMES, FIRST, LAST = 160, 60, 99


def labels(trace: Trace) -> Trace:
    """The trace as if people had labelled it."""
    return replace(trace, provenance={**trace.provenance, "kinematics": "labels"})


def labelled_convoy(n: int = 300, visible: float = 1.0, seed: str = "0") -> Trace:
    """Cars that drive 30 to 50 m ahead of the sensor as it does, labelled in 40 frames."""
    heading = np.arctan2(-2.0, 5.0)
    distance, bearing = np.linspace(30.0, 50.0, n), heading + np.linspace(-0.6, 0.6, n)
    return labels(convoy(distance, bearing, visible, FRAMES, seed=seed).between(FIRST, LAST + 1))


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
    for seed in range(10):
        trace, labelled = with_unlabelled(labelled_convoy(), ("law", seed))
        counts += np.bincount(trace.frame[~labelled], minlength=FRAMES) / 3000
    for share, frames in (
        (BEFORE, FIRST - np.array([1, 5, 20, 45])),
        (AFTER, LAST + np.array([1, 5, 20, 45])),
    ):
        beyond = np.minimum(abs(frames - FIRST), abs(frames - LAST))
        expected = share * np.exp(-beyond * 0.1 / TIME)
        error = np.sqrt(expected * (1 - expected) / 3000)
        assert (np.abs(counts[frames] - expected) < 4 * error).all()
    farthest = round(LONGEST / 0.1)
    assert counts[FIRST - farthest - 1] == counts[LAST + farthest + 1] == 0.0


def test_labels_stay_what_they_are() -> None:
    """Every labelled row comes back with all its values, and nothing else is called a label."""
    labelled = labelled_convoy(40)
    joined, which = with_unlabelled(labelled, ("same",))
    assert len(joined) > len(labelled)
    assert joined.take(which) == labelled


def test_cars_go_on_as_they_did() -> None:
    """Those that kept their place by the sensor still do, 4 m/s slow ones too, with their size;
    standing ones stand."""
    moving = labelled_convoy(40)
    joined, _ = with_unlabelled(moving, ("place",))
    for identifier in range(0, 40, 7):
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
        y=moving.ego.y[80] - 12.0 + 5.0 * moving.object_id + rng.normal(0.0, 0.02, len(moving)),
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


def test_nothing_is_beyond_the_view() -> None:
    """Cars abreast of the sensor whose labels begin and end there do not go on."""
    heading = np.arctan2(-2.0, 5.0)
    side = convoy(20.0, heading + VIEW / 2 + np.linspace(0.01, 3.0, 100), 1.0, FRAMES)
    _, which = with_unlabelled(labels(side.between(FIRST, LAST + 1)), ("aside",))
    assert which.all()


def test_their_boxes_are_clutter_and_only_in_recorded_worlds() -> None:
    """The same cars: as labels they are reported before the first label too, by boxes of no
    source; as a simulated trace, never. The detector has no other clutter."""
    recorded = labelled_convoy(100)
    simulated = replace(recorded, provenance={})
    found = detect(recorded, without_clutter(), 3)
    beyond = found.source == CLUTTER
    assert beyond.sum() > 200
    assert found.frame[beyond].min() < FIRST - 10
    assert not np.any(beyond & (found.frame >= FIRST) & (found.frame <= LAST))
    assert of_unlabelled(recorded, found)[beyond].mean() > 0.98
    assert not of_unlabelled(recorded, found)[~beyond].any()
    assert found == detect(recorded, without_clutter(), 3)
    plain = detect(simulated, without_clutter(), 3)
    assert (plain.source != CLUTTER).all()
    assert plain.frame.min() >= FIRST
    assert plain.frame.max() <= LAST
