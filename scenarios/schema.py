"""Turns a scenario's YAML file into checked settings, or into a one-line `ScenarioError`.

Only plain YAML is accepted: no tags, no aliases (a few lines of them expand to gigabytes), no
repeated keys (YAML would silently keep the last).
"""

from collections.abc import Hashable
from pathlib import Path
from typing import Annotated, Any

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from scenarios.scenario import Kind, Kinematics, ScenarioError, Source

MAX_FILE_SIZE = 1_000_000  # bytes; a scenario of a thousand parked cars is a tenth of this
MAX_SHOWN_INPUT = 60  # characters of a refused value that are quoted in the message

_Name = Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_]*$", max_length=64)]
_Line = Annotated[str, Field(pattern=r"^[^\r\n]+$", max_length=300)]
_Length = Annotated[float, Field(gt=0, le=100)]  # m
_Coordinate = Annotated[float, Field(ge=-1e6, le=1e6)]  # m


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)


class ParameterSettings(_Strict):
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


class StaticSettings(_Strict):
    """One entry under `statics`: box centre [m], yaw [rad] and size [m]."""

    kind: Kind
    x: _Coordinate
    y: _Coordinate
    yaw: Annotated[float, Field(ge=-7, le=7)] = 0.0
    length: _Length
    width: _Length
    height: _Length


class ScenarioSettings(_Strict):
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
    parameters: dict[_Name, ParameterSettings] = {}
    statics: list[StaticSettings] = []


def read_settings(path: Path) -> ScenarioSettings:
    """Read and check a scenario file.

    Raises `ScenarioError`, one line with the file, the key and what was expected there.
    """
    document = _parse(path)
    if not isinstance(document, dict):
        raise ScenarioError(f"{path}: expected a mapping of keys, found {_shown(document)}")
    try:
        return ScenarioSettings.model_validate(document)
    except ValidationError as error:
        raise ScenarioError(f"{path}: {_first_problem(error)}") from None
    except RecursionError:
        raise ScenarioError(f"{path}: is nested too deeply") from None


class _PlainLoader(yaml.SafeLoader):
    """SafeLoader that refuses aliases and repeated keys."""

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            parser: Any = self  # this method has no type in the stubs
            mark = parser.get_event().start_mark
            raise yaml.composer.ComposerError(None, None, "aliases (*name) are not accepted", mark)
        return super().compose_node(parent, index)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen: set[str] = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                if key.value in seen:
                    raise yaml.constructor.ConstructorError(
                        None,
                        None,
                        f"key {key.value[:MAX_SHOWN_INPUT]!r} is given twice",
                        key.start_mark,
                    )
                seen.add(key.value)
        return super().construct_mapping(node, deep)


def _parse(path: Path) -> object:
    try:
        if not path.is_file():
            what = "is not a regular file" if path.exists() else "does not exist"
            raise ScenarioError(f"{path}: {what}; expected a scenario file in YAML")
        with path.open("rb") as file:
            content = file.read(MAX_FILE_SIZE + 1)
    except (OSError, ValueError) as error:
        if isinstance(error, ScenarioError):
            raise
        raise ScenarioError(f"{path}: cannot be read: {error}") from None
    if len(content) > MAX_FILE_SIZE:
        raise ScenarioError(f"{path}: is larger than {MAX_FILE_SIZE} bytes; expected a YAML file")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ScenarioError(f"{path}: is not UTF-8 text; expected a scenario in YAML") from None
    try:
        # _PlainLoader is a SafeLoader: it constructs no Python objects.
        return yaml.load(text, Loader=_PlainLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        where = f" at line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        raise ScenarioError(f"{path}: YAML error{where}: {_one_line(error.problem)}") from None
    except yaml.YAMLError as error:
        raise ScenarioError(f"{path}: YAML error: {_one_line(error)}") from None
    except (ValueError, OverflowError) as error:  # e.g. the date 2024-99-99
        raise ScenarioError(f"{path}: YAML error: {_one_line(error)}") from None
    except RecursionError:
        raise ScenarioError(f"{path}: is nested too deeply") from None


def _first_problem(error: ValidationError) -> str:
    problems = error.errors(include_url=False, include_context=False)
    # A misspelt key is also a missing one: the misspelling is what the user needs to see.
    problem = min(problems, key=lambda problem: problem["type"] != "extra_forbidden")
    key = ".".join(_one_line(part) for part in problem["loc"] if part != "[key]") or "(top level)"
    more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
    if problem["type"] == "extra_forbidden":
        known = _known_keys(problem["loc"])
        return f"unknown key {key}; expected one of: {', '.join(known)}{more}"
    if problem["type"] == "missing":
        return f"missing key {key}{more}"
    expected = problem["msg"].removeprefix("Value error, ")
    return f"key {key}: {expected}, found {_shown(problem['input'])}{more}"


def _known_keys(location: tuple[int | str, ...]) -> list[str]:
    models: dict[str, type[BaseModel]] = {
        "parameters": ParameterSettings,
        "statics": StaticSettings,
    }
    nested = models.get(str(location[0])) if len(location) > 1 else None
    return list((nested or ScenarioSettings).model_fields)


def _shown(value: object) -> str:
    """A refused value, quoted only if it is short by construction."""
    if isinstance(value, str):
        return repr(value[:MAX_SHOWN_INPUT]) + ("..." if len(value) > MAX_SHOWN_INPUT else "")
    if value is None or isinstance(value, bool | int | float):
        text = str(value) if not isinstance(value, int) or abs(value) < 10**30 else "a huge integer"
        return "nothing" if value is None else text
    if isinstance(value, BaseModel):
        return "these values"
    names = {"dict": "a mapping", "list": "a list"}
    return names.get(type(value).__name__, f"a {type(value).__name__}")


def _one_line(text: object) -> str:
    return " ".join(str(text).split())[:200]
