"""Claim: a trace is exact truth: smooth, differentiable, without collisions, the same everywhere.

The gate of every scenario of the catalogue. What is measured here comes from positions and boxes
alone; columns are compared to it, never to the code that made them.
"""

import dataclasses
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import scenarios
from mdkf import MotionDynamics, Tracker
from mdkf.tables import KINDS, REGIMES, FloatArray, Trace
from scenarios import Scenario, StaticBox
from sim_bridge import SeedRefused, SimulationError, detect, simulate, write_table
from sim_bridge.line_of_sight import visible_fractions
from sim_bridge.sumo import run_sumo
from tests.sim_bridge.worlds import (
    SUMO,
    assert_velocity_acceleration_and_jerk,
    assert_yaw_rate,
    corners,
    neighbours,
    world,
)

ROOT = Path(__file__).resolve().parents[2]
EGO = (4.6, 1.85)  # length, width in every route file [m]
FINE, FRAME = 0.01, 0.1  # s

STATIONARY = REGIMES.index("stationary")
BUS, CAR = KINDS.index("bus"), KINDS.index("car")


@pytest.fixture(scope="module", params=SUMO)
def trace(request: pytest.FixtureRequest) -> Trace:
    return world(request.param)


@pytest.fixture(scope="module", params=SUMO)
def both(request: pytest.FixtureRequest) -> tuple[Trace, Trace]:
    """The same world at 100 Hz and at 10 Hz."""
    return world(request.param, FINE), world(request.param)


def short(name: str, duration: float = 3.0, **changes: object) -> Scenario:
    return dataclasses.replace(scenarios.load(name), duration=duration, **changes)  # type: ignore[arg-type]


def speed_of(trace: Trace) -> FloatArray:
    return np.hypot(trace.vx, trace.vy)


# --- derivatives ----------------------------------------------------------------------------


def test_columns_are_derivatives_of_the_path(both: tuple[Trace, Trace]) -> None:
    """First, second and third central differences of 100 Hz positions are v, a and j; those of
    the yaw are the yaw rate. Two rows at either end of a life have no such differences."""
    fine, _ = both
    assert_velocity_acceleration_and_jerk(fine)
    assert_yaw_rate(fine)


def test_the_frame_rate_changes_no_number(both: tuple[Trace, Trace]) -> None:
    """At common frames the 100 Hz and the 10 Hz trace agree bit for bit, sensor included."""
    fine, coarse = both
    common = fine.take(fine.frame % 10 == 0)
    np.testing.assert_array_equal(common.frame, 10 * coarse.frame)
    for name in coarse.columns().keys() - {"frame"}:
        np.testing.assert_array_equal(getattr(common, name), getattr(coarse, name), err_msg=name)
    for name in ("x", "y", "z", "yaw"):
        np.testing.assert_array_equal(getattr(fine.ego, name)[::10], getattr(coarse.ego, name))


def test_jerk_is_physical(trace: Trace) -> None:
    """99 % of the moving rows stay below 15 m/s3; nobody brakes harder than tyres can."""
    moving = speed_of(trace) > 0
    assert np.quantile(np.hypot(trace.jx, trace.jy)[moving], 0.99) < 15.0
    assert np.hypot(trace.ax, trace.ay).max() < 9.0


def test_nobody_jumps(trace: Trace) -> None:
    """Objects are there without a break, move no further than their speed allows, and never more
    than 0.5 m across their heading in 0.1 s."""
    before, after = neighbours(trace)
    np.testing.assert_array_equal(trace.frame[after] - trace.frame[before], 1)
    moved = (trace.x[after] - trace.x[before]) + 1j * (trace.y[after] - trace.y[before])
    for yaw in (trace.yaw[before], trace.yaw[after]):
        assert np.abs((moved * np.exp(-1j * yaw)).imag).max() < 0.5
    fastest = np.maximum(speed_of(trace)[before], speed_of(trace)[after])
    assert (np.abs(moved) < fastest * FRAME + 0.05).all()
    assert np.abs(moved).max() < 20.0 * FRAME


def test_the_rear_axle_rolls_without_slip(trace: Trace) -> None:
    """No vehicle's rear axle, 0.3 lengths behind its centre, moves across its heading."""
    across = trace.vy * np.cos(trace.yaw) - trace.vx * np.sin(trace.yaw)
    assert np.abs(across - 0.3 * trace.length * trace.yaw_rate).max() < 1e-9


def test_standstill_is_exact(trace: Trace) -> None:
    """Stationary is v = 0.0, to the bit; then all derivatives are zero and the place stays."""
    speed, stationary = speed_of(trace), trace.regime == STATIONARY
    still = speed == 0.0
    np.testing.assert_array_equal(stationary, still)
    for name in ("ax", "ay", "jx", "jy", "yaw_rate"):
        assert (getattr(trace, name)[still] == 0.0).all(), name
    before, after = neighbours(trace)
    stays = stationary[before] & stationary[after]
    moved = np.hypot(trace.x[after] - trace.x[before], trace.y[after] - trace.y[before])
    assert moved[stays].max() < 1e-9
    # Not only what is parked: traffic halts and drives on.
    halting = np.intersect1d(trace.object_id[stationary], trace.object_id[speed > 5])
    assert len(halting) >= 5


def test_every_regime_occurs(trace: Trace) -> None:
    """Each has at least 1 % of the rows; some objects turn, most do not."""
    share = np.bincount(trace.regime, minlength=len(REGIMES)) / len(trace)
    assert (share[:4] > 0.01).all()
    assert share[REGIMES.index("unknown")] == 0.0
    assert 0.001 < trace.turning.mean() < 0.3


# --- space ----------------------------------------------------------------------------------


def test_no_two_boxes_overlap(trace: Trace) -> None:
    """In no frame have two boxes, the ego vehicle's included, area in common: some edge of one of
    them always separates their corners."""
    ego = trace.ego
    pairs = []
    for k in range(trace.n_frames):
        rows = trace.frame_rows(k)
        names = ("x", "y", "yaw", "length", "width")
        boxes = np.column_stack([getattr(trace, name)[rows] for name in names])
        boxes = np.vstack([boxes, [ego.x[k], ego.y[k], ego.yaw[k], *EGO]])
        reach = np.hypot(boxes[:, 3], boxes[:, 4]) / 2
        apart = np.hypot(*(boxes[:, None, :2] - boxes[None, :, :2]).transpose(2, 0, 1))
        a, b = np.nonzero(np.triu(apart < reach[:, None] + reach[None], 1))
        pairs.append(np.stack([corners(boxes[a]), corners(boxes[b])], axis=1))
    both = np.concatenate(pairs)  # (pairs, 2, 4, 2)
    assert len(both) > 1000
    separated = np.zeros(len(both), dtype=bool)
    for box in range(2):
        for edge in range(2):
            side = both[:, box, edge + 1] - both[:, box, edge]
            shadow = np.einsum("nbcd,nd->nbc", both, side)
            low, high = shadow.min(axis=2), shadow.max(axis=2)
            separated |= (high[:, 0] < low[:, 1]) | (high[:, 1] < low[:, 0])
    assert separated.all()


def test_a_parked_car_in_the_lane_refuses_the_seed() -> None:
    """SUMO knows nothing of static boxes: driving through one is noticed, and both are named."""
    box = StaticBox("car", x=100.0, y=-5.1, yaw=0.0, length=4.5, width=1.8, height=1.5)
    scenario = short("bus_stop", statics=(box,))
    with pytest.raises(SeedRefused, match=r"bus_stop, seed 0: .*'static 0'.* overlap at \d"):
        simulate(scenario, 0)


def test_the_sensor_drives_smoothly(both: tuple[Trace, Trace]) -> None:
    """The ego path has no jump either: differences of 100 Hz poses give physical acceleration and
    jerk and a heading that turns; it covers ground at a constant height."""
    ego = both[0].ego
    np.testing.assert_array_equal(ego.frame, np.arange(6000))
    p = ego.x + 1j * ego.y
    v, a, j = (np.diff(p, order) / FINE**order for order in (1, 2, 3))
    assert np.abs(v).sum() * FINE > 100.0
    assert np.abs(v).max() < 20.0
    assert np.abs(a).max() < 9.0
    assert np.quantile(np.abs(j), 0.99) < 15.0
    assert np.abs(np.angle(np.exp(1j * np.diff(ego.yaw)))).max() < 1.0 * FINE
    assert np.ptp(ego.z) == 0.0
    assert ego.z[0] > 1.0


def test_everything_stands_on_the_ground(trace: Trace) -> None:
    """A box's centre is half its height above the ground, and no object changes its size."""
    np.testing.assert_array_equal(trace.z, trace.height / 2)
    before, after = neighbours(trace)
    for name in ("kind", "length", "width", "height"):
        column = getattr(trace, name)
        np.testing.assert_array_equal(column[before], column[after])


# --- sight ----------------------------------------------------------------------------------


def test_visible_is_a_fraction(trace: Trace) -> None:
    """From 0 to 1, and both occur, as does what is between."""
    assert trace.visible.min() == 0.0
    assert trace.visible.max() == 1.0
    assert ((trace.visible > 0.1) & (trace.visible < 0.9)).mean() > 0.05


def longest_run(mask: NDArray[np.bool_]) -> int:
    """The longest run of True."""
    ends = np.flatnonzero(~np.concatenate([[False], mask, [False]]))
    return int(np.diff(ends).max()) - 1


def test_a_bus_hides_parked_and_passing_cars() -> None:
    """In bus_stop at least one standing and one moving car within 50 m of the sensor are hidden
    (visible < 0.15) for a second or more by a bus: without the buses they would be in view."""
    trace = world("bus_stop")
    rest = trace.take(trace.kind != BUS)
    names = ("x", "y", "z", "yaw", "length", "width", "height")
    without = visible_fractions(
        np.column_stack([trace.ego.x, trace.ego.y, trace.ego.z]),
        rest.frame_start,
        np.column_stack([getattr(rest, name) for name in names]),
    )
    hidden = (rest.visible < 0.15) & (without > 0.6) & (rest.kind == CAR)
    hidden &= rest.sensor_distance() < 50.0
    speed = speed_of(rest)
    for state in (speed == 0.0, speed > 1.0):
        runs = [longest_run((hidden & state)[rest.rows_of(int(i))]) for i in rest.ids()]
        assert max(runs) >= 10


# --- determinism ----------------------------------------------------------------------------


CHAIN = """
import dataclasses, scenarios
from mdkf import MotionDynamics, Tracker
from sim_bridge import detect, simulate, write_table
trace = simulate(dataclasses.replace(scenarios.load({name!r}), duration=3.0), {seed})
detections = detect(trace, seed={seed})
write_table(trace, "trace.parquet")
write_table(detections, "detections.parquet")
write_table(Tracker(MotionDynamics(order=3)).run(detections), "tracks.parquet")
"""


def files_of(name: str, seed: int, folder: Path) -> dict[str, bytes]:
    """The Parquet files of the same chain in this process."""
    trace = simulate(short(name), seed)
    detections = detect(trace, seed=seed)
    tracks = Tracker(MotionDynamics(order=3)).run(detections)
    folder.mkdir()
    for table in (trace, detections, tracks):
        write_table(table, folder / f"{type(table).__name__.lower()}.parquet")
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize("name", SUMO)
def test_a_seed_is_the_same_bytes_in_any_process(name: str, tmp_path: Path) -> None:
    """Trace, detections and tracks of another process, elsewhere, with another hash seed, are the
    same Parquet files to the byte; another seed gives other files."""
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    subprocess.run(
        [sys.executable, "-P", "-c", CHAIN.format(name=name, seed=4)],
        cwd=elsewhere,
        env=os.environ | {"PYTHONHASHSEED": "7", "PYTHONPATH": str(ROOT)},
        capture_output=True,
        check=True,
    )
    here, other = files_of(name, 4, tmp_path / "here"), files_of(name, 5, tmp_path / "other")
    assert here.keys() == {"trace.parquet", "detections.parquet", "tracks.parquet"}
    for file, content in here.items():
        assert (elsewhere / file).read_bytes() == content, file
        assert other[file] != content, file


def test_a_trace_says_where_it_comes_from() -> None:
    """Scenario, parameters, seed and simulator travel with the rows."""
    scenario = dataclasses.replace(scenarios.load("stop_and_go", speed=11.0), duration=3.0)
    trace = simulate(scenario, 3)
    expected = {"scenario": "stop_and_go", "seed": "3", "source": "sumo", "kinematics": "smooth"}
    assert expected.items() <= trace.provenance.items()
    assert '"speed": 11.0' in trace.provenance["parameters"]
    assert trace.provenance["simulator"].startswith("SUMO ")


# --- options --------------------------------------------------------------------------------


@pytest.mark.parametrize("dt", [0.015, 0.004, 0.0, -0.1, float("nan"), float("inf"), 1e4])
def test_frames_must_fall_on_integration_steps(dt: float) -> None:
    """Any other time between frames is refused, with what was given and what was expected."""
    with pytest.raises(SimulationError, match=rf"dt is {dt} s, expected a multiple of 0\.01 s"):
        simulate(short("stop_and_go"), 0, dt)


def test_a_sensor_that_comes_late_refuses_the_seed() -> None:
    """The ego vehicle must be on the road in every frame."""
    scenario = short("bus_stop", warmup=51.5)  # it departs at 52 s
    with pytest.raises(SeedRefused, match="'ego' is not on the road for all 3 s"):
        simulate(scenario, 0)


def test_raw_kinematics_are_the_simulators() -> None:
    """With kinematics="raw", positions, headings and speeds are SUMO's own samples; the smooth
    motion stays within a metre of them."""
    scenario = short("stop_and_go")
    recording = run_sumo(scenario, 2, margin=1.5)
    raw = simulate(short("stop_and_go", kinematics="raw"), 2)
    inside = (recording.time_index >= 0) & (recording.time_index < 30)
    present = [v for v in np.unique(recording.vehicle[inside]) if recording.names[v] != "ego"]
    assert len(raw.ids()) == len(present)
    for k, vehicle in enumerate(present):
        rows = np.flatnonzero(inside & (recording.vehicle == vehicle))
        mine = raw.rows_of(k)
        np.testing.assert_array_equal(raw.frame[mine], recording.time_index[rows])
        heading = np.exp(1j * raw.yaw[mine])
        front = raw.x[mine] + 1j * raw.y[mine] + raw.length[mine] / 2 * heading
        np.testing.assert_allclose(front.real, recording.x[rows], atol=1e-9)
        np.testing.assert_allclose(front.imag, recording.y[rows], atol=1e-9)
        np.testing.assert_allclose(heading, np.exp(1j * recording.heading[rows]), atol=1e-12)
        np.testing.assert_allclose(speed_of(raw)[mine], recording.speed[rows], atol=1e-12)
    smooth = simulate(scenario, 2)
    assert smooth.provenance["identity"] != raw.provenance["identity"]
    off = np.hypot(smooth.ego.x - raw.ego.x, smooth.ego.y - raw.ego.y)
    assert 0 < off.max() < 1.0


@pytest.mark.parametrize("dt", [0.01, 0.05, 0.15])
def test_raw_kinematics_exist_only_at_sumos_steps(dt: float) -> None:
    """Another dt is bad input, not a bad seed."""
    raw = dataclasses.replace(short("stop_and_go"), kinematics="raw")
    with pytest.raises(SimulationError, match=rf"dt is {dt} s, expected a multiple of 0\.1 s"):
        simulate(raw, 0, dt)
