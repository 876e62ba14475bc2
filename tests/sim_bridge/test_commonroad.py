"""Claim: a CommonRoad file becomes a world whose derivatives are exact, and a bad one is refused in
one line."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import scenarios
import sim_bridge
from experiments.occlusion import OcclusionProtocol
from mdkf.tables import KINDS, Trace
from scenarios import ScenarioError
from tests.sim_bridge.commonroad_file import (
    ACCELERATION,
    EGO_SPEED,
    LENGTH,
    SPEED,
    STEP,
    WIDTH,
    document,
    obstacles,
    written,
)

BEGIN = 1.0
"""Of the recording, in the file's time: what smoothing needs before it [s]."""


@pytest.fixture(scope="module")
def trace(tmp_path_factory: pytest.TempPathFactory) -> Trace:
    path = written(tmp_path_factory.mktemp("commonroad"))
    return sim_bridge.simulate(scenarios.load(path), seed=0)


def _of(trace: Trace, kind: str) -> np.ndarray:
    return np.flatnonzero(trace.kind == KINDS.index(kind))


def test_uniform_motion_is_the_files_own(trace: Trace) -> None:
    """The sensor goes where the longest obstacle does, a walker walks: to rounding."""
    assert trace.provenance["source"] == "commonroad"
    assert trace.provenance["ego"] == "1"
    assert (trace.n_frames, trace.dt) == (100, 0.1)
    t = BEGIN + trace.ego.frame * trace.dt
    np.testing.assert_allclose(trace.ego.x, EGO_SPEED * t, atol=1e-9)
    np.testing.assert_allclose(trace.ego.y, 4.0, atol=1e-9)
    rows = _of(trace, "pedestrian")
    t = BEGIN + trace.frame[rows] * trace.dt
    assert len(rows) == trace.n_frames
    np.testing.assert_allclose(trace.y[rows], 6.0 + t, atol=1e-9)
    np.testing.assert_allclose(trace.vy[rows], 1.0, atol=1e-9)
    np.testing.assert_allclose(trace.length[rows], 0.7)
    np.testing.assert_allclose(trace.width[rows], 0.7)


def test_constant_acceleration_has_exact_derivatives(trace: Trace) -> None:
    """Between one second after its first state and one before its last, the truck's velocity and
    acceleration are the formula's; its place is within what 0.5 s between control points cost."""
    rows = _of(trace, "truck")
    t = BEGIN + trace.frame[rows] * trace.dt - 7 * STEP
    assert t.min() == pytest.approx(1.3)  # the first frame after a whole control point
    assert t.max() == pytest.approx(8.6, abs=0.35)
    # Samples between control points lie on chords: off by a h^2 / 8 with h = 0.1 s at most.
    chord = ACCELERATION * STEP**2 / 8
    offset = trace.x[rows] - (5.0 + SPEED * t + ACCELERATION / 2 * t**2)
    assert np.ptp(offset) <= 2 * chord
    assert np.abs(offset).max() < 0.1
    np.testing.assert_allclose(trace.vx[rows], SPEED + ACCELERATION * t, atol=1e-9)
    np.testing.assert_allclose(trace.ax[rows], ACCELERATION, atol=1e-9)
    np.testing.assert_allclose(trace.jx[rows], 0.0, atol=1e-8)
    names = np.array(["stationary", "constant_velocity", "constant_acceleration"])
    assert set(names[trace.regime[rows]]) == {"constant_acceleration"}


def test_what_never_moves_stands_and_what_is_short_is_left_out(trace: Trace) -> None:
    """The parked car has the file's pose and size in every frame; the bus of a second is not
    there."""
    rows = _of(trace, "car")
    assert len(rows) == trace.n_frames
    for name, value in {"x": 30.0, "y": -2.0, "yaw": 0.3, "length": LENGTH, "width": WIDTH}.items():
        np.testing.assert_array_equal(getattr(trace, name)[rows], value)
    assert not len(_of(trace, "bus"))
    assert not trace.vx[rows].any()


def test_the_sensor_may_be_on_another_obstacle(tmp_path: Path) -> None:
    """By the parameter `ego`; then the first is an object like all others."""
    path = written(tmp_path)
    other = sim_bridge.simulate(scenarios.load(path, ego=2), seed=0)
    assert other.provenance["ego"] == "2"
    assert other.n_frames == 80
    assert sorted({KINDS[kind] for kind in other.kind}) == ["bicycle", "car", "pedestrian", "wall"]
    assert scenarios.load(path, ego=2).identity() != scenarios.load(path).identity()


def test_both_versions_and_every_seed_give_the_same_world(tmp_path: Path, trace: Trace) -> None:
    """2018b calls obstacles otherwise."""
    text = document("".join(obstacles().values()), version="2018b")
    assert "<obstacle id=" in text
    older = sim_bridge.simulate(scenarios.load(written(tmp_path, text)), seed=5)
    assert older == trace


def test_a_step_that_does_not_divide_half_a_second(tmp_path: Path) -> None:
    """Recordings at 25 Hz: uniform motion stays exact."""
    path = written(tmp_path, document(obstacles(301)[1] + obstacles(301)[4], step=0.04))
    trace = sim_bridge.simulate(scenarios.load(path), seed=0)
    t = BEGIN + trace.ego.frame * trace.dt
    np.testing.assert_allclose(trace.ego.x, EGO_SPEED * STEP / 0.04 * t, atol=1e-9)
    np.testing.assert_allclose(trace.vy, STEP / 0.04, atol=1e-9)


def test_it_goes_through_the_whole_flow(trace: Trace) -> None:
    """Objects are detected, hidden by the protocol and by each other."""
    seen = sim_bridge.detect(trace, seed=1)
    hidden = OcclusionProtocol("mid", 20, 35).apply(seen)
    assert 0 < len(hidden) < len(seen)
    behind = trace.visible[_of(trace, "bicycle")]
    assert behind.min() == 0.0
    assert behind.max() > 0.0


def test_what_is_in_the_same_place_is_left_out(tmp_path: Path, trace: Trace) -> None:
    """Of two boxes that overlap the first stays; how many have gone is told."""
    again = obstacles()[3].replace('id="3"', 'id="33"')
    text = document("".join(obstacles().values()) + again)
    both = sim_bridge.simulate(scenarios.load(written(tmp_path, text)), seed=0)
    assert (both.provenance["left_out"], trace.provenance["left_out"]) == ("1", "0")
    assert both == trace


Change = Callable[[str], str]


def _swap(old: str, new: str) -> Change:
    def change(text: str) -> str:
        assert old in text
        return text.replace(old, new, 1)

    return change


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        (_swap("2020a", "1999x"), ("commonRoadVersion '1999x'", "2018b or 2020a")),
        (_swap('timeStepSize="0.1"', 'timeStepSize="-1"'), ("timeStepSize is '-1'",)),
        (_swap('timeStepSize="0.1"', ""), ("timeStepSize is missing",)),
        (_swap("<x>0.0</x>", "<x>1e999</x>"), ("obstacle 1, time step 0: position/point/x",)),
        (_swap("<x>0.0</x>", "<x>nan</x>"), ("obstacle 1", "position/point/x is 'nan'")),
        (_swap("<x>0.0</x>", ""), ("obstacle 1", "position/point/x is missing")),
        (_swap("<time><exact>3</exact>", "<time><exact>4</exact>"), ("time step 4, expected 3",)),
        (_swap("<time><exact>3</exact>", "<time><exact>3.5</exact>"), ("time/exact is 3.5",)),
        (_swap("<length>4.5</length>", "<length>0</length>"), ("obstacle 1: length is '0'",)),
        (
            _swap("<width>1.8</width>", "<width>1.8</width><orientation>0.1</orientation>"),
            ("obstacle 1", "orientation 0.1, expected 0"),
        ),
        (_swap("rectangle><length", "polygon><length"), ("not well-formed",)),
        (_swap("<type>car</type>", "<type>ufo</type>"), ("obstacle 1", "type 'ufo'")),
        (_swap('id="2"', 'id="1"'), ("obstacle 1 is there twice",)),
        (_swap('id="2"', 'id="two"'), ("obstacle two", "digits")),
        (_swap("<commonRoad ", "<net "), ("not well-formed",)),
        (_swap("<commonRoad", '<!DOCTYPE x [<!ENTITY a "b">]><commonRoad'), ("DOCTYPE",)),
        (lambda text: text[: len(text) // 2], ("not well-formed",)),
        (lambda text: document(""), ("dynamic obstacle that can carry the sensor",)),
        (lambda text: document(obstacles()[5]), ("obstacle 5", "span 1 s", "at least 3 s")),
    ],
)
def test_a_bad_file_is_refused(tmp_path: Path, change: Change, parts: tuple[str, ...]) -> None:
    """One line that names file, obstacle and what was expected."""
    path = written(tmp_path)
    path.write_text(change(path.read_text()))
    with pytest.raises(ScenarioError) as refused:
        scenarios.load(path)
    assert "\n" not in str(refused.value)
    for part in (str(path), *parts):
        assert part in str(refused.value)


def test_unknown_parameters_and_obstacles_are_refused(tmp_path: Path) -> None:
    """The pedestrian cannot carry the sensor, the parked car does not move, 9 is not there."""
    path = written(tmp_path)
    for ego in (3, 4, 9):
        with pytest.raises(ScenarioError, match=rf"no vehicle {ego} moves; known: 1, 2"):
            scenarios.load(path, ego=ego)
    with pytest.raises(ScenarioError, match="unknown parameter 'speed'"):
        scenarios.load(path, speed=3)
