"""Turns a request file into a samples file by running SUMO: the child process of `sim_bridge.sumo`.

A bad input can kill SUMO, and libsumo allows one simulation per process, so it runs alone in here.
Nothing of this project is imported: the child starts in the time that libsumo takes to load.
"""

import importlib.util
import json
import math
import os
import sys
from array import array
from collections.abc import Iterator
from pathlib import Path
from typing import Any

os.environ["LIBSUMO_AS_TRACI"] = "quiet"  # otherwise libsumo writes a notice to stdout on import
(_data,) = importlib.util.find_spec("sumo_data").submodule_search_locations  # type: ignore[union-attr,misc]
os.environ["SUMO_HOME"] = _data  # where SUMO finds the schemas of its input files

REPORT = "report.json"
SAMPLES = "samples.npz"
ROW_COLUMNS = ("x", "y", "heading", "speed")
SIZE_COLUMNS = ("length", "width", "height")
KIND_OF_CLASS = {
    "passenger": "car",
    "private": "car",
    "taxi": "car",
    "hov": "car",
    "evehicle": "car",
    "emergency": "van",
    "delivery": "van",
    "truck": "truck",
    "trailer": "truck",
    "bus": "bus",
    "coach": "bus",
    "bicycle": "bicycle",
    "pedestrian": "pedestrian",
}
EGO_KINDS = ("car", "van", "truck", "bus")


def options(request: dict[str, Any]) -> list[str]:
    """SUMO's command line; each departure from its defaults is measured to be needed."""
    chosen = [
        "sumo",
        "--net-file", request["network"],
        "--route-files", ",".join(request["routes"]),
        "--begin", str(request["begin"]),
        "--seed", str(request["seed"]),
        "--step-length", str(request["step"]),
        "--step-method.ballistic", "true",
        # Without sub-lanes a lane change is a jump of a whole lane within one step.
        "--lateral-resolution", "0.8",
        "--time-to-teleport", "-1",
        "--collision.action", "warn",
        "--collision.check-junctions", "true",
        "--xml-validation", "never",
        "--xml-validation.net", "never",
        # Without it SUMO passes over misspelt elements and attributes in silence.
        "--xml-validation.routes", "always",
        "--no-step-log", "true",
        "--duration-log.disable", "true",
    ]  # fmt: skip
    if request["additional"]:
        chosen += ["--additional-files", ",".join(request["additional"])]
    # In one word: SUMO would take a value that begins with a dash for another option.
    return chosen + [f"--{name}={value}" for name, value in request["options"].items()]


def simulate(request: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Run one simulation, write its samples into `folder`, and report what happened."""
    try:
        import libsumo
    except ImportError as error:
        return {"problem": "import", "message": str(error)}
    try:
        libsumo.start(options(request))
        if request["look_for_ego"]:
            found = _ego_of(libsumo, request)
            report = {"problem": None, **found}
        else:
            report = _record(libsumo, request, folder)
        report["version"] = libsumo.simulation.getVersion()[1]
        libsumo.close()
    except _Refused as refused:
        return {"problem": refused.problem, "message": str(refused)}
    except (libsumo.TraCIException, libsumo.FatalTraCIError, RuntimeError) as error:
        return {"problem": "sumo", "message": str(error)}
    return report


class _Refused(Exception):
    """Why nothing of this simulation can be used; `problem` is its kind in the report."""

    def __init__(self, problem: str, message: str) -> None:
        super().__init__(message)
        self.problem = problem


def _steps(libsumo: Any, request: dict[str, Any]) -> Iterator[int]:
    """The time index of each step, after SUMO has made it."""
    parent = os.getppid()
    for index in range(1 - int(request["steps_before"]), int(request["last_index"]) + 1):
        if os.getppid() != parent:  # the caller was killed and cannot stop us any more
            sys.exit("the process that asked for this simulation is gone")
        libsumo.simulationStep()
        yield index


def _ego_of(libsumo: Any, request: dict[str, Any]) -> dict[str, Any]:
    """The vehicle asked for; without one the preferred; without it the one that is on the road for
    longest between first and last index, of equals the earliest, then the first by name. Told are
    its first and last index there."""
    first, last = int(request["first_index"]), int(request["last_index"])
    begun: dict[str, int] = {}
    lives: list[tuple[int, int, str]] = []  # what is least is best: -steps, begin, name
    wanted = request["ego"] or request["preferred"]
    for index in _steps(libsumo, request):
        for name in libsumo.simulation.getArrivedIDList():
            if name in begun:
                lives.append((begun[name] - index, begun.pop(name), name))
        for name in libsumo.simulation.getDepartedIDList():
            if name == wanted or _kind(libsumo, name) in EGO_KINDS:
                begun[name] = max(index, first)
    lives += [(begin - last - 1, begin, name) for name, begin in begun.items()]
    there = [life for life in lives if life[0] < 0]
    there = [life for life in there if life[2] == wanted] or ([] if request["ego"] else there)
    if not there:
        return {"ego": None}
    steps, begin, name = min(there)
    return {"ego": name, "first": begin, "last": begin - steps - 1}


def _record(libsumo: Any, request: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Write the samples of all vehicles, or of those within reach of the ego vehicle."""
    import numpy as np

    vehicles, near = libsumo.vehicle, float(request["reach"])
    first = int(request["first_index"])
    present: dict[str, int] = {}  # number of each vehicle looked at in the step before
    visits: dict[str, int] = {}
    bodies: list[tuple[str, str, float, float, float]] = []
    # Arrays of machine numbers: a list of tuples takes seven times the memory.
    owner, time_index = array("q"), array("q")
    columns = [array("d") for _ in ROW_COLUMNS]
    for index in _steps(libsumo, request):
        if not near:
            _refuse_accident(libsumo)
        if index < first:
            continue
        seen: dict[str, int] = {}
        for name in _within(libsumo, request["ego"], near) if near else vehicles.getIDList():
            number = seen[name] = present.get(name, len(bodies))
            if number == len(bodies):
                # Who comes within reach again is another object: no tracker could know better.
                visits[name] = visits.get(name, 0) + 1
                visit = f", visit {visits[name]}" if visits[name] > 1 else ""
                size = (vehicles.getLength(name), vehicles.getWidth(name), vehicles.getHeight(name))
                bodies.append((name + visit, _known_kind(libsumo, name), *size))
            x, y = vehicles.getPosition(name)
            heading = math.radians(90.0 - vehicles.getAngle(name))
            owner.append(number)
            time_index.append(index)
            for column, value in zip(
                columns, (x, y, heading, vehicles.getSpeed(name)), strict=True
            ):
                column.append(value)
        present = seen

    names, kinds, *sizes = list(zip(*sorted(bodies), strict=True)) or [()] * 5
    rank = np.argsort(np.argsort([body[0] for body in bodies]))
    vehicle = rank[np.asarray(owner)]
    order = np.argsort(vehicle, kind="stable")  # the rows of each vehicle are in order of time
    arrays: dict[str, Any] = {
        "names": np.array(names, dtype=np.str_),
        "kinds": np.array(kinds, dtype=np.str_),
        "vehicle": vehicle[order],
        "time_index": np.asarray(time_index)[order],
    }
    for name, column in zip(ROW_COLUMNS, columns, strict=True):
        arrays[name] = np.asarray(column)[order]
    for name, size in zip(SIZE_COLUMNS, sizes, strict=True):
        arrays[name] = np.array(size, dtype=np.float64)
    np.savez(folder / SAMPLES, **arrays)
    return {"problem": None}


def _within(libsumo: Any, ego: str, reach: float) -> list[str]:
    """The ego vehicle and all within reach [m] of it: SUMO looks them up in a spatial tree."""
    vehicles = libsumo.vehicle
    found = vehicles.getContextSubscriptionResults(ego)
    if ego not in found:
        if ego not in vehicles.getIDList():
            return []
        vehicles.subscribeContext(
            ego, libsumo.constants.CMD_GET_VEHICLE_VARIABLE, reach, [libsumo.constants.VAR_SPEED]
        )
        found = vehicles.getContextSubscriptionResults(ego)
    return sorted(found)


def _refuse_accident(libsumo: Any) -> None:
    """Raise at a collision or a teleport in the step just made."""
    at = f"at {libsumo.simulation.getTime():.1f} s"
    for collision in libsumo.simulation.getCollisions():
        told = f"vehicles {collision.collider} and {collision.victim} collided {at}"
        raise _Refused("accident", told)
    for name in libsumo.simulation.getStartingTeleportIDList():
        raise _Refused("accident", f"vehicle {name} was teleported {at}")


def _known_kind(libsumo: Any, name: str) -> str:
    kind = _kind(libsumo, name)
    if kind is None:
        raise _Refused(
            "kind",
            f"vehicle {name}: vClass {libsumo.vehicle.getVehicleClass(name)!r} is none of"
            f" {', '.join(KIND_OF_CLASS)}; say in its vType what it is to a sensor:"
            ' <param key="kind" value="car"/>',
        )
    return kind


def _kind(libsumo: Any, name: str) -> str | None:
    declared = libsumo.vehicletype.getParameter(libsumo.vehicle.getTypeID(name), "kind")
    if declared:
        return declared if declared in KIND_OF_CLASS.values() else None
    return KIND_OF_CLASS.get(libsumo.vehicle.getVehicleClass(name))


def main(request_file: str) -> None:
    """Read the request, run it, and leave the report beside it."""
    path = Path(request_file)
    report = simulate(json.loads(path.read_text(encoding="utf-8")), path.parent)
    (path.parent / REPORT).write_text(json.dumps(report), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1])
