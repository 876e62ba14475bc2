"""Turns a catalogue name, or the path of a user's scenario file, into a `Scenario`.

Each scenario of the catalogue is a folder beside this module that holds `scenario.yaml`; recorded
sequences join them where there are any (`scenarios.kitti`).
"""

import difflib
import math
import re
from collections.abc import Iterable, Mapping
from numbers import Integral, Real
from pathlib import Path
from typing import Any

from scenarios.commonroad import EGO, commonroad_scenario, is_commonroad
from scenarios.kitti import PREFIX, kitti_names, kitti_scenario
from scenarios.scenario import (
    ClosedFormScenario,
    ConfiguredScenario,
    HighwayScenario,
    ParameterSpec,
    Pause,
    RoutedScenario,
    Scenario,
    ScenarioError,
    StaticBox,
    Walker,
    format_number,
)
from scenarios.schema import (
    MAX_DURATION,
    MAX_NAME,
    MIN_DURATION,
    ClosedFormSettings,
    ConfigurationSettings,
    HighwaySettings,
    ScenarioSettings,
    SumoSettings,
    settings_of,
)
from scenarios.settings import read_settings
from scenarios.sumo_configuration import is_configuration, read_configuration

DEFINITION = "scenario.yaml"
DEFAULT_DURATION = 60.0
"""Of a SUMO configuration that does not say when it ends [s]."""
DEFAULT_SENSOR_HEIGHT: float = ScenarioSettings.model_fields["sensor_height"].default
"""Of files that are no scenario files of this package's [m]."""
_FOLDER = Path(__file__).resolve().parent


def list_names() -> tuple[str, ...]:
    """Names of the scenarios that come with this package, then of the recorded sequences that are
    there, each sorted."""
    return (*_own_names(), *kitti_names())


def load(name_or_path: str | Path, /, **parameters: float) -> Scenario:
    """Load a scenario of the catalogue by name, or a user's own by the path of its file: YAML, a
    SUMO configuration (.sumocfg), whose parameters are `warmup` and `duration` [s], or a CommonRoad
    scenario (.xml), whose parameter `ego` is the id of the obstacle that carries the sensor.

    `kitti-0001` is a recorded sequence, in the folder that `MDKF_KITTI` names.

    `parameters` override the declared defaults, in the declared units. Raises `ScenarioError` (one
    line) for an unknown name, an unknown, ill-typed or out-of-bounds parameter, or a bad file.
    """
    if isinstance(name_or_path, str) and re.fullmatch(rf"{PREFIX}\w+", name_or_path):
        _choose(name_or_path, (), parameters)  # it has none
        return kitti_scenario(name_or_path)
    path = _locate(name_or_path)
    if is_configuration(path):
        return _configured(path, parameters)
    if is_commonroad(path):
        chosen = _choose(_name_of(path), (EGO,), parameters)
        return commonroad_scenario(path, _name_of(path), chosen, DEFAULT_SENSOR_HEIGHT)
    settings = read_settings(path, settings_of, ScenarioError)
    specs = tuple(
        ParameterSpec(name=key, **dict(value)) for key, value in settings.parameters.items()
    )
    common: dict[str, Any] = {
        "name": settings.name,
        "purpose": settings.purpose,
        "source": settings.source,
        "parameters": _choose(settings.name, specs, parameters),
        "parameter_specs": specs,
        "duration": settings.duration,
        "sensor_height": settings.sensor_height,
        "statics": _static_boxes(settings),
        "walkers": _walkers(settings),
        "definition": path,
    }
    if isinstance(settings, ClosedFormSettings):
        return ClosedFormScenario(**common, motion=settings.motion)
    if isinstance(settings, HighwaySettings):
        return HighwayScenario(
            **common,
            warmup=settings.warmup,
            environment=settings.environment,
            config=dict(settings.config),
            ego=settings.ego,
        )
    if isinstance(settings, ConfigurationSettings):
        configuration = read_configuration(_beside(path, "configuration", settings.configuration))
        return ConfiguredScenario(
            **common,
            warmup=settings.warmup,
            network=configuration.network,
            ego=settings.ego,
            kinematics=settings.kinematics,
            configuration=configuration,
        )
    assert isinstance(settings, SumoSettings)
    scenario = RoutedScenario(
        **common,
        warmup=settings.warmup,
        network=_beside(path, "network", settings.network),
        routes=_beside(path, "routes", settings.routes),
        ego=settings.ego,
        kinematics=settings.kinematics,
    )
    scenario.route_xml()  # an undeclared placeholder must fail here, not in the simulator
    return scenario


def _own_names() -> tuple[str, ...]:
    return tuple(sorted(path.parent.name for path in _FOLDER.glob(f"*/{DEFINITION}")))


def _configured(path: Path, given: Mapping[str, object]) -> ConfiguredScenario:
    """A scenario of a SUMO configuration and of nothing else."""
    configuration = read_configuration(path)
    name = _name_of(path)
    length = DEFAULT_DURATION
    if configuration.end is not None:
        length = min(max(configuration.end - configuration.begin, MIN_DURATION), MAX_DURATION)
    specs = (
        ParameterSpec("warmup", "s", 0.0, 0.0, MAX_DURATION, "traffic before the recording"),
        ParameterSpec(
            "duration", "s", length, MIN_DURATION, MAX_DURATION, "the recording, at most"
        ),
    )
    chosen = _choose(name, specs, given)
    if "duration" not in given and configuration.end is not None:
        chosen["duration"] = min(length, configuration.end - configuration.begin - chosen["warmup"])
        if chosen["duration"] < MIN_DURATION:
            raise ScenarioError(
                f"{path}: option end: expected a time at least {MIN_DURATION:g} s after begin and"
                f" a warmup of {chosen['warmup']:g} s, found {configuration.end:g} s"
            )
    return ConfiguredScenario(
        name=name,
        purpose=f"The SUMO configuration {path.name}.",
        source="sumo",
        parameters=chosen,
        parameter_specs=specs,
        duration=chosen["duration"],
        sensor_height=DEFAULT_SENSOR_HEIGHT,
        statics=(),
        walkers=(),
        definition=path,
        warmup=chosen["warmup"],
        network=configuration.network,
        ego="",
        kinematics="smooth",
        configuration=configuration,
    )


def _name_of(path: Path) -> str:
    """A scenario's name from that of its file."""
    return re.sub(r"\W", "_", path.stem, flags=re.ASCII)[:MAX_NAME]


def _locate(name_or_path: str | Path) -> Path:
    """The definition file; what looks like a path is taken as one."""
    given = str(name_or_path)
    if isinstance(name_or_path, str) and given in _own_names():
        return _FOLDER / given / DEFINITION
    looks_like_path = isinstance(name_or_path, Path) or any(c in given for c in "/\\.")
    if not looks_like_path:
        shown = given[:24] + ("..." if len(given) > 24 else "")
        raise ScenarioError(
            f"unknown scenario {shown!r}{_suggestion(given, list_names())};"
            f" known: {', '.join(_own_names())}, {PREFIX}SSSS; or the path of a scenario file"
        )
    return Path(name_or_path)


def _beside(definition: Path, key: str, file_name: str) -> Path:
    path = definition.resolve().parent / file_name
    try:
        is_file = path.is_file()
    except (OSError, ValueError):
        is_file = False
    if not is_file:
        raise ScenarioError(f"{definition}: key {key}: no such file: {file_name}")
    return path


def _static_boxes(settings: ScenarioSettings) -> tuple[StaticBox, ...]:
    return tuple(StaticBox(**dict(static)) for static in settings.statics)


def _walkers(settings: ScenarioSettings) -> tuple[Walker, ...]:
    return tuple(
        Walker(
            path=tuple((x, y) for x, y in walker.path),
            speed=walker.speed,
            speed_spread=walker.speed_spread,
            start=walker.start,
            start_spread=walker.start_spread,
            pauses=tuple(Pause(**dict(pause)) for pause in walker.pauses),
        )
        for walker in settings.walkers
    )


def _choose(
    scenario: str, specs: tuple[ParameterSpec, ...], given: Mapping[str, object]
) -> dict[str, float]:
    known = {spec.name: spec for spec in specs}
    for name in given:
        if name not in known:
            raise ScenarioError(
                f"scenario {scenario}: unknown parameter {name!r}{_suggestion(name, known)};"
                f" known: {', '.join(known) or 'none'}"
            )
    return {
        spec.name: _checked(scenario, spec, given.get(spec.name, spec.default)) for spec in specs
    }


def _checked(scenario: str, spec: ParameterSpec, value: object) -> float:
    low, high = format_number(spec.minimum), format_number(spec.maximum)
    what = "an integer" if spec.integer else "a number"
    expected = f"expected {what} from {low} to {high} [{spec.unit}]"
    problem = ScenarioError(
        f"scenario {scenario}: parameter {spec.name}: {expected}, got {str(value)[:60]!s}"
        f" ({type(value).__name__})"
    )
    if isinstance(value, bool) or not isinstance(value, Real):
        raise problem
    number = float(value)
    if not math.isfinite(number) or not spec.minimum <= number <= spec.maximum:
        raise problem
    if spec.integer:
        if not isinstance(value, Integral) and not number.is_integer():
            raise problem
        return int(number)
    return number


def _suggestion(given: str, known: Iterable[str]) -> str:
    close = difflib.get_close_matches(given, list(known), n=1)
    return f" (did you mean {close[0]}?)" if close else ""
