"""Claim: a wall hides what is behind it, and nobody detects, scores or counts it."""

import dataclasses

import numpy as np
import pytest

import scenarios
from experiments.gaps import Gaps
from experiments.occlusion import OcclusionProtocol
from experiments.population import population
from experiments.worlds.describe import describe
from experiments.worlds.figure import world_figure
from mdkf.tables import KINDS, Trace
from scenarios import ClosedFormScenario, Scenario, StaticBox
from sim_bridge import SeedRefused, SimulationError, check_inputs, detect, simulate
from tests.tables import tracks_of

WALL, TRUCK = KINDS.index("wall"), KINDS.index("truck")
NO_GAPS = Gaps(*np.empty((3, 0), dtype=np.int64))


def behind(*statics: StaticBox) -> Scenario:
    """A car that drives by 12 m to the left of a sensor at the origin, from x = -20 m to 40 m."""
    scenario = scenarios.load("constant_velocity")
    assert isinstance(scenario, ClosedFormScenario)
    return dataclasses.replace(scenario, statics=statics)


def box(kind: str, x: float = 5.0, y: float = 6.0) -> StaticBox:
    """8 m long and 4 m high, between sensor and car, or elsewhere."""
    return StaticBox(kind, x=x, y=y, yaw=0.0, length=8.0, width=0.5, height=4.0)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def trace() -> Trace:
    return simulate(behind(box("wall")), 0)


def as_truck(trace: Trace) -> Trace:
    """The same world to the bit, but that a truck stands in the wall's place."""
    kind = np.where(trace.kind == WALL, TRUCK, trace.kind)
    common = {"n_frames": trace.n_frames, "dt": trace.dt, "ego": trace.ego}
    return Trace.from_columns(
        {**trace.columns(), "kind": kind}, **common, provenance=trace.provenance
    )


def test_a_wall_hides_as_its_shadow_says(trace: Trace) -> None:
    """The car is wholly hidden while it is wholly in the wall's shadow, by two lines of sight, and
    in full view while it is wholly out of it."""
    car = trace.kind != WALL
    assert (trace.kind == WALL).sum() == trace.n_frames
    left = np.minimum(trace.x - 2.25, (trace.x - 2.25) * 12.9 / 11.1)[car] / 12.9
    right = np.maximum(trace.x + 2.25, (trace.x + 2.25) * 12.9 / 11.1)[car] / 12.9
    # The wall's silhouette goes from its far left corner's bearing to its near right corner's.
    begin, end = 1.0 / 6.25, 9.0 / 5.75
    inside, outside = (left > begin) & (right < end), (right < begin) | (left > end)
    assert inside.sum() > 5
    assert outside.sum() > 20
    assert (trace.visible[car][inside] == 0.0).all()
    assert (trace.visible[car][outside] == 1.0).all()


def test_a_wall_is_never_detected(trace: Trace) -> None:
    """A truck in its place is; every other detection is the same to the bit."""
    walled, trucked = detect(trace, seed=3), detect(as_truck(trace), seed=3)
    wall = int(trace.object_id[trace.kind == WALL][0])
    assert wall not in walled.source
    assert (trucked.source == wall).sum() > 50
    assert walled == trucked.take(trucked.source != wall)
    gaps = OcclusionProtocol("mid", 5, 5).gaps(walled)
    assert wall not in gaps.object_id


def test_a_wall_is_never_truth(trace: Trace) -> None:
    """Its rows do not count, and a track in its place is false; on a truck the track is right."""
    at = [(k, 7, 5.0, 6.0) for k in range(trace.n_frames)]
    tracks = tracks_of(at, trace.n_frames)
    kept = population(trace, tracks, NO_GAPS, "keep")
    walls = trace.kind == WALL
    assert not kept.truth[walls].any()
    assert kept.truth[~walls].any()
    assert kept.tracks.all()
    # Hidden truth is ignored, and the track on it too; hidden or not, a wall is not truth.
    unseen = dataclasses.replace(trace, visible=np.zeros(len(trace)))
    assert population(unseen, tracks, NO_GAPS, "keep").tracks.all()
    assert not population(as_truck(unseen), tracks, NO_GAPS, "keep").tracks.any()


def test_a_wall_is_no_part_of_a_description(trace: Trace) -> None:
    """Objects, regimes and occlusions are those of the trace without its rows."""
    assert describe(trace) == describe(trace.take(trace.kind != WALL))
    assert describe(trace).objects == {"car": 1}
    assert describe(as_truck(trace)).objects == {"car": 1, "truck": 1}


def test_the_picture_has_walls_in_their_own_colour(trace: Trace) -> None:
    """And says so in its legend; a world without walls has no such entry."""
    labels = []
    for world in (trace, as_truck(trace)):
        legend = world_figure(behind(box("wall")), world).axes[0].get_legend()
        assert legend is not None
        labels.append({text.get_text() for text in legend.get_texts()})
    assert "wall" in labels[0]
    assert "wall" not in labels[1]


def test_nobody_drives_through_a_wall() -> None:
    """A wall in the car's way refuses the seed."""
    with pytest.raises(SeedRefused, match=r"'car' and 'static 0' overlap"):
        simulate(behind(box("wall", y=12.0)), 0)


def test_boxes_that_stand_in_each_other_are_bad_input() -> None:
    """No seed would help, so none is asked for: the file and both entries are named."""
    scenario = behind(box("wall"), box("truck", x=30.0), box("wall", x=12.5))
    with pytest.raises(SimulationError, match=r"scenario\.yaml: statics\.0 and statics\.2 overlap"):
        simulate(scenario, 0)
    with pytest.raises(SimulationError, match=r"statics\.0 and statics\.2 overlap"):
        check_inputs(scenario)
    apart = behind(box("wall"), box("wall", x=13.0))
    assert len(simulate(apart, 0).ids()) == 3
