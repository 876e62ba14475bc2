"""A CommonRoad scenario for the tests, written here by hand and by formula: nobody's but ours."""

from collections.abc import Sequence
from pathlib import Path

State = tuple[float, float, float]
"""x, y [m] and heading [rad]."""

RECTANGLE = "<shape><rectangle><length>{0}</length><width>{1}</width></rectangle></shape>"
CIRCLE = "<shape><circle><radius>{0}</radius></circle></shape>"
STEP = 0.1
"""Time step [s]."""
LENGTH, WIDTH = 4.5, 1.8
SPEED, ACCELERATION = 8.0, 1.2
"""Of obstacle 2 [m/s, m/s2]."""
EGO_SPEED = 7.0


def state(tag: str, time: int, place: State) -> str:
    x, y, heading = place
    return (
        f"<{tag}><position><point><x>{x!r}</x><y>{y!r}</y></point></position>"
        f"<orientation><exact>{heading!r}</exact></orientation>"
        f"<time><exact>{time}</exact></time><velocity><exact>0.0</exact></velocity></{tag}>"
    )


def obstacle(
    identifier: int, kind: str, shape: str, states: Sequence[State], first: int = 0
) -> str:
    """As 2020a has it: dynamic if there is more than one state."""
    tag = "dynamicObstacle" if len(states) > 1 else "staticObstacle"
    later = "".join(state("state", first + k, each) for k, each in enumerate(states[1:], 1))
    return (
        f'<{tag} id="{identifier}"><type>{kind}</type>{shape}'
        + state("initialState", first, states[0])
        + (f"<trajectory>{later}</trajectory>" if later else "")
        + f"</{tag}>"
    )


def document(obstacles: str, version: str = "2020a", step: float = STEP) -> str:
    """A whole file; 2018b calls obstacles otherwise, and has tags of its own."""
    tags = ""
    if version == "2018b":
        tags = ' tags="urban"'
        for role in ("static", "dynamic"):
            obstacles = obstacles.replace(f"<{role}Obstacle id=", "<obstacle id=")
            obstacles = obstacles.replace(f"</{role}Obstacle>", f"<role>{role}</role></obstacle>")
    return (
        "<?xml version='1.0' encoding='UTF-8'?>\n"
        f'<commonRoad timeStepSize="{step}" commonRoadVersion="{version}"{tags} author="mdkf"'
        ' affiliation="mdkf" source="by formula" benchmarkID="ZAM_Test-1_1_T-1"'
        ' date="2026-11-22"><location><geoNameId>-999</geoNameId><gpsLatitude>999</gpsLatitude>'
        "<gpsLongitude>999</gpsLongitude></location><scenarioTags><urban/></scenarioTags>"
        f"{obstacles}</commonRoad>"
    )


def obstacles(n: int = 121) -> dict[int, str]:
    """By id: 1 keeps its speed and is there for longest, 2 pulls away for 10 s from 0.7 s on, 3 is
    parked, 4 walks, 5 is there for a second, 6 is a house that hides the motorcycle 7."""
    car = RECTANGLE.format(LENGTH, WIDTH)
    accelerates = [
        (5.0 + SPEED * t + ACCELERATION / 2 * t**2, 12.0, 0.0)
        for t in (0.1 * k for k in range(101))
    ]
    return {
        1: obstacle(1, "car", car, [(EGO_SPEED * STEP * k, 4.0, 0.0) for k in range(n)]),
        2: obstacle(2, "truck", RECTANGLE.format(8.0, 2.5), accelerates, first=7),
        3: obstacle(3, "parkedVehicle", car, [(30.0, -2.0, 0.3)]),
        4: obstacle(
            4,
            "pedestrian",
            CIRCLE.format(0.35),
            [(20.0, 6.0 + 0.1 * k, 1.570796326794) for k in range(n)],
        ),
        5: obstacle(5, "bus", RECTANGLE.format(12.0, 2.5), [(k, 40.0, 0.0) for k in range(11)]),
        6: obstacle(6, "building", RECTANGLE.format(12.0, 1.0), [(40.0, 16.0, 0.0)]),
        7: obstacle(7, "motorcycle", RECTANGLE.format(2.0, 0.8), [(40.0, 19.0, 0.0)]),
    }


def written(folder: Path, text: str | None = None) -> Path:
    """The file with all obstacles, or with a text of its own."""
    path = folder / "ZAM_Test-1_1_T-1.xml"
    path.write_text(document("".join(obstacles().values())) if text is None else text)
    return path
