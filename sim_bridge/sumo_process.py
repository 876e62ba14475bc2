"""Turns a request file into a samples file by running SUMO: the child process of `sim_bridge.sumo`.

A bad input can kill SUMO, and libsumo allows one simulation per process, so it runs alone in here.
Nothing of this project is imported: the child starts in the time that libsumo takes to load.
"""

import importlib.util
import json
import math
import os
import sys
from pathlib import Path
from typing import Any

os.environ["LIBSUMO_AS_TRACI"] = "quiet"  # otherwise libsumo writes a notice to stdout on import
(_data,) = importlib.util.find_spec("sumo_data").submodule_search_locations  # type: ignore[union-attr,misc]
os.environ["SUMO_HOME"] = _data  # where SUMO finds the schemas of its input files

REPORT = "report.json"
SAMPLES = "samples.npz"
FLOAT_COLUMNS = ("x", "y", "heading", "speed", "length", "width", "height")
KIND_OF_CLASS = {
    "passenger": "car",
    "private": "car",
    "taxi": "car",
    "delivery": "van",
    "truck": "truck",
    "trailer": "truck",
    "bus": "bus",
    "coach": "bus",
    "bicycle": "bicycle",
    "pedestrian": "pedestrian",
}


def options(network: str, routes: str, seed: int, step: float) -> list[str]:
    """SUMO's command line; each departure from its defaults is measured to be needed."""
    return [
        "sumo",
        "--net-file", network,
        "--route-files", routes,
        "--seed", str(seed),
        "--step-length", str(step),
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


def simulate(request: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Run one simulation, write its samples into `folder`, and report what happened."""
    try:
        import libsumo
    except ImportError as error:
        return {"problem": "import", "message": str(error)}
    step = float(request["step"])
    try:
        libsumo.start(options(request["network"], request["routes"], int(request["seed"]), step))
        report = _record(libsumo, request, folder)
        libsumo.close()
    except (libsumo.TraCIException, libsumo.FatalTraCIError, RuntimeError) as error:
        return {"problem": "sumo", "message": str(error)}
    return report


def _record(libsumo: Any, request: dict[str, Any], folder: Path) -> dict[str, Any]:
    import numpy as np

    vehicles = libsumo.vehicle
    first, last = int(request["first_index"]), int(request["last_index"])
    steps_before = int(request["steps_before"])
    parent = os.getppid()
    known: dict[str, int] = {}
    bodies: list[tuple[str, str, float, float, float]] = []
    rows: list[tuple[int, int, float, float, float, float]] = []
    for index in range(1 - steps_before, last + 1):
        if os.getppid() != parent:  # the caller was killed and cannot stop us any more
            sys.exit("the process that asked for this simulation is gone")
        libsumo.simulationStep()
        accident = _accident(libsumo)
        if accident:
            time = libsumo.simulation.getTime()
            return {"problem": "accident", "message": f"{accident} at {time:.1f} s"}
        if index < first:
            continue
        for name in vehicles.getIDList():
            number = known.get(name)
            if number is None:
                number = known[name] = len(bodies)
                kind = _kind(libsumo, name)
                if kind is None:
                    return {
                        "problem": "kind",
                        "message": f"vehicle {name}: vClass {vehicles.getVehicleClass(name)!r} is"
                        f" none of {', '.join(KIND_OF_CLASS)}",
                    }
                size = (vehicles.getLength(name), vehicles.getWidth(name), vehicles.getHeight(name))
                bodies.append((name, kind, *size))
            x, y = vehicles.getPosition(name)
            heading = math.radians(90.0 - vehicles.getAngle(name))
            rows.append((number, index, x, y, heading, vehicles.getSpeed(name)))

    rank = np.argsort(np.argsort([body[0] for body in bodies]))
    by_name = sorted(bodies)
    rows = sorted((int(rank[number]), *rest) for number, *rest in rows)  # type: ignore[misc]
    columns = list(zip(*rows, strict=True)) or [()] * 6
    names, kinds, *sizes = list(zip(*by_name, strict=True)) or [()] * 5
    arrays: dict[str, Any] = {
        "names": np.array(names, dtype=np.str_),
        "kinds": np.array(kinds, dtype=np.str_),
        "vehicle": np.array(columns[0], dtype=np.int64),
        "time_index": np.array(columns[1], dtype=np.int64),
    }
    measured = zip(FLOAT_COLUMNS, [*columns[2:], *sizes], strict=True)
    arrays |= {name: np.array(column, dtype=np.float64) for name, column in measured}
    np.savez(folder / SAMPLES, **arrays)
    return {"problem": None, "version": libsumo.simulation.getVersion()[1]}


def _accident(libsumo: Any) -> str | None:
    """The first collision or teleport of the step just made, in words."""
    for collision in libsumo.simulation.getCollisions():
        return f"vehicles {collision.collider} and {collision.victim} collided"
    for name in libsumo.simulation.getStartingTeleportIDList():
        return f"vehicle {name} was teleported"
    return None


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
