"""Turns SUMO's input files into one clear error before SUMO sees them, or into a pass.

SUMO dies of some bad networks (`<net/>` is a segmentation fault) and silently drops flows that are
out of order, so both files are read here first.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path

MAX_NETWORK_SIZE = 500_000_000  # bytes
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
DEPARTING = ("vehicle", "trip", "flow", "person", "personFlow", "container", "containerFlow")


class SimulationError(ValueError):
    """A simulation that cannot be run or trusted; the message is one line."""


def check_network(path: Path) -> frozenset[str]:
    """Names of a network's edges (internal ones left out).

    Raises `SimulationError` if the file is not a complete SUMO network.
    """
    try:
        if path.stat().st_size > MAX_NETWORK_SIZE:
            raise SimulationError(f"{path}: is larger than {MAX_NETWORK_SIZE} bytes")
        content = path.read_bytes()
    except OSError as error:
        raise SimulationError(f"{path}: cannot be read: {error.strerror}") from None
    root = _parse(path, content)
    if root.tag != "net":
        raise SimulationError(f"{path}: expected a SUMO network <net>, found <{root.tag}>")
    for tag in ("location", "edge", "junction"):
        if root.find(tag) is None:
            raise SimulationError(f"{path}: the network has no <{tag}>")
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


def check_routes(path: Path, content: str, edges: frozenset[str], ego: str) -> None:
    """Check the contents of a route file (already filled in) against a network's edges.

    Raises `SimulationError` if it is malformed, out of order, refers to what does not exist, or
    lacks the ego vehicle.
    """
    root = _parse(path, content.encode())
    if root.tag != "routes":
        raise SimulationError(f"{path}: expected <routes>, found <{root.tag}>")
    types = BUILT_IN_TYPES | _ids(root, "vType") | _ids(root, "vTypeDistribution")
    routes = _ids(root, "route") | _ids(root, "routeDistribution")
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
    _check_edges(path, root, edges)
    if not any(
        element.get("id") == ego for tag in ("vehicle", "trip") for element in root.iter(tag)
    ):
        raise SimulationError(f"{path}: no <vehicle> or <trip> has the ego's id {ego!r}")


def _parse(path: Path, content: bytes) -> ElementTree.Element:
    # Entities can reach other files, or expand without end, in SUMO's own parser.
    if b"<!DOCTYPE" in content:
        raise SimulationError(f"{path}: a document type declaration (<!DOCTYPE) is not accepted")
    try:
        return ElementTree.fromstring(content)
    except ElementTree.ParseError as error:
        raise SimulationError(f"{path}: is not well-formed XML: {error}") from None


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


def _ids(root: ElementTree.Element, tag: str) -> set[str]:
    return {element.get("id", "") for element in root.iter(tag)}


def _departure(path: Path, name: str, element: ElementTree.Element) -> float | None:
    """Seconds, or None for a departure that waits for something else ("triggered")."""
    attribute = "begin" if element.tag.lower().endswith("flow") else "depart"
    text = element.get(attribute, "0" if attribute == "begin" else "")
    if text in ("triggered", "containerTriggered", "split"):
        return None
    try:
        return float(text)
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
