"""Claim: walkers go where their paths say, smoothly and exactly, and are part of the world.

Times of arrival are by hand: a walk of D metres at v takes D / v + T. The time T of a change of
speed v B(t / T), with B' = 140 u^3 (1 - u)^3, is 35/16 v / a where the acceleration is at its
bound a = 1 m/s2, in the middle, and sqrt(84/sqrt(125) v / j) where the jerk is at j = 2 m/s3.
"""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import scenarios
import sim_bridge
from mdkf import KINDS, REGIMES, Trace
from mdkf.tables import FloatArray
from scenarios import Pause, Scenario, ScenarioError, Walker
from sim_bridge import SeedRefused
from tests.sim_bridge.worlds import assert_velocity_acceleration_and_jerk

ALONE = scenarios.load("stationary", x=200.0, y=200.0)
LINE = ((5.0, 20.0), (15.0, 20.0))
BENT = ((5.0, 20.0), (15.0, 20.0), (15.0, 26.0), (12.0, 22.0))  # 10 m, left, 6 m, and back, 5 m


def with_walkers(*walkers: Walker, scenario: Scenario = ALONE, duration: float = 40.0) -> Scenario:
    return dataclasses.replace(scenario, walkers=walkers, duration=duration)


def pedestrians(trace: Trace) -> list[Trace]:
    """The trace of each pedestrian alone."""
    walking = np.unique(trace.object_id[trace.kind == KINDS.index("pedestrian")])
    return [trace.take(trace.rows_of(int(identifier))) for identifier in walking]


def walk(walker: Walker, seed: int = 0, dt: float = 0.01) -> Trace:
    """One walker's rows."""
    (own,) = pedestrians(sim_bridge.simulate(with_walkers(walker), seed, dt))
    return own


def speed_of(trace: Trace) -> FloatArray:
    return np.hypot(trace.vx, trace.vy)


def moving_times(trace: Trace) -> list[tuple[float, float]]:
    """Beginnings and ends of all stretches of motion [s], to a frame."""
    moves = np.concatenate([[0], (speed_of(trace) > 0).astype(int), [0]])
    edges = np.flatnonzero(np.diff(moves)) * trace.dt
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


@pytest.mark.parametrize(
    ("length", "speed", "seconds"),
    [
        (10.0, 1.4, 10 / 1.4 + 3.0625),
        (60.0, 2.0, 30 + 4.375),
        # Too slow to need all of the acceleration.
        (10.0, 0.5, 20 + np.sqrt(21 / np.sqrt(125))),
        # Too short for the speed: D = v T = 16/35 a T^2 ...
        (2.0, 1.4, 2 * np.sqrt(2 * 35 / 16)),
        # ... and for the acceleration: D = v T = sqrt(125)/84 j T^3.
        (0.2, 1.4, 2 * np.cbrt(0.2 * 84 / np.sqrt(125) / 2)),
    ],
)
@pytest.mark.parametrize("angle", [0.0, 2.2, -1.0])
def test_a_straight_walk_takes_as_long_as_by_hand(
    length: float, speed: float, seconds: float, angle: float
) -> None:
    """It stands at its start, walks from rest to rest within its bounds, of which it reaches one,
    and stands at its end."""
    goal = (5.0 + length * np.cos(angle), 20.0 + length * np.sin(angle))
    own = walk(Walker(((5.0, 20.0), goal), speed, start=3.0))
    ((begin, end),) = moving_times(own)
    assert begin == pytest.approx(3.0, abs=0.011)
    assert end == pytest.approx(3.0 + seconds, abs=0.011)
    along = (own.x - 5.0) * np.cos(angle) + (own.y - 20.0) * np.sin(angle)
    across = (own.y - 20.0) * np.cos(angle) - (own.x - 5.0) * np.sin(angle)
    np.testing.assert_allclose(across, 0.0, atol=1e-9)
    times = own.frame * own.dt
    assert (along[times <= 3.0] == 0.0).all()
    np.testing.assert_allclose(along[times >= 3.0 + seconds], length, atol=1e-9)
    assert (np.diff(along) >= 0.0).all()
    assert speed_of(own).max() <= speed + 1e-12
    acceleration, jerk = np.hypot(own.ax, own.ay).max(), np.hypot(own.jx, own.jy).max()
    assert acceleration <= 1.0 + 1e-12
    assert jerk <= 2.0 + 1e-12
    assert max(acceleration, jerk / 2.0) == pytest.approx(1.0, abs=1e-3)
    np.testing.assert_allclose(np.cos(own.yaw - angle), 1.0, atol=1e-12)
    stands = (times < 3.0) | (times > 3.0 + seconds)
    assert (own.regime[stands] == REGIMES.index("stationary")).all()


def test_a_walk_that_began_before_the_recording() -> None:
    """It is where it would be: 5 s under way, at full speed since the fourth of them."""
    own = walk(Walker(((0.0, 20.0), (30.0, 20.0)), 1.4, start=-5.0))
    np.testing.assert_allclose(own.x[0], 1.4 * (5.0 - 3.0625 / 2), atol=1e-12)
    np.testing.assert_allclose(own.vx[0], 1.4, atol=1e-12)


def test_corners_are_turned_at_rest() -> None:
    """Every leg from corner to corner, on its line; in between a second of standing and turning, by
    the shorter way, the yaw rate being the yaw's derivative."""
    own = walk(Walker(BENT, 1.25, start=1.0))
    lost = 1.25 * 35 / 16
    legs = [10.0 / 1.25 + lost, 6.0 / 1.25 + lost, 5.0 / 1.25 + lost]
    begins = np.cumsum([1.0, legs[0] + 1.0, legs[1] + 1.0])
    for found, begin, lasts in zip(moving_times(own), begins, legs, strict=True):
        assert found == pytest.approx((begin, begin + lasts), abs=0.011)
    times, place = own.frame * own.dt, own.x + 1j * own.y
    corners = [complex(*point) for point in BENT]
    for a, b, begin, lasts in zip(corners[:-1], corners[1:], begins, legs, strict=True):
        walking = (times > begin) & (times < begin + lasts)
        offset = (place[walking] - a) / (b - a)
        np.testing.assert_allclose(offset.imag, 0.0, atol=1e-12)
        assert ((offset.real >= 0) & (offset.real <= 1)).all()
        heading = np.exp(1j * own.yaw[walking]) / ((b - a) / abs(b - a))
        np.testing.assert_allclose(heading, 1.0, atol=1e-12)
    assert place[-1] == pytest.approx(corners[-1], abs=1e-9)
    yaw = np.unwrap(own.yaw)
    slope = (yaw[2:] - yaw[:-2]) / (2 * own.dt)
    np.testing.assert_allclose(slope, own.yaw_rate[1:-1], atol=2e-2)
    assert yaw[-1] == pytest.approx(np.pi / 2 + np.pi - np.arctan(0.75), abs=1e-12)
    assert (speed_of(own)[own.yaw_rate != 0] == 0).all()


def test_pauses_are_stood_through() -> None:
    """After 4 m for 2.5 s, and at the very corner for 3 s besides the turn."""
    pauses = (Pause(4.0, 2.5), Pause(10.0, 3.0))
    own = walk(Walker(BENT[:3], 1.0, pauses=pauses))
    lost = 35 / 16
    lasting = [4.0 + lost, 6.0 + lost, 6.0 + lost]
    begins = np.cumsum([0.0, lasting[0] + 2.5, lasting[1] + 3.0 + 1.0])
    for found, begin, lasts in zip(moving_times(own), begins, lasting, strict=True):
        assert found == pytest.approx((begin, begin + lasts), abs=0.011)
    resting = (own.frame * own.dt > 6.2) & (own.frame * own.dt < 8.6)
    assert (own.x[resting] == 9.0).all()


@pytest.mark.parametrize("path", [LINE, BENT])
def test_columns_are_derivatives_of_the_path(path: tuple[tuple[float, float], ...]) -> None:
    """Everywhere, the beginnings and ends of every change of speed included, and on a walk of only
    0.2 m: first, second and third central differences of 100 Hz positions are v, a and j."""
    pauses = (Pause(3.0, 1.0), Pause(3.2, 1.0))
    assert_velocity_acceleration_and_jerk(walk(Walker(path, 1.3, start=0.7, pauses=pauses)))


def test_frames_lie_on_one_curve() -> None:
    """At 100 Hz and at 10 Hz: the same numbers, bit for bit."""
    walker = Walker(BENT, 1.3, 0.2, 2.0, 1.0, (Pause(3.0, 1.0, 0.5),))
    fine, coarse = walk(walker, seed=4), walk(walker, seed=4, dt=0.1)
    for column in ("x", "y", "yaw", "vx", "ay", "jx", "yaw_rate"):
        assert np.array_equal(getattr(coarse, column), getattr(fine, column)[::10])


def test_seeds_change_what_has_a_spread_and_nothing_else() -> None:
    """Speed, start and pause, each within its spread; without spreads every seed is the same."""
    fixed = Walker(LINE, 1.4, start=3.0)
    assert walk(fixed, 1) == walk(fixed, 2)
    loose = Walker(LINE, 1.4, 0.3, 3.0, 2.0, (Pause(5.0, 4.0, 1.0),))
    drawn = []
    for seed in range(12):
        own = walk(loose, seed)
        (begin, stop), (resume, _) = moving_times(own)
        drawn.append((speed_of(own).max(), begin, resume - stop))
    assert walk(loose, 3) == walk(loose, 3)
    values = np.array(drawn)
    low, high = np.array([1.1, 1.0, 3.0]), np.array([1.7, 5.0, 5.0])
    assert ((values >= low - 0.011) & (values <= high + 0.011)).all()
    assert (np.ptp(values, axis=0) > 0.5 * (high - low)).all()


def test_a_walkers_draws_are_its_own() -> None:
    """One more walker changes no number of the first one, nor of the cars."""
    first = Walker(LINE, 1.4, 0.3, 3.0, 2.0)
    second = Walker(((-20.0, -9.0), (-10.0, -9.0)), 1.2, 0.1, 1.0, 1.0)
    alone, both = (
        sim_bridge.simulate(with_walkers(*walkers), 5) for walkers in ((first,), (first, second))
    )
    kept = both.take(both.object_id < 2)
    assert kept == alone
    assert [KINDS[kind] for kind in both.kind[both.frame == 0]] == ["car", *["pedestrian"] * 2]


@pytest.mark.parametrize("name", ["emergency_braking", "merge", "circle"])
def test_walkers_join_every_source(name: str) -> None:
    """Behind all other objects, 0.6 x 0.6 x 1.75 m on the ground, in every frame; the motion of
    everything else is what it was, bit for bit, and what they stand behind hides them."""
    scenario = dataclasses.replace(scenarios.load(name), duration=5.0)
    path = ((-200.0, 60.0), (-190.0, 60.0))
    walker = Walker(path, 1.4)
    without = sim_bridge.simulate(scenario, 0)
    trace = sim_bridge.simulate(dataclasses.replace(scenario, walkers=(walker,)), 0)
    (own,) = pedestrians(trace)
    assert len(own) == trace.n_frames
    assert own.object_id[0] == trace.object_id.max() == without.object_id.max() + 1
    sizes = {"length": 0.6, "width": 0.6, "height": 1.75, "z": 0.875}
    assert all((getattr(own, column) == value).all() for column, value in sizes.items())
    others = trace.take(trace.object_id < own.object_id[0])
    for column, values in without.columns().items():
        if column != "visible":
            assert np.array_equal(getattr(others, column), values)
    assert trace.ego == without.ego


def test_a_walker_is_hidden_and_seen_like_everything_else() -> None:
    """It passes behind the bus that stands between it and the sensor."""
    bus = scenarios.StaticBox("bus", 0.0, 10.0, 0.0, 12.0, 2.55, 3.2)
    walker = Walker(((-20.0, 15.0), (20.0, 15.0)), 2.0)
    scenario = dataclasses.replace(with_walkers(walker), statics=(bus,))
    (own,) = pedestrians(sim_bridge.simulate(scenario, 0))
    assert (own.visible[np.abs(own.x) < 6.0] == 0.0).all()
    assert (own.visible[np.abs(own.x) > 11.0] == 1.0).all()


@pytest.mark.parametrize("scenario", ["stationary", "bus_stop"])
def test_walking_into_something_refuses_the_seed(scenario: str) -> None:
    """A parked car, a bus stop's traffic, another walker: named, with the time."""
    if scenario == "stationary":
        there = scenarios.load("stationary", x=10.0, y=20.0)
        with pytest.raises(SeedRefused, match=r"'car' and 'walker 0' overlap at \d+\.\d s"):
            sim_bridge.simulate(with_walkers(Walker(LINE, 1.4), scenario=there), 0)
        two = Walker(LINE, 1.4), Walker(LINE[::-1], 1.4)
        with pytest.raises(SeedRefused, match="'walker 0' and 'walker 1' overlap"):
            sim_bridge.simulate(with_walkers(*two), 0)
        return
    stop = dataclasses.replace(scenarios.load(scenario), duration=5.0)
    parked = stop.statics[0]
    onto = Walker(((parked.x, parked.y), (parked.x + 0.5, parked.y)), 1.0)
    with pytest.raises(SeedRefused, match=r"'static 0' and 'walker 0' overlap at 0\.0 s"):
        sim_bridge.simulate(dataclasses.replace(stop, walkers=(onto,)), 0)


def test_walkers_are_part_of_the_identity() -> None:
    """Each of their numbers is; a scenario without any says nothing of them."""
    assert "walkers" not in ALONE.identity()
    walker = Walker(LINE, 1.4, pauses=(Pause(5.0, 4.0),))
    changes = [
        {"path": BENT},
        {"speed": 1.5},
        {"speed_spread": 0.1},
        {"start": 1.0},
        {"start_spread": 0.1},
        {"pauses": ()},
        {"pauses": (Pause(5.0, 4.0, 1.0),)},
    ]
    every = [walker, *(dataclasses.replace(walker, **change) for change in changes)]
    identities = {with_walkers(one).identity() for one in every}
    assert len(identities | {with_walkers().identity()}) == len(every) + 1


# --- scenario files ---------------------------------------------------------------------------

VALID = """\
walkers:
  - path: [[5, 20], [15.0, 20.0], [15, 26]]
    speed: 1.4
    speed_spread: 0.2
    start: -3
    start_spread: 1.5
    pauses:
      - {after: 4.0, duration: 2.5}
      - {after: 12, duration: 3.0, duration_spread: 3}
  - {path: [[0, 30], [9, 30]], speed: 1}
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "mine.yaml"
    path.write_text(scenarios.load("stationary").definition.read_text() + text)
    return path


def test_a_file_with_walkers_loads(tmp_path: Path) -> None:
    """Keys and defaults; and the world has two pedestrians."""
    scenario = scenarios.load(written(tmp_path, VALID))
    first, second = scenario.walkers
    assert first == Walker(
        path=((5.0, 20.0), (15.0, 20.0), (15.0, 26.0)),
        speed=1.4,
        speed_spread=0.2,
        start=-3.0,
        start_spread=1.5,
        pauses=(Pause(4.0, 2.5), Pause(12.0, 3.0, 3.0)),
    )
    assert second == Walker(((0.0, 30.0), (9.0, 30.0)), 1.0)
    assert len(pedestrians(sim_bridge.simulate(scenario, 0))) == 2


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        ("speed: 1.4", "sped: 1.4", ("walkers.0.sped", "speed_spread")),
        ("speed: 1}", "x: 1}", ("walkers.1.x", "pauses")),
        ("    speed: 1.4\n", "", ("missing key walkers.0.speed",)),
        ("speed: 1.4", "speed: 0.0", ("walkers.0.speed", "0.1", "0.0")),
        ("speed: 1.4", "speed: 9.0", ("walkers.0.speed", "4")),
        ("speed: 1.4", "speed: fast", ("walkers.0.speed", "number", "'fast'")),
        ("spread: 0.2", "spread: 1.35", ("walkers.0", "speed - speed_spread", "0.1 m/s")),
        ("start: -3", "start: .inf", ("walkers.0.start",)),
        ("start_spread: 1.5", "start_spread: -1", ("walkers.0.start_spread",)),
        ("[[0, 30], [9, 30]]", "[[0, 30]]", ("walkers.1.path", "2 items")),
        ("[[0, 30], [9, 30]]", "[[0, 30], [9]]", ("walkers.1.path.1", "2 items")),
        ("[[0, 30], [9, 30]]", "[[0, 30], [9, up]]", ("walkers.1.path.1.1", "number", "'up'")),
        ("[15.0, 20.0]", "[5, 20]", ("walkers.0", "[5.0, 20.0] twice in a row")),
        ("after: 12", "after: 16", ("walkers.0", "pauses", "within the path's 16 m")),
        ("after: 12", "after: 4", ("walkers.0", "pauses", "one after another")),
        ("after: 4.0", "after: 0", ("walkers.0.pauses.0.after", "greater than 0")),
        ("spread: 3}", "spread: 3.1}", ("walkers.0.pauses.1", "at most the duration")),
        ("duration: 2.5", "seconds: 2.5", ("walkers.0.pauses.0.seconds", "duration")),
    ],
)
def test_what_is_no_walker_is_one_line(
    tmp_path: Path, old: str, new: str, parts: tuple[str, ...]
) -> None:
    """File, key, and what was expected there."""
    assert old in VALID
    path = written(tmp_path, VALID.replace(old, new, 1))
    with pytest.raises(ScenarioError) as caught:
        scenarios.load(path)
    message = str(caught.value)
    assert "\n" not in message
    for part in (str(path), *parts):
        assert part in message
