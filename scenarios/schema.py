"""What a scenario's YAML file may say: keys, units, bounds."""

from typing import Annotated

from pydantic import Field, model_validator

from scenarios.scenario import Kind, Kinematics, Source
from scenarios.settings import Settings

_Name = Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_]*$", max_length=64)]
_Line = Annotated[str, Field(pattern=r"^[^\r\n]+$", max_length=300)]
_Length = Annotated[float, Field(gt=0, le=100)]  # m
_Coordinate = Annotated[float, Field(ge=-1e6, le=1e6)]  # m


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


class ScenarioSettings(Settings):
    """A whole scenario file; times in seconds, file names relative to the file itself."""

    name: _Name
    purpose: _Line
    source: Source
    duration: Annotated[float, Field(gt=0, le=3600)]
    warmup: Annotated[float, Field(ge=0, le=3600)]
    network: _Line
    routes: _Line
    ego: _Line
    sensor_height: Annotated[float, Field(gt=0, le=10)] = 1.73
    kinematics: Kinematics = "smooth"
    parameters: dict[_Name, ParameterSettings] = Field(default_factory=dict)
    statics: list[StaticSettings] = Field(default_factory=list)
