"""Turns a highway-env scenario and a seed into a `Recording` of raw samples.

highway-env's y axis points to the right of x; here everything is mirrored into a right-handed
frame, so that traffic keeps to the right in both. gymnasium and highway-env are imported when they
are needed: that takes a second.
"""

import difflib
import importlib.metadata
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from scenarios import HighwayScenario
from sim_bridge.network_check import SimulationError
from sim_bridge.recording import Recording

FREQUENCY = 50
"""Steps of the simulation per second; highway-env's Euler steps need short ones."""

POLICY_FREQUENCY = 10
"""Actions of the ego vehicle per second; `FREQUENCY` must be a multiple, or nothing moves."""

DRIVER = "sim_bridge.highway_envs.drivers.Driver"
"""Who drives every vehicle. highway-env's own drivers change lanes with 30 m/s2 across."""

DEFAULT_KIND, DEFAULT_HEIGHT = "car", 1.5  # m; for vehicles of classes that do not say

_IDLE = 1  # the ego vehicle's action; its driver decides for itself
_OURS: Mapping[str, Any] = {
    "simulation_frequency": FREQUENCY,
    "policy_frequency": POLICY_FREQUENCY,
    "other_vehicles_type": DRIVER,
    "observation": {"type": "AttributesObservation", "attributes": ["time"]},
    "action": {"type": "DiscreteMetaAction"},
    "offscreen_rendering": True,
}


def run_highway(scenario: HighwayScenario, seed: int, *, margin: float = 0.0) -> Recording:
    """Simulate a scenario; the same scenario and seed give the same bits in any process.

    Time index 0 is the end of the warm-up and the last one is `duration` later; `margin` [s]
    records as much more at both ends. A vehicle's record ends where it leaves the road, crashes
    or drives backwards.

    Raises `SimulationError` (one line) if the environment or one of its settings does not exist.
    """
    if seed < 0:
        raise SimulationError(f"seed must be 0 or more, got {seed}")
    if not 0 <= margin <= scenario.warmup:
        raise SimulationError(
            f"scenario {scenario.name}: warmup is {scenario.warmup:g} s, expected at least the"
            f" {margin:g} s that are recorded before the start"
        )
    check_inputs(scenario)
    import gymnasium

    environment = gymnasium.make(
        scenario.environment,
        config={**scenario.settings(), **_OURS},
        disable_env_checker=True,
    )
    try:
        environment.reset(seed=seed)
        world: Any = environment.unwrapped
        _seat_driver(world)
        first = round((scenario.warmup - margin) * FREQUENCY)
        last = round((scenario.warmup + scenario.duration + margin) * FREQUENCY)
        tracks = _Tracks(world, scenario.ego, first)
        world.road.step = tracks.recorded(world.road.step)
        while tracks.step < last:
            environment.step(_IDLE)
    finally:
        environment.close()
    return tracks.recording(round(scenario.warmup * FREQUENCY))


def check_inputs(scenario: HighwayScenario) -> None:
    """Raise `SimulationError` for an environment that is not there or does not know a setting.

    highway-env accepts every name and ignores those that it does not know.
    """
    known = _default_config(scenario)
    for name, value in scenario.settings().items():
        if name in _OURS:
            raise SimulationError(
                f"scenario {scenario.name}: setting {name!r} is the bridge's own, leave it out"
            )
        default = known.get(name)
        if isinstance(default, bool) or not isinstance(default, int | float):
            numbers = sorted(
                key
                for key, other in known.items()
                if isinstance(other, int | float) and not isinstance(other, bool | str)
            )
            close = difflib.get_close_matches(name, numbers, n=1)
            hint = f" (did you mean {close[0]}?)" if close else ""
            raise SimulationError(
                f"scenario {scenario.name}: environment {scenario.environment} has no number"
                f" {name!r}{hint} among its settings; known: {', '.join(numbers)}"
            )
        if isinstance(default, int) and not isinstance(value, int):
            raise SimulationError(
                f"scenario {scenario.name}: setting {name} is {value}, expected a whole number"
            )


def _default_config(scenario: HighwayScenario) -> dict[str, Any]:
    """The settings that the environment knows, with their defaults."""
    import gymnasium
    import highway_env  # noqa: F401  (registers its environments)
    from gymnasium.envs.registration import load_env_creator

    from sim_bridge import highway_envs

    highway_envs.register()
    try:
        entry_point = gymnasium.spec(scenario.environment).entry_point
        creator: Any = load_env_creator(entry_point) if isinstance(entry_point, str) else None
        config: dict[str, Any] = creator.default_config()
    except gymnasium.error.Error as error:
        told = " ".join(str(error).split())
        raise SimulationError(f"scenario {scenario.name}: {told}") from None
    except (AttributeError, ImportError):
        raise SimulationError(
            f"scenario {scenario.name}: {scenario.environment} is not one of highway-env's"
            " environments"
        ) from None
    return config


def _seat_driver(world: Any) -> None:
    """Put a driver who decides for himself into the vehicle that actions would control."""
    from sim_bridge.highway_envs.drivers import Driver

    ego = world.vehicle
    if not isinstance(ego, Driver):
        driver = Driver.create_from(ego)
        vehicles = world.road.vehicles
        vehicles[vehicles.index(ego)] = driver
        world.vehicle = driver


class _Tracks:
    """Samples of every vehicle from a step on, collected while the environment runs."""

    def __init__(self, world: Any, ego: str, first: int) -> None:
        self._world = world
        self._first = first
        self._ego = ego
        self.step = 0
        self._names: dict[Any, str] = {}  # vehicles on the road in the step before
        self._gone: set[Any] = set()
        self._sizes: dict[str, tuple[str, float, float, float]] = {}
        self._rows: dict[str, list[tuple[float, ...]]] = {}

    def recorded(self, step: Callable[[float], None]) -> Callable[[float], None]:
        """The road's step, after which every vehicle is looked at."""

        def step_and_record(dt: float) -> None:
            step(dt)
            self.step += 1
            self._look()

        return step_and_record

    def _look(self) -> None:
        names: dict[Any, str] = {}
        for vehicle in self._world.road.vehicles:
            # A crash moves vehicles by force, and after it they slide; a spline through that, or
            # an axle that rolls backwards, would be no vehicle's motion.
            if vehicle.crashed or vehicle.speed < 0.0:
                self._gone.add(vehicle)
            if vehicle in self._gone:
                continue
            name = self._names.get(vehicle) or self._new_name(vehicle)
            names[vehicle] = name
            if self.step >= self._first:
                self._rows.setdefault(name, []).append(self._sample(vehicle))
        # Who has left the road does not come back under another name.
        self._gone |= self._names.keys() - names.keys()
        self._names = names

    def _new_name(self, vehicle: Any) -> str:
        ego = vehicle is self._world.vehicle
        name = self._ego if ego else f"vehicle {len(self._sizes):04d}"
        self._sizes[name] = (
            getattr(vehicle, "KIND", DEFAULT_KIND),
            float(vehicle.LENGTH),
            float(vehicle.WIDTH),
            float(getattr(vehicle, "HEIGHT", DEFAULT_HEIGHT)),
        )
        return name

    def _sample(self, vehicle: Any) -> tuple[float, ...]:
        """Step, front bumper, heading and speed, mirrored; highway-env's position is the centre."""
        heading, half = float(vehicle.heading), float(vehicle.LENGTH) / 2
        x = float(vehicle.position[0]) + half * float(np.cos(heading))
        y = float(vehicle.position[1]) + half * float(np.sin(heading))
        return (float(self.step), x, -y, -heading, float(vehicle.speed))

    def recording(self, origin: int) -> Recording:
        """The table, with step `origin` as time index 0."""
        names = tuple(sorted(self._rows))
        counts = [len(self._rows[name]) for name in names]
        rows = np.array([row for name in names for row in self._rows[name]]).reshape(-1, 5)
        sizes = [self._sizes[name] for name in names]
        return Recording(
            step=1.0 / FREQUENCY,
            vehicle=np.repeat(np.arange(len(names), dtype=np.int64), counts),
            time_index=rows[:, 0].astype(np.int64) - origin,
            x=rows[:, 1].copy(),
            y=rows[:, 2].copy(),
            heading=rows[:, 3].copy(),
            speed=rows[:, 4].copy(),
            names=names,
            kinds=tuple(size[0] for size in sizes),
            length=np.array([size[1] for size in sizes]),
            width=np.array([size[2] for size in sizes]),
            height=np.array([size[3] for size in sizes]),
            simulator=f"highway-env {importlib.metadata.version('highway-env')}",
        )
