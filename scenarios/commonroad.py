"""Turns a CommonRoad scenario file (XML, versions 2018b and 2020a) into obstacles and their states.

Positions are those of the shape's middle. Left out are lanelets and signs, environment and phantom
obstacles, occupancy sets and planning problems: what nobody has driven is no truth. Heights, which
CommonRoad does not have, are those of the kind.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar
from xml.etree.ElementTree import Element

from scenarios.scenario import Kind, Kinematics, ParameterSpec, Scenario, ScenarioError
from scenarios.sumo_files import parse_xml, read_bytes

SUFFIX = ".xml"
VERSIONS = ("2018b", "2020a")
MAX_SIZE = 100_000_000  # bytes; published scenarios have up to a tenth of this

KINDS: Mapping[str, Kind] = {
    **dict.fromkeys(("car", "taxi", "priorityVehicle", "parkedVehicle", "unknown"), "car"),
    **dict.fromkeys(("truck", "train"), "truck"),
    "bus": "bus",
    **dict.fromkeys(("bicycle", "motorcycle"), "bicycle"),
    "pedestrian": "pedestrian",
    **dict.fromkeys(("building", "pillar", "median_strip"), "wall"),
    **dict.fromkeys(("roadBoundary", "constructionZone"), "wall"),
}
"""Kinds of CommonRoad's types of obstacles."""

HEIGHTS: Mapping[Kind, float] = {
    **{"car": 1.5, "bus": 3.2, "truck": 3.3},
    **{"bicycle": 1.7, "pedestrian": 1.75, "wall": 3.0},
}
"""Height by kind [m]."""

CARRIERS = ("car", "bus", "truck")
"""Kinds that can carry the sensor."""

EGO = ParameterSpec(
    "ego", "id", 0, 0, 1e9, "obstacle that carries the sensor; 0: the one there for longest", True
)
"""What can be chosen of a CommonRoad file."""

SMOOTHED = 1.0
"""At either end of an obstacle's states: only shapes the motion within [s]."""
_WHOLE = 0.5
"""The recording lasts a multiple of this [s]: what the control points are apart."""
_SHORTEST = 1.0
"""Recording, at least [s]."""

_FARTHEST = 1e6  # m
_LARGEST = 100.0  # m


@dataclass(frozen=True, slots=True)
class Obstacle:
    """One obstacle: size [m], and its states one time step after the other from `first` on: x, y
    [m] of its middle, and heading [rad]. One that is `static` has a single state, for all time."""

    name: str
    kind: Kind
    length: float
    width: float
    height: float
    static: bool
    first: int
    states: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True, slots=True)
class CommonRoadScenario(Scenario):
    """What the obstacles of a CommonRoad file do; no seed changes it.

    The obstacle `ego` carries the sensor. The recording begins at `begin` [s] of the file's time,
    its states are `time_step` [s] apart. Motion is always smoothed.
    """

    ego: str
    begin: float
    time_step: float
    obstacles: tuple[Obstacle, ...]
    kinematics: ClassVar[Kinematics] = "smooth"

    def _particulars(self) -> dict[str, object]:
        return {"ego": self.ego}


def is_commonroad(path: Path) -> bool:
    """Whether a path names a CommonRoad file."""
    return path.suffix.lower() == SUFFIX


def commonroad_scenario(
    path: Path, name: str, parameters: Mapping[str, float], sensor_height: float
) -> CommonRoadScenario:
    """The scenario of a file. parameters: a value of `EGO`.

    Raises `ScenarioError` as `read_commonroad`, and where no obstacle can carry the sensor.
    """
    step, obstacles = read_commonroad(path)
    ego = _ego(path, obstacles, int(parameters[EGO.name]))
    spanned = (len(ego.states) - 1) * step
    duration = math.floor(spanned / _WHOLE + 1e-9) * _WHOLE - 2 * SMOOTHED
    if duration < _SHORTEST:
        raise ScenarioError(
            f"{path}: obstacle {ego.name}: its states span {spanned:g} s, expected at least"
            f" {_SHORTEST + 2 * SMOOTHED:g} s of what carries the sensor"
        )
    return CommonRoadScenario(
        name=name,
        purpose=f"The CommonRoad scenario {path.name}.",
        source="commonroad",
        parameters=parameters,
        parameter_specs=(EGO,),
        duration=duration,
        sensor_height=sensor_height,
        statics=(),
        walkers=(),
        definition=path,
        ego=ego.name,
        begin=ego.first * step + SMOOTHED,
        time_step=step,
        obstacles=obstacles,
    )


def _ego(path: Path, obstacles: tuple[Obstacle, ...], chosen: int) -> Obstacle:
    """The chosen obstacle, or the first of those with most states."""
    able = {each.name: each for each in obstacles if not each.static and each.kind in CARRIERS}
    if not able:
        raise ScenarioError(f"{path}: expected a dynamic obstacle that can carry the sensor")
    if chosen == EGO.default:
        return max(able.values(), key=lambda each: len(each.states))
    if str(chosen) not in able:
        known = ", ".join(list(able)[:20])
        raise ScenarioError(f"{path}: parameter ego: no vehicle {chosen} moves; known: {known}")
    return able[str(chosen)]


def read_commonroad(path: Path) -> tuple[float, tuple[Obstacle, ...]]:
    """The time step [s] and the obstacles, in the order of the file.

    Raises `ScenarioError`, one line that names the file, the obstacle and what was expected.
    """
    content = read_bytes(path, ScenarioError)
    if len(content) > MAX_SIZE:
        raise ScenarioError(f"{path}: is larger than {MAX_SIZE} bytes; expected a scenario")
    root = parse_xml(path, content, ScenarioError)
    if root.tag != "commonRoad":
        raise ScenarioError(f"{path}: expected <commonRoad>, found <{root.tag[:60]}>")
    version = root.get("commonRoadVersion", "none")
    if version not in VERSIONS:
        known = " or ".join(VERSIONS)
        raise ScenarioError(f"{path}: commonRoadVersion {version[:20]!r}, expected {known}")
    step = _number(root.get("timeStepSize"), f"{path}: timeStepSize", 0.001, 0.5, "s")
    obstacles = tuple(_obstacle(path, *each) for each in _elements(path, root))
    names = [obstacle.name for obstacle in obstacles]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise ScenarioError(f"{path}: obstacle {twice} is there twice, expected ids that differ")
    return step, obstacles


def _elements(path: Path, root: Element) -> Iterator[tuple[Element, bool]]:
    """The elements of obstacles, and whether each is static."""
    for element in root:
        if element.tag in ("staticObstacle", "dynamicObstacle"):
            yield element, element.tag == "staticObstacle"
        elif element.tag == "obstacle":  # so 2018b has it
            role = element.findtext("role", "").strip()
            if role not in ("static", "dynamic"):
                raise ScenarioError(
                    f"{path}: obstacle {_name(element)}: role {role[:20]!r}, expected static or"
                    " dynamic"
                )
            yield element, role == "static"


def _obstacle(path: Path, element: Element, static: bool) -> Obstacle:
    name = _name(element)
    where = f"{path}: obstacle {name}"
    if not name.isascii() or not name.isdigit():
        raise ScenarioError(f"{where}: expected an id of digits")
    told = element.findtext("type", "").strip()
    kind = KINDS.get(told)
    if kind is None:
        raise ScenarioError(f"{where}: type {told[:30]!r}, expected one of {', '.join(KINDS)}")
    length, width = _size(where, element)
    initial = element.find("initialState")
    if initial is None:
        raise ScenarioError(f"{where}: has no <initialState>")
    first, state = _state(where, initial)
    states = [state]
    for k, each in enumerate([] if static else element.findall("trajectory/state"), first + 1):
        time, state = _state(where, each)
        if time != k:
            raise ScenarioError(f"{where}: a state at time step {time}, expected {k}")
        states.append(state)
    return Obstacle(name, kind, length, width, HEIGHTS[kind], static, first, tuple(states))


def _name(element: Element) -> str:
    return element.get("id", "without id")[:20]


def _size(where: str, element: Element) -> tuple[float, float]:
    """Length and width [m]; of a circle its diameter, twice."""
    for shape in element.findall("shape/*"):
        if shape.tag == "circle":
            radius = _number(shape.findtext("radius"), f"{where}: radius", 0.01, _LARGEST / 2, "m")
            return 2 * radius, 2 * radius
        if shape.tag == "rectangle":
            for moved in ("orientation", "center/x", "center/y"):
                text = shape.findtext(moved, "0")
                if _number(text, f"{where}: {moved}", -_FARTHEST, _FARTHEST, "") != 0:
                    raise ScenarioError(
                        f"{where}: its rectangle has {moved} {text.strip()[:20]}, expected 0:"
                        " a position that is its middle's"
                    )
            length, width = (
                _number(shape.findtext(side), f"{where}: {side}", 0.01, _LARGEST, "m")
                for side in ("length", "width")
            )
            return length, width
    raise ScenarioError(f"{where}: expected a <shape> with a <rectangle> or a <circle>")


def _state(where: str, element: Element) -> tuple[int, tuple[float, float, float]]:
    """A state's time step, and its x, y [m] and heading [rad]; all must be exact."""
    time = _number(element.findtext("time/exact"), f"{where}: time/exact", 0, 1e6, "")
    if not time.is_integer():
        raise ScenarioError(f"{where}: time/exact is {time:g}, expected a whole time step")
    at = f"{where}, time step {time:g}"
    x, y = (
        _number(element.findtext(key), f"{at}: {key}", -_FARTHEST, _FARTHEST, "m")
        for key in ("position/point/x", "position/point/y")
    )
    key = "orientation/exact"
    return int(time), (x, y, _number(element.findtext(key), f"{at}: {key}", -100.0, 100.0, "rad"))


def _number(text: str | None, where: str, low: float, high: float, unit: str) -> float:
    try:
        number = math.nan if text is None else float(text)
    except ValueError:
        number = math.nan
    if not low <= number <= high:
        given = "is missing" if text is None else f"is {text.strip()[:30]!r}"
        raise ScenarioError(f"{where} {given}, expected a number from {low:g} to {high:g} {unit}")
    return number
