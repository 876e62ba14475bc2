"""What a scenario's YAML file may say: keys, units, bounds."""

from collections.abc import Mapping
from itertools import pairwise
from math import dist
from typing import Annotated, Any

from pydantic import ConfigDict, Field, model_validator

from scenarios.scenario import MOTION_PARAMETERS, Kind, Kinematics, MotionName, Source
from scenarios.settings import Settings

MAX_NAME = 64  # characters
MIN_DURATION, MAX_DURATION = 1.0, 3600.0  # s, of what is recorded

_Name = Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_]*$", max_length=MAX_NAME)]
_Line = Annotated[str, Field(pattern=r"^[^\r\n]+$", max_length=300)]
_Length = Annotated[float, Field(gt=0, le=100)]  # m
_Coordinate = Annotated[float, Field(ge=-1e6, le=1e6)]  # m
_Point = Annotated[list[_Coordinate], Field(min_length=2, max_length=2)]
_Seconds = Annotated[float, Field(ge=0, le=3600)]

SLOWEST = 0.1
"""Slowest walk [m/s]."""


class ParameterSettings(Settings):
    """One entry under `parameters`; the rules of `scenarios.ParameterSpec`."""

    unit: Annotated[str, Field(max_length=30)]
    default: float
    minimum: float
    maximum: float
    description: _Line
    integer: bool = False

    @model_validator(mode="after")
    def _default_within_bounds(self) -> "ParameterSettings":
        if not self.minimum <= self.default <= self.maximum:
            raise ValueError("minimum <= default <= maximum must hold")
        if self.integer and not self.default.is_integer():
            raise ValueError("the default of an integer parameter must be a whole number")
        return self


class StaticSettings(Settings):
    """One entry under `statics`: box centre [m], yaw [rad] and size [m]."""

    kind: Kind
    x: _Coordinate
    y: _Coordinate
    yaw: Annotated[float, Field(ge=-7, le=7)] = 0.0
    length: _Length
    width: _Length
    height: _Length


class PauseSettings(Settings):
    """One entry under a walker's `pauses`; the rules of `scenarios.Pause`."""

    after: Annotated[float, Field(gt=0, le=1e5)]
    duration: _Seconds
    duration_spread: _Seconds = 0.0

    @model_validator(mode="after")
    def _stands_at_all(self) -> "PauseSettings":
        if self.duration_spread > self.duration:
            raise ValueError("duration_spread must be at most the duration")
        return self


class WalkerSettings(Settings):
    """One entry under `walkers`; the rules of `scenarios.Walker`."""

    path: Annotated[list[_Point], Field(min_length=2, max_length=1000)]
    speed: Annotated[float, Field(ge=SLOWEST, le=4)]
    speed_spread: Annotated[float, Field(ge=0, le=4)] = 0.0
    start: Annotated[float, Field(ge=-3600, le=3600)] = 0.0
    start_spread: _Seconds = 0.0
    pauses: list[PauseSettings] = Field(default_factory=list)

    @model_validator(mode="after")
    def _is_a_walk(self) -> "WalkerSettings":
        steps = [dist(a, b) for a, b in pairwise(self.path)]
        if 0.0 in steps:
            place = self.path[steps.index(0.0)]
            raise ValueError(f"the path has {place} twice in a row; its points must differ")
        if self.speed - self.speed_spread < SLOWEST:
            raise ValueError(f"speed - speed_spread must be at least {SLOWEST} m/s")
        stops = [0.0, *(pause.after for pause in self.pauses), sum(steps)]
        if any(b <= a for a, b in pairwise(stops)):
            raise ValueError(
                f"pauses must come one after another within the path's {sum(steps):g} m"
            )
        return self


class ScenarioSettings(Settings):
    """What every scenario file says; times in seconds."""

    name: _Name
    purpose: _Line
    source: Source
    duration: Annotated[float, Field(gt=0, le=MAX_DURATION)]
    sensor_height: Annotated[float, Field(gt=0, le=10)] = 1.73
    parameters: dict[_Name, ParameterSettings] = Field(default_factory=dict)
    statics: list[StaticSettings] = Field(default_factory=list)
    walkers: list[WalkerSettings] = Field(default_factory=list)


class SumoSettings(ScenarioSettings):
    """A scenario file of source `sumo`; file names relative to the file itself."""

    warmup: Annotated[float, Field(ge=0, le=MAX_DURATION)]
    network: _Line
    routes: _Line
    ego: _Line
    kinematics: Kinematics = "smooth"


class ConfigurationSettings(ScenarioSettings):
    """A scenario file of source `sumo` around a SUMO configuration of the user's.

    It has no parameters: the configuration's files are no templates.
    """

    configuration: _Line
    warmup: Annotated[float, Field(ge=0, le=MAX_DURATION)] = 0.0
    ego: Annotated[str, Field(pattern=r"^[^\r\n]*$", max_length=300)] = ""
    kinematics: Kinematics = "smooth"

    @model_validator(mode="after")
    def _has_no_parameters(self) -> "ConfigurationSettings":
        if self.parameters:
            raise ValueError("a scenario of a SUMO configuration takes no parameters")
        return self


class HighwaySettings(ScenarioSettings):
    """A scenario file of source `highway-env`; its parameters are settings of the environment."""

    warmup: Annotated[float, Field(ge=0, le=MAX_DURATION)]
    environment: Annotated[str, Field(pattern=r"^[\w./:-]+$", max_length=100)]
    config: dict[_Name, int | float] = Field(default_factory=dict)
    ego: _Name

    @model_validator(mode="after")
    def _fixes_no_parameter(self) -> "HighwaySettings":
        both = sorted(self.config.keys() & self.parameters.keys())
        if both:
            raise ValueError(f"{both[0]} is in config and among the parameters")
        return self


class ClosedFormSettings(ScenarioSettings):
    """A scenario file of source `closed-form`."""

    motion: MotionName

    @model_validator(mode="after")
    def _has_the_motions_parameters(self) -> "ClosedFormSettings":
        needed = set(MOTION_PARAMETERS[self.motion])
        if needed != set(self.parameters):
            raise ValueError(
                f"motion {self.motion} takes the parameters {', '.join(sorted(needed))}, found"
                f" {', '.join(sorted(self.parameters)) or 'none'}"
            )
        return self


class _SourceSettings(ScenarioSettings):
    """A file without a known source: it is told what sources there are, and nothing else."""

    model_config = ConfigDict(extra="ignore")


def settings_of(document: Mapping[str, Any]) -> type[ScenarioSettings]:
    """The settings that a scenario file of the document's source must be."""
    models: dict[str, type[ScenarioSettings]] = {
        "sumo": SumoSettings,
        "highway-env": HighwaySettings,
        "closed-form": ClosedFormSettings,
    }
    if document.get("source") == "sumo" and "configuration" in document:
        return ConfigurationSettings
    return models.get(str(document.get("source")), _SourceSettings)
