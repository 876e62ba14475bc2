"""A scenario and a seed into a trace: smooth exact truth, regimes, visible fractions."""

import hashlib
import json
import operator
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mdkf.tables import KINDS, EgoPath, FloatArray, IntArray, Trace
from scenarios import (
    ClosedFormScenario,
    CommonRoadScenario,
    ConfiguredScenario,
    HighwayScenario,
    KittiScenario,
    Scenario,
    SumoScenario,
)
from sim_bridge import highway, sumo
from sim_bridge.bodies import MOTION, STATIC, Body, World, static_bodies
from sim_bridge.closed_form import closed_form_world
from sim_bridge.commonroad import commonroad_world
from sim_bridge.frames import frames_of
from sim_bridge.kinematics import CONTROL_STEP, INTEGRATION_STEP, raw_motion, smooth_motion, within
from sim_bridge.line_of_sight import visible_fractions
from sim_bridge.network_check import SimulationError
from sim_bridge.overlap import disjoint, first_overlap
from sim_bridge.recorded import recorded_trace
from sim_bridge.recording import Recording
from sim_bridge.regimes import regimes, turning
from sim_bridge.sumo import Accident
from sim_bridge.walkers import walkers


class SeedRefused(SimulationError):
    """The inputs are good, but this seed gives no valid truth; another one may."""


Simulated = SumoScenario | HighwayScenario
"""What a simulator makes, vehicle by vehicle."""

DT = 0.1
"""Time between frames where nobody says otherwise [s]."""

MARGIN = 1.5
"""Simulated before and after the trace [s]: what the spline's ends need."""


def check_inputs(scenario: Scenario) -> None:
    """Raise `SimulationError` for inputs that no simulation can use, without simulating."""
    _check_statics(scenario)
    if isinstance(scenario, SumoScenario):
        sumo.check_inputs(scenario)
    elif isinstance(scenario, HighwayScenario):
        highway.check_inputs(scenario)


def simulate(scenario: Scenario, seed: int, dt: float = DT) -> Trace:
    """The trace of a scenario: every object but the ego vehicle, which carries the sensor.

    dt: time between frames [s], a multiple of 0.01; the motion is the same at every dt. Objects
    are numbered by their names in the simulation, static ones and walkers after them. A recorded
    scenario has its own dt and object ids, and is the same for every seed.

    Of a user's own SUMO configuration the trace lasts as long as the ego vehicle is on the road;
    vehicles that drive through others are left out of it. The provenance tells the `ego` and how
    many were `left_out`. So it is of a CommonRoad scenario, which is the same for every seed.

    Raises `SimulationError` for bad inputs and for a simulator that fails, and `SeedRefused` for
    a seed in which the ego vehicle is not there all the time or two boxes overlap; `KittiError`
    for recorded files that are malformed.
    """
    seed = operator.index(seed)
    if isinstance(scenario, KittiScenario):
        return recorded_trace(scenario, seed, dt)
    _check_statics(scenario)
    stride = _stride(scenario, dt)
    provenance = {
        "scenario": scenario.name,
        "parameters": json.dumps(dict(scenario.parameters), sort_keys=True),
        "identity": hashlib.sha256(scenario.identity().encode()).hexdigest(),
        "seed": str(seed),
        "source": scenario.source,
    }
    if isinstance(scenario, ConfiguredScenario):
        scenario = sumo.with_ego(scenario, seed, margin=MARGIN)
        stride = _stride(scenario, dt)  # it may be on the road for less than the time asked for
        provenance["ego"] = scenario.ego
    n_frames = round(scenario.duration / dt)
    ticks = np.arange(n_frames) * stride
    if isinstance(scenario, ClosedFormScenario):
        world = closed_form_world(scenario, seed, ticks)
    elif isinstance(scenario, CommonRoadScenario):
        world = commonroad_world(scenario, ticks, stride)
        provenance["ego"] = scenario.ego
    else:
        assert isinstance(scenario, SumoScenario | HighwayScenario)
        world = _simulated_world(scenario, seed, stride, ticks)
    statics = static_bodies(scenario.statics, ticks)
    world = replace(world, others=[*world.others, *statics, *walkers(scenario, seed, ticks)])
    provenance |= {
        "simulator": world.simulator,
        "kinematics": getattr(scenario, "kinematics", "exact"),
    }
    if isinstance(scenario, ConfiguredScenario | CommonRoadScenario):
        everybody = len(world.others)
        world = _without_overlap(world, n_frames, stride)
        provenance["left_out"] = str(everybody - len(world.others))
    ego = EgoPath.from_columns(
        {
            "frame": np.arange(n_frames),
            "x": world.ego.motion.x,
            "y": world.ego.motion.y,
            "z": np.full(n_frames, scenario.sensor_height),
            "yaw": world.ego.motion.yaw,
        },
        n_frames=n_frames,
        dt=dt,
        provenance=provenance,
    )
    _refuse_overlap(world, n_frames, stride, f"{scenario.name}, seed {seed}")
    columns = _columns(world.others, stride)
    del world  # millions of rows: nothing is kept twice for longer than it must
    common: dict[str, Any] = {"n_frames": n_frames, "dt": dt, "ego": ego, "provenance": provenance}
    trace = Trace.from_columns(columns, **common)
    del columns
    return _with_sight(trace)


def _check_statics(scenario: Scenario) -> None:
    """Raise `SimulationError` if two boxes that never move overlap: no seed would help."""
    sides = ("x", "y", "yaw", "length", "width")
    boxes = [[float(getattr(box, name)) for name in sides] for box in scenario.statics]
    table = np.array(boxes, dtype=np.float64).reshape(-1, len(sides))
    a, b = first_overlap(np.array([0, len(table)]), table)
    if a >= 0:
        raise SimulationError(
            f"{scenario.definition}: statics.{a} and statics.{b} overlap; expected boxes apart"
        )


def _simulated_world(scenario: Simulated, seed: int, stride: int, ticks: IntArray) -> World:
    """What a simulator's vehicles do within the trace, smoothed."""
    try:
        if isinstance(scenario, SumoScenario):
            recording = sumo.run_sumo(scenario, seed, margin=MARGIN)
        else:
            recording = highway.run_highway(scenario, seed, margin=MARGIN)
    except Accident as accident:
        raise SeedRefused(f"{scenario.name}, seed {seed}: {accident}") from None
    bodies = list(_bodies(scenario, recording, stride, len(ticks)))
    egos = [body for body in bodies if body.name == scenario.ego]
    if not egos or len(egos[0].motion.tick) < len(ticks):
        raise SeedRefused(
            f"{scenario.name}, seed {seed}: the ego vehicle {scenario.ego!r} is not on the road"
            f" for all {scenario.duration:g} s"
        )
    others = [body for body in bodies if body.name != scenario.ego]
    return World(others, egos[0], recording.simulator)


def _stride(scenario: Scenario, dt: float) -> int:
    """dt in integration steps."""
    # SUMO's own numbers exist only at its steps.
    raw = isinstance(scenario, SumoScenario) and scenario.kinematics == "raw"
    step = sumo.STEP if raw else INTEGRATION_STEP
    multiple = round(dt / step) if np.isfinite(dt) else 0
    if multiple < 1 or abs(multiple * step - dt) > 1e-9 or dt > scenario.duration:
        raise SimulationError(
            f"dt is {dt} s, expected a multiple of {step:g} s up to {scenario.duration:g} s"
        )
    return multiple * round(step / INTEGRATION_STEP)


def _bodies(
    scenario: Simulated, recording: Recording, stride: int, n_frames: int
) -> Iterator[Body]:
    """The simulator's vehicles within the trace's frames, by name."""
    every = round(CONTROL_STEP / recording.step)
    per_sample = round(recording.step / INTEGRATION_STEP)
    for vehicle, name in enumerate(recording.names):
        rows = recording.rows_of(vehicle)
        front = np.column_stack([recording.x[rows], recording.y[rows]])
        heading, time = recording.heading[rows], recording.time_index[rows]
        length = float(recording.length[vehicle])
        if scenario.kinematics == "raw":
            motion = raw_motion(
                time * per_sample, front, heading, recording.speed[rows], length, recording.step
            )
        else:
            first = int(time[0]) * per_sample
            motion = smooth_motion(first, front[::every], heading[::every], length, stride)
        kept = None if motion is None else within(motion, n_frames, stride)
        if kept is not None:
            size = (length, float(recording.width[vehicle]), float(recording.height[vehicle]))
            yield Body(name, recording.kinds[vehicle], *size, motion=kept)


def _columns(bodies: list[Body], stride: int) -> dict[str, NDArray[Any]]:
    """The columns of a trace, body by body; all is visible yet."""
    ends = np.cumsum([0, *(len(body.motion.tick) for body in bodies)])
    columns = {name: np.empty(ends[-1], dtype) for name, dtype in Trace.column_types().items()}
    for k, (body, (first, last)) in enumerate(zip(bodies, pairwise(ends), strict=True)):
        motion = body.motion
        v, a, j = (np.column_stack([getattr(motion, f"{d}{axis}") for axis in "xy"]) for d in "vaj")
        values: dict[str, Any] = {
            **{name: getattr(motion, name) for name in MOTION},
            **{name: getattr(body, name) for name in ("length", "width", "height")},
            "frame": motion.tick // stride,
            "object_id": k,
            "kind": KINDS.index(body.kind),
            "z": body.height / 2,
            "regime": regimes(v, a, j),
            "turning": turning(motion.yaw_rate),
            "visible": 1.0,
        }
        for name, column in columns.items():
            column[first:last] = values[name]
    return columns


def _with_sight(trace: Trace) -> Trace:
    """The trace with its exact visible fractions."""
    return replace(trace, visible=visible_fractions(*frames_of(trace)))


def _ground_boxes(
    world: World, n_frames: int, stride: int
) -> tuple[IntArray, FloatArray, IntArray]:
    """Offsets of the frames (n_frames + 1,), boxes (rows, 5) for `first_overlap`, and whose each is
    (rows,): a place among the others, or after them the ego vehicle."""
    bodies = [*world.others, world.ego]
    counts = [len(body.motion.tick) for body in bodies]
    tick = np.concatenate([body.motion.tick for body in bodies])
    order = np.argsort(tick, kind="stable")
    starts = np.searchsorted(tick[order], np.arange(n_frames + 1) * stride)
    owner = np.repeat(np.arange(len(bodies)), counts)[order]
    sizes = np.array([[body.length, body.width] for body in bodies])[owner]
    ground = [np.concatenate([getattr(b.motion, c) for b in bodies]) for c in ("x", "y", "yaw")]
    return starts, np.column_stack([*(column[order] for column in ground), sizes]), owner


def _without_overlap(world: World, n_frames: int, stride: int) -> World:
    """The world without the vehicles that its simulator let drive through others: of two the one
    that is there for longer stays, and the ego vehicle and what never moves always do."""
    always = n_frames + 1
    lives = [
        always if body.name.startswith(STATIC) else len(body.motion.tick) for body in world.others
    ]
    kept = disjoint(*_ground_boxes(world, n_frames, stride), np.array([*lives, always]))
    others = [body for body, stays in zip(world.others, kept, strict=False) if stays]
    return replace(world, others=others)


def _refuse_overlap(world: World, n_frames: int, stride: int, where: str) -> None:
    """Raise `SeedRefused` if any two boxes, the ego vehicle's included, ever overlap."""
    starts, boxes, owner = _ground_boxes(world, n_frames, stride)
    a, b = first_overlap(starts, boxes)
    if a >= 0:
        names = [body.name for body in (*world.others, world.ego)]
        first, second = (names[owner[row]] for row in (a, b))
        frame = int(np.searchsorted(starts, a, side="right")) - 1
        seconds = frame * stride * INTEGRATION_STEP
        raise SeedRefused(
            f"{where}: {first!r} and {second!r} overlap at {seconds:.1f} s; take another seed"
        )
