"""Turns validated settings into the frozen `Scenario` that every later stage is given.

A scenario holds all that decides what happens on the road, except for the seed.
"""

import hashlib
import json
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from string import Template
from typing import ClassVar, Literal

Kind = Literal["car", "van", "bus", "truck", "bicycle", "pedestrian", "wall"]
Source = Literal["sumo", "highway-env", "closed-form", "kitti", "commonroad"]
Kinematics = Literal["smooth", "raw"]
MotionName = Literal[
    "polynomial", "speed_change", "circle", "lane_change", "journey", "passing_bus"
]


class ScenarioError(ValueError):
    """A scenario, or a parameter of one, that cannot be used; the message is one line."""


@dataclass(frozen=True, slots=True)
class ParameterSpec:
    """What a scenario lets its user choose: a number within bounds.

    `default`, `minimum` and `maximum` are in `unit`; an `integer` parameter refuses fractions.
    """

    name: str
    unit: str
    default: float
    minimum: float
    maximum: float
    description: str
    integer: bool = False


@dataclass(frozen=True, slots=True)
class StaticBox:
    """An object that never moves: box centre x, y [m] on the ground, yaw [rad], size [m].

    A `wall` (a house, a fence) hides what is behind it; no sensor reports it, no score counts it.
    """

    kind: Kind
    x: float
    y: float
    yaw: float
    length: float
    width: float
    height: float


@dataclass(frozen=True, slots=True)
class Pause:
    """Where a walker stands for a while: `after` so far along its path [m], for `duration` [s],
    which a seed changes by at most `duration_spread` [s]."""

    after: float
    duration: float
    duration_spread: float = 0.0


@dataclass(frozen=True, slots=True)
class Walker:
    """A pedestrian that walks along a `path` of points x, y [m] and stands before and after it.

    It sets out at `start` [s] (negative: before the recording) and walks at `speed` [m/s]; a seed
    changes both by at most their spreads. It stops at corners to turn, and for its `pauses`.
    """

    path: tuple[tuple[float, float], ...]
    speed: float
    speed_spread: float = 0.0
    start: float = 0.0
    start_spread: float = 0.0
    pauses: tuple[Pause, ...] = ()


@dataclass(frozen=True, slots=True)
class Scenario:
    """What happens on the road: all that determines a trace together with a seed.

    `parameters` are the values in use; `duration` [s] is what is recorded; the sensor is carried
    at `sensor_height` [m]; `statics`, which never move, and `walkers` belong to the bridge;
    `definition` is the YAML file. What else there is depends on the source: `SumoScenario`,
    `HighwayScenario`, `ClosedFormScenario`, `KittiScenario`, `CommonRoadScenario`.
    """

    name: str
    purpose: str
    source: Source
    parameters: Mapping[str, float] = field(hash=False)
    parameter_specs: tuple[ParameterSpec, ...]
    duration: float
    sensor_height: float
    statics: tuple[StaticBox, ...]
    walkers: tuple[Walker, ...]
    definition: Path

    def identity(self) -> str:
        """Canonical JSON of everything that determines the trace besides the seed.

        Files enter by the SHA-256 of their contents and never by their path, so a scenario has the
        same identity on every machine.
        """
        document = {
            "name": self.name,
            "source": self.source,
            "parameters": {name: float(value) for name, value in self.parameters.items()},
            "duration": float(self.duration),
            "sensor_height": float(self.sensor_height),
            "statics": [asdict(box) for box in self.statics],
            "files": {key: _sha256(path) for key, path in self._files().items()},
            **self._particulars(),
        }
        if self.walkers:  # a scenario without any is what it was before there were walkers
            document["walkers"] = [asdict(walker) for walker in self.walkers]
        return json.dumps(document, sort_keys=True, separators=(",", ":"), allow_nan=False)

    def _files(self) -> dict[str, Path]:
        return {"definition": self.definition}

    def _particulars(self) -> dict[str, object]:
        """What the source adds to the identity."""
        return {}


@dataclass(frozen=True, slots=True)
class SumoScenario(Scenario, ABC):
    """Traffic simulated by SUMO.

    It runs for `warmup` [s] before the recording; `network` is a SUMO network; `ego` is the vehicle
    whose roof carries the sensor; `kinematics` says whether motion is smoothed or SUMO's own
    numbers are kept. SUMO knows nothing of the statics and the walkers. Who drives where is a
    `RoutedScenario`'s template or a `ConfiguredScenario`'s files.
    """

    warmup: float
    network: Path
    ego: str
    kinematics: Kinematics

    @property
    def begin(self) -> float:
        """SUMO's time at which the simulation begins [s]."""
        return 0.0

    @property
    def options(self) -> Mapping[str, str]:
        """Options of SUMO's that the bridge leaves to the scenario."""
        return {}

    @abstractmethod
    def route_files(self) -> tuple[tuple[Path, str], ...]:
        """Route files in their order, each with the contents that SUMO is to read."""

    def additional_files(self) -> tuple[tuple[Path, str], ...]:
        """Additional files in their order, each with its contents."""
        return ()

    def _files(self) -> dict[str, Path]:
        return {"definition": self.definition, "network": self.network}

    def _particulars(self) -> dict[str, object]:
        return {"warmup": float(self.warmup), "ego": self.ego, "kinematics": self.kinematics}


@dataclass(frozen=True, slots=True)
class RoutedScenario(SumoScenario):
    """Traffic on the routes of one file, `routes`: a template that `route_xml` fills in."""

    routes: Path

    def route_xml(self) -> str:
        """The route file with every ``${parameter}`` replaced by its value.

        Raises `ScenarioError` if the file is unreadable or names an undeclared parameter.
        """
        template = Template(_read_text(self.routes))
        values = {name: format_number(value) for name, value in self.parameters.items()}
        try:
            return template.substitute(values)
        except KeyError as error:
            known = ", ".join(values) or "none"
            raise ScenarioError(
                f"{self.routes}: placeholder ${{{error.args[0]}}} is not a declared parameter"
                f" (declared: {known})"
            ) from None
        except ValueError as error:
            raise ScenarioError(f"{self.routes}: {error}; write $$ for a dollar sign") from None

    def route_files(self) -> tuple[tuple[Path, str], ...]:
        """The one route file and its text, parameters filled in; `ScenarioError` as `route_xml`."""
        return ((self.routes, self.route_xml()),)

    def _files(self) -> dict[str, Path]:
        # Zero-argument super() does not work in a dataclass with slots.
        return {**SumoScenario._files(self), "routes": self.routes}


@dataclass(frozen=True, slots=True)
class SumoConfiguration:
    """What is taken of a user's SUMO configuration: its files, in their order, the times at which
    it begins and ends [s], and the options that decide how traffic flows."""

    path: Path
    network: Path
    routes: tuple[Path, ...]
    additional: tuple[Path, ...]
    begin: float
    end: float | None
    options: Mapping[str, str] = field(hash=False)


EGO = "ego"
"""The vehicle that carries the sensor in a user's configuration, if there is one of this name."""


@dataclass(frozen=True, slots=True)
class ConfiguredScenario(SumoScenario):
    """Traffic of a user's own SUMO configuration.

    With `ego` empty the sensor is carried by the vehicle `EGO`, or, if there is none, by the one
    that is on the road for longest during the recording: at first `warmup` [s] after the
    configuration begins, and for `duration` [s] at most. The trace lasts as long as that vehicle is
    there. Objects are those within reach of the sensor.
    """

    configuration: SumoConfiguration

    @property
    def begin(self) -> float:
        """When the configuration begins [s]."""
        return self.configuration.begin

    @property
    def options(self) -> Mapping[str, str]:
        """The options of the configuration that decide how traffic flows."""
        return self.configuration.options

    def route_files(self) -> tuple[tuple[Path, str], ...]:
        """The route files of the configuration and their texts, in its order."""
        return tuple((path, _read_text(path)) for path in self.configuration.routes)

    def additional_files(self) -> tuple[tuple[Path, str], ...]:
        """The additional files of the configuration and their texts, in its order."""
        return tuple((path, _read_text(path)) for path in self.configuration.additional)

    def _files(self) -> dict[str, Path]:
        known = self.configuration
        listed = {"routes": known.routes, "additional": known.additional}
        return {
            **SumoScenario._files(self),
            "configuration": known.path,
            **{f"{key} {k}": path for key, paths in listed.items() for k, path in enumerate(paths)},
        }


@dataclass(frozen=True, slots=True)
class HighwayScenario(Scenario):
    """Traffic simulated by highway-env.

    It runs for `warmup` [s] before the recording; `environment` is the id under which gymnasium
    knows the environment; `config` holds its fixed settings; `ego` names the controlled vehicle,
    whose roof carries the sensor. Motion is always smoothed. highway-env knows nothing of the
    statics and the walkers.
    """

    warmup: float
    environment: str
    config: Mapping[str, float] = field(hash=False)
    ego: str
    kinematics: ClassVar[Kinematics] = "smooth"

    def settings(self) -> dict[str, float]:
        """What the environment is configured with: its fixed settings and the parameters."""
        return {**self.config, **self.parameters}

    def _particulars(self) -> dict[str, object]:
        return {
            "warmup": float(self.warmup),
            "environment": self.environment,
            "config": dict(self.config),
            "ego": self.ego,
        }


@dataclass(frozen=True, slots=True)
class ClosedFormScenario(Scenario):
    """What moves by a formula, seen by a sensor that stands at the origin.

    `motion` is the formula's name; the parameters are its own (`sim_bridge.closed_form`).
    """

    motion: MotionName

    def _particulars(self) -> dict[str, object]:
        return {"motion": self.motion}


@dataclass(frozen=True, slots=True)
class KittiScenario(Scenario):
    """A recorded sequence of KITTI's tracking data: nothing about it can be chosen, no seed
    changes it.

    `root` is the folder of all recordings, `sequence` the name in them; `definition` is the file of
    labels, beside it `calibration` and `poses`.
    """

    root: Path
    sequence: str
    calibration: Path
    poses: Path

    def _files(self) -> dict[str, Path]:
        return {"labels": self.definition, "calibration": self.calibration, "poses": self.poses}


_START = ("x", "y", "heading")

MOTION_PARAMETERS: Mapping[MotionName, tuple[str, ...]] = {
    "polynomial": (*_START, "speed", "acceleration", "jerk"),
    "speed_change": (*_START, "speed", "target", "begin", "acceleration", "jerk"),
    "circle": (*_START, "speed", "radius"),
    "lane_change": (*_START, "speed", "begin", "change", "width"),
    "journey": (*_START, "speed", "acceleration", "jerk", "pause"),
    "passing_bus": ("bus_speed", "bus_length", "bus_distance", "car_speed", "car_distance"),
}
"""What each motion takes; `x`, `y` [m] and `heading` [rad] are where one car starts."""


def format_number(value: float) -> str:
    """Shortest decimal that reads back as the same number, without a needless ``.0``."""
    return str(int(value)) if float(value).is_integer() else repr(float(value))


def _read_text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ScenarioError(f"{path}: is not UTF-8 text") from None


def _sha256(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror}") from None
