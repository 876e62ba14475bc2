"""Turns SUMO's input files into one clear error before SUMO sees them, or into a pass.

SUMO dies of some bad networks (`<net/>` is a segmentation fault), silently drops flows that are
out of order, and writes files that its inputs name, so all of them are read here first.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

from scenarios.sumo_files import parse_xml, read_bytes, seconds

Files = Sequence[tuple[Path, str]]
"""Files in the order in which SUMO reads them, each with its contents."""

BUILT_IN_TYPES = frozenset(
    {
        "DEFAULT_VEHTYPE",
        "DEFAULT_BIKETYPE",
        "DEFAULT_PEDTYPE",
        "DEFAULT_TAXITYPE",
        "DEFAULT_RAILTYPE",
        "DEFAULT_CONTAINERTYPE",
    }
)
WRITERS: Mapping[str, str] = {
    **dict.fromkeys(("e1Detector", "inductionLoop", "instantInductionLoop"), "file"),
    **dict.fromkeys(("e2Detector", "laneAreaDetector", "e3Detector", "entryExitDetector"), "file"),
    **dict.fromkeys(("edgeData", "laneData", "routeProbe", "vTypeProbe"), "file"),
    "timedEvent": "dest",
    "calibrator": "output",
}
"""Elements of additional files that write, and the attribute that says where to."""
NOWHERE = "NUL"  # SUMO's own name for a file that is not written
DEPARTING = ("vehicle", "trip", "flow", "person", "personFlow", "container", "containerFlow")


class SimulationError(ValueError):
    """A simulation that cannot be run or trusted; the message is one line."""


def check_network(path: Path) -> frozenset[str]:
    """Names of a network's edges (internal ones left out).

    Raises `SimulationError` if the file is not a complete SUMO network.
    """
    root = parse_xml(path, read_bytes(path, SimulationError), SimulationError)
    if root.tag != "net":
        raise SimulationError(f"{path}: expected a SUMO network <net>, found <{root.tag}>")
    for tag in ("location", "edge", "junction"):
        if root.find(tag) is None:
            raise SimulationError(f"{path}: the network has no <{tag}>")
    _check_parameters(path, root)
    junctions = {junction.get("id") for junction in root.iter("junction")}
    edges = set()
    for edge in root.iter("edge"):
        name = edge.get("id")
        if not name:
            raise SimulationError(f"{path}: an <edge> has no id")
        _check_lanes(path, name, edge)
        if edge.get("function") == "internal":
            continue
        for end in ("from", "to"):
            if edge.get("function") is None and edge.get(end) not in junctions:
                raise SimulationError(
                    f"{path}: edge {name}: {end}={edge.get(end)!r} is not a junction"
                )
        edges.add(name)
    if not edges:
        raise SimulationError(f"{path}: the network has only internal edges")
    return frozenset(edges)


def check_routes(routes: Files, additional: Files, edges: frozenset[str], ego: str) -> None:
    """Check route files (already filled in) against a network's edges and each other.

    additional: files that may declare types and routes too. Raises `SimulationError` if one is
    malformed, out of order, refers to what does not exist or would write; if nobody departs; or if
    no vehicle has the ego's name (any will do if that is empty).
    """
    roots = [(path, parse_xml(path, text.encode(), SimulationError)) for path, text in routes]
    others = [(path, parse_xml(path, text.encode(), SimulationError)) for path, text in additional]
    every = [root for _, root in (*others, *roots)]
    types = BUILT_IN_TYPES.union(*(_ids(root, "vType", "vTypeDistribution") for root in every))
    known = frozenset().union(*(_ids(root, "route", "routeDistribution") for root in every))
    for path, root in roots:
        if root.tag != "routes":
            raise SimulationError(f"{path}: expected <routes>, found <{root.tag}>")
        _check_departures(path, root, types, known)
        _check_edges(path, root, edges)
        _check_parameters(path, root)
    paths = ", ".join(str(path) for path, _ in routes)
    if not any(root.find(tag) is not None for root in every for tag in DEPARTING):
        raise SimulationError(f"{paths}: no vehicle, trip or flow departs")
    if ego and not any(ego in _ids(root, "vehicle", "trip") for root in every):
        raise SimulationError(f"{paths}: no <vehicle> or <trip> has the ego's id {ego!r}")


def without_outputs(path: Path, content: str) -> str:
    """An additional file that writes nothing: its detectors count, and nobody is told.

    Raises `SimulationError` if it is malformed or refers to other files.
    """
    root = parse_xml(path, content.encode(), SimulationError)
    if root.tag not in ("additional", "routes", "add"):
        raise SimulationError(f"{path}: expected <additional>, found <{root.tag}>")
    _check_parameters(path, root)
    for element in root.iter():
        target = WRITERS.get(element.tag)
        if target is not None and element.get(target) is not None:
            element.set(target, NOWHERE)
        for attribute, value in element.items():
            refers = attribute == "file" or attribute.endswith("File")
            # A picture is for the GUI, which there is none of.
            if refers and value != NOWHERE and attribute not in ("imgFile", "osgFile"):
                name = f"{element.tag} {element.get('id', '')}".strip()
                raise SimulationError(
                    f"{path}: {name}: {attribute}={value[:60]!r}: references to other files are"
                    " not accepted"
                )
    return ElementTree.tostring(root, encoding="unicode")


def _check_departures(
    path: Path, root: ElementTree.Element, types: frozenset[str], routes: frozenset[str]
) -> None:
    latest, latest_name = 0.0, ""
    for element in root:
        if element.tag not in DEPARTING:
            continue
        name = f"{element.tag} {element.get('id', '?')}"
        if element.get("type") is not None and element.get("type") not in types:
            raise SimulationError(f"{path}: {name}: unknown vType {element.get('type')!r}")
        if element.get("route") is not None and element.get("route") not in routes:
            raise SimulationError(f"{path}: {name}: unknown route {element.get('route')!r}")
        departure = _departure(path, name, element)
        if departure is None:
            continue
        if departure < latest:
            raise SimulationError(
                f"{path}: {name} departs at {departure:g} s but stands after {latest_name}, which"
                f" departs at {latest:g} s; SUMO drops what is not sorted by departure"
            )
        latest, latest_name = departure, name


def _check_parameters(path: Path, root: ElementTree.Element) -> None:
    """Refuse parameters by which a vehicle's device or a traffic light would write a file."""
    for parameter in root.iter("param"):
        key = parameter.get("key", "")
        device = key.startswith("device.") and key.endswith((".file", ".output"))
        if (device or key == "file") and parameter.get("value") != NOWHERE:
            raise SimulationError(f"{path}: param {key!r} would write a file; take it out")


def _check_lanes(path: Path, name: str, edge: ElementTree.Element) -> None:
    lanes = edge.findall("lane")
    if not lanes:
        raise SimulationError(f"{path}: edge {name} has no <lane>")
    for lane in lanes:
        try:
            if not float(lane.get("length", "")) > 0 or not float(lane.get("speed", "")) > 0:
                raise ValueError
            corners = [tuple(map(float, p.split(","))) for p in lane.get("shape", "").split()]
            if len(corners) < 2 or any(len(corner) not in (2, 3) for corner in corners):
                raise ValueError
        except ValueError:
            raise SimulationError(
                f"{path}: lane {lane.get('id', '?')} of edge {name}: expected a positive length and"
                " speed, and a shape of at least two points"
            ) from None


def _ids(root: ElementTree.Element, *tags: str) -> frozenset[str]:
    return frozenset(element.get("id", "") for tag in tags for element in root.iter(tag))


def _departure(path: Path, name: str, element: ElementTree.Element) -> float | None:
    """Seconds, or None for a departure that waits for something else ("triggered")."""
    attribute = "begin" if element.tag.lower().endswith("flow") else "depart"
    text = element.get(attribute, "0" if attribute == "begin" else "")
    if text in ("triggered", "containerTriggered", "split"):
        return None
    try:
        return seconds(text)
    except ValueError:
        raise SimulationError(
            f"{path}: {name}: {attribute}={text!r} is not a number of seconds"
        ) from None


def _check_edges(path: Path, root: ElementTree.Element, edges: frozenset[str]) -> None:
    for owner, attribute, edge in _edges_used(root):
        if edge not in edges:
            raise SimulationError(f"{path}: {owner}: {attribute} names unknown edge {edge!r}")


def _edges_used(root: ElementTree.Element) -> Iterator[tuple[str, str, str]]:
    for element in root.iter():
        owner = f"{element.tag} {element.get('id', '')}".strip()
        if element.tag == "route":
            yield from ((owner, "edges", edge) for edge in element.get("edges", "").split())
        if element.tag in ("trip", "flow", "vehicle"):
            for attribute in ("from", "to", "via"):
                for edge in element.get(attribute, "").split():
                    yield owner, attribute, edge
        if element.tag == "stop" and element.get("lane"):
            yield owner, "lane", element.get("lane", "").rpartition("_")[0]
