"""Claims about what happens in single scenarios of the catalogue: each shows what it promises.

Seen from the sensor, in the truth alone; nothing is detected or tracked here.
"""

import numpy as np
import pytest
from numpy.typing import NDArray

import scenarios
from mdkf.tables import KINDS, FloatArray, Trace
from sim_bridge import simulate
from sim_bridge.line_of_sight import visible_fractions
from tests.sim_bridge.worlds import world

SECOND = 10  # frames
LIDAR_RANGE = 72.0  # m
HIDDEN, SEEN = 0.2, 0.5  # visible fractions
STREETS = (150.0, 300.0, 450.0, 600.0)  # m; where the streets of city_grid run, both ways
VAN, BUS, TRUCK, BICYCLE, PEDESTRIAN = (
    KINDS.index(kind) for kind in ("van", "bus", "truck", "bicycle", "pedestrian")
)


def runs(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """First and last + 1 of each run of True (n, 2)."""
    steps = np.diff(np.concatenate([[False], mask, [False]]).astype(np.int64))
    return np.column_stack([np.flatnonzero(steps == 1), np.flatnonzero(steps == -1)])


def speed_of(trace: Trace) -> FloatArray:
    return np.hypot(trace.vx, trace.vy)


def without(trace: Trace, dropped: NDArray[np.bool_]) -> tuple[Trace, FloatArray]:
    """The other rows, and what of them would be visible if those dropped were not there."""
    rest = trace.take(~dropped)
    names = ("x", "y", "z", "yaw", "length", "width", "height")
    sensor = np.column_stack([trace.ego.x, trace.ego.y, trace.ego.z])
    boxes = np.column_stack([getattr(rest, name) for name in names])
    return rest, visible_fractions(sensor, rest.frame_start, boxes)


def hidden_spells(
    rest: Trace, bare: FloatArray, objects: NDArray[np.int64], shortest: int = SECOND
) -> NDArray[np.int64]:
    """Spells of `shortest` frames or more in which one of the objects, within range, is hidden
    although it would be seen if nothing but the rest were there (n, 4): object, first frame,
    frames, and whether it had been in view for a second before and came into view again."""
    distance, found = rest.sensor_distance(), []
    for i in objects:
        rows = rest.rows_of(int(i))
        seen = rest.visible[rows] > SEEN
        for start, stop in runs((rest.visible[rows] < HIDDEN) & (bare[rows] > SEEN)):
            if stop - start >= shortest and distance[rows][start:stop].max() < LIDAR_RANGE:
                again = seen[:start].sum() >= SECOND and seen[stop:].any()
                found.append((i, rest.frame[rows][start], stop - start, again))
    return np.array(found, dtype=np.int64).reshape(-1, 4)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_parked_row_hides_parked_cars_behind_driving_and_standing_vans(seed: int) -> None:
    """In parked_row vans on the road hide ten or more parked cars for a second or more each; two or
    more of these cars had been in view for a second before, and come into view again."""
    scenario = scenarios.load("parked_row")
    trace = simulate(scenario, seed)
    parked = trace.object_id >= trace.ids()[-len(scenario.statics)]
    rest, bare = without(trace, (trace.kind == VAN) & ~parked)
    cars = np.intersect1d(rest.ids(), trace.object_id[parked])
    assert (speed_of(rest)[np.isin(rest.object_id, cars)] == 0.0).all()
    spells = hidden_spells(rest, bare, cars)
    assert len(spells) >= 10
    assert spells[:, 3].sum() >= 2


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_bus_stop_hides_cyclists_behind_buses(seed: int) -> None:
    """In bus_stop a bus hides a cyclist for half a second or more who would be seen through a gap
    between parked cars, had been in view for a second before, and comes into view again."""
    trace = simulate(scenarios.load("bus_stop"), seed)
    rest, bare = without(trace, trace.kind == BUS)
    cyclists = np.unique(rest.object_id[rest.kind == BICYCLE])
    spells = hidden_spells(rest, bare, cyclists, shortest=SECOND // 2)
    assert spells[:, 3].any()


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_mixed_traffic_hides_cyclists_and_pedestrians_behind_trucks_and_buses(seed: int) -> None:
    """In mixed_traffic trucks and buses hide five or more cyclists for a second or more each; one
    or more of these had been in view for a second before, and come into view again. They hide two
    or more pedestrians for a second or more each."""
    trace = simulate(scenarios.load("mixed_traffic"), seed)
    rest, bare = without(trace, np.isin(trace.kind, (TRUCK, BUS)))
    cyclists = np.unique(rest.object_id[rest.kind == BICYCLE])
    for name, metres in (("length", 1.7), ("width", 0.6), ("height", 1.7)):
        assert (getattr(rest, name)[rest.kind == BICYCLE] == metres).all()
    spells = hidden_spells(rest, bare, cyclists)
    assert len(np.unique(spells[:, 0])) >= 5
    assert spells[:, 3].any()
    pedestrians = np.unique(rest.object_id[rest.kind == PEDESTRIAN])
    assert len(np.unique(hidden_spells(rest, bare, pedestrians)[:, 0])) >= 2


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_passing_van_hides_two_parked_cars_one_to_three_seconds_at_a_time(seed: int) -> None:
    """In passing_van the ego car stands for 20 s or more, and meanwhile vans hide each of the two
    parked cars twice or more for one to three seconds; each time the car had been in view for a
    second before, and comes into view again."""
    trace = simulate(scenarios.load("passing_van"), seed)
    parked = trace.ids()[-2:]
    rest, bare = without(trace, trace.kind == VAN)
    assert (speed_of(rest)[np.isin(rest.object_id, parked)] == 0.0).all()
    (standing,) = runs(np.hypot(np.diff(trace.ego.x), np.diff(trace.ego.y)) == 0.0)
    assert standing[1] - standing[0] >= 20 * SECOND
    spells = hidden_spells(rest, bare, parked)
    car, start, frames, again = spells.T
    meanwhile = (start >= standing[0]) & (start + frames <= standing[1])
    for one in parked:
        assert (meanwhile & (car == one) & (frames <= 3 * SECOND) & (again == 1)).sum() >= 2


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_off_scene_loses_cars_that_turn_off(seed: int) -> None:
    """In off_scene three or more vehicles turn off after 3.5 s in view and are then out of it for
    good, on the road for another second or more; the ego car meanwhile drives on."""
    trace = simulate(scenarios.load("off_scene"), seed)
    in_view = (trace.visible > HIDDEN) & (trace.sensor_distance() < LIDAR_RANGE)
    lost = 0
    for vehicle in trace.ids():
        rows = trace.rows_of(int(vehicle))
        seen = np.flatnonzero(in_view[rows])
        if len(seen) < 3.5 * SECOND or not trace.turning[rows].any():
            continue
        lost += len(trace.frame[rows]) - 1 - seen[-1] >= SECOND
    assert lost >= 3
    assert np.hypot(np.diff(trace.ego.x), np.diff(trace.ego.y)).sum() > 300.0


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_city_grid_turns_corners_and_halts_at_every_crossing(seed: int) -> None:
    """In city_grid the ego car turns a corner between the outermost streets and never leaves them;
    vehicles halt within 30 m of each of the sixteen crossings, and turn both left and right."""
    trace = simulate(scenarios.load("city_grid"), seed)
    ego, first, last = trace.ego, STREETS[0], STREETS[-1]
    assert min(ego.x.min(), ego.y.min()) > first
    assert max(ego.x.max(), ego.y.max()) < last + 5.0  # the lane beside the outermost centre line
    assert np.ptp(ego.x) > 30.0
    assert np.ptp(ego.y) > 30.0
    vehicles = trace.object_id < trace.ids()[-len(scenarios.load("city_grid").statics)]
    halted = (speed_of(trace) == 0.0) & vehicles
    for x in STREETS:
        for y in STREETS:
            near = np.maximum(np.abs(trace.x - x), np.abs(trace.y - y)) < 30.0
            assert (halted & near).any(), (x, y)
    assert trace.yaw_rate.min() < -0.3
    assert trace.yaw_rate.max() > 0.3


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_dense_jam_holds_three_hundred_vehicles_at_once_which_stop_and_go(seed: int) -> None:
    """In every frame of dense_jam there are 300 vehicles or more; 100 or more of them start from
    standstill and come to stand again, 30 within sight of the ego car, which does so itself."""
    trace = simulate(scenarios.load("dense_jam"), seed)
    assert np.bincount(trace.frame, minlength=trace.n_frames).min() >= 300
    assert len(trace.frame_start) == trace.n_frames + 1
    standing, near = speed_of(trace) == 0.0, trace.sensor_distance() < LIDAR_RANGE
    again = beside = 0
    for vehicle in trace.ids():
        rows = trace.rows_of(int(vehicle))
        repeats = len(runs(standing[rows])) >= 2
        again += repeats
        beside += repeats and near[rows].any()
    assert again >= 100
    assert beside >= 30
    assert len(runs(np.hypot(np.diff(trace.ego.x), np.diff(trace.ego.y)) == 0.0)) >= 2


@pytest.mark.parametrize("braking", [5.0, 7.0])
def test_emergency_braking_is_as_hard_as_its_parameter_says(braking: float) -> None:
    """In emergency_braking the hardest deceleration is that of the leaders, up to smoothing."""
    trace = simulate(scenarios.load("emergency_braking", braking=braking), 0)
    assert abs(hardest_braking(trace) - braking) < 0.3


def hardest_braking(trace: Trace) -> float:
    """Largest deceleration along the path [m/s2]."""
    moving = speed_of(trace) > 1.0
    v, a = (np.column_stack([getattr(trace, f"{c}{k}")[moving] for k in "xy"]) for c in "va")
    return float(-((v * a).sum(axis=1) / np.hypot(*v.T)).min())


def test_emergency_braking_stops_two_platoons_which_drive_on() -> None:
    """The leaders stop at their place; all behind them, ten or more vehicles and the ego car, come
    to stand and drive on."""
    scenario = scenarios.load("emergency_braking")
    trace = world("emergency_braking")
    speed = speed_of(trace)
    fronts, halted = [], 0
    for vehicle in trace.ids():
        rows = trace.rows_of(int(vehicle))
        stands = runs(speed[rows] == 0.0)
        if not len(stands):
            continue
        start, stop = stands[0]
        halted += speed[rows][:start].max() > 8.0 and speed[rows][stop:].max(initial=0.0) > 8.0
        fronts.append((trace.x + trace.length / 2)[rows][start])
    assert halted >= 10
    # One leader on each of two lanes; everybody else stands behind them.
    np.testing.assert_allclose(np.sort(fronts)[-2:], scenario.parameters["place"], atol=1.0)
    ego = np.hypot(np.diff(trace.ego.x), np.diff(trace.ego.y))
    (first, *_) = runs(ego == 0.0)
    assert first[1] - first[0] > SECOND
    assert ego[: first[0]].max() > 0.8
    assert ego[first[1] :].max() > 0.8
