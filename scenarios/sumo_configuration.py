"""Turns a user's SUMO configuration (.sumocfg) into what the bridge takes of it.

Inputs: `net-file`, `route-files`, `additional-files`, `begin`, `end`. Options that decide how
traffic flows are handed on to SUMO. The bridge has its own step length, integration method, lateral
resolution, seed, and treatment of collisions and teleports: the truth of a trace must be smooth.
Outputs, reports, TraCI and the GUI are left out: nothing of the user's is ever written. Any other
option changes the traffic in a way that the bridge does not know, and is refused.
"""

import difflib
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

from scenarios.scenario import ScenarioError, SumoConfiguration
from scenarios.sumo_files import parse_xml, read_bytes, seconds

SUFFIX = ".sumocfg"

MAX_SIZE = 1_000_000  # bytes

_TAKEN: Mapping[str, tuple[str, ...]] = {
    "net-file": ("n", "net"),
    "route-files": ("r", "routes"),
    "additional-files": ("a", "additional"),
    "begin": ("b",),
    "end": ("e",),
}
"""Options that say what to simulate, with their other names."""

_KEPT = (
    *("default.", "device.rerouting.", "tls.", "weights.", "routing-algorithm"),
    *("scale", "max-num-vehicles", "max-depart-delay", "random-depart-offset", "route-steps"),
    *("insertion-checks", "sloppy-insert", "eager-insert", "emergency-insert"),
    *("extrapolate-departpos", "keep-after-arrival", "junction-taz", "ignore-route-errors"),
    *("ignore-junction-blocker", "waiting-time-memory", "startup-wait-threshold"),
    *("time-to-impatience", "lanechange.overtake-right", "parking.maneuver", "use-stop-"),
    *("pedestrian.model", "pedestrian.striping.", "emergencydecel.warning-threshold"),
)
"""Options handed on to SUMO, as far as they are not left out."""

_LEFT_OUT = (
    # What the bridge decides itself; `sim_bridge.sumo_process` says why.
    *("step-length", "step-method.ballistic", "lateral-resolution", "lanechange.duration"),
    *("time-to-teleport", "max-num-teleports", "collision.", "intermodal-collision."),
    *("seed", "srand", "random", "abs-rand", "thread-rngs", "threads", "routing-threads"),
    *("device.rerouting.threads", "device.rerouting.output"),
    # Outputs.
    *("write-license", "write-metadata", "output-", "output.", "precision", "human-readable-time"),
    *("H", "netstate", "netstate-", "ndump", "dump-", "emission-", "battery-", "elechybrid-"),
    *("chargingstations-", "overheadwiresegments-", "substations-", "fcd-", "person-fcd"),
    *("person-fcd-", "full-", "queue-", "vtk-", "amitran-", "summary", "summary-"),
    *("person-summary-", "tripinfo", "tripinfo-", "personinfo", "personinfo-", "vehroutes"),
    *("vehroute-", "personroutes", "personroute-", "link-output", "railsignal-block-output"),
    *("railsignal-vehicle-output", "bt-output", "lanechange-output", "stop-output"),
    *("collision-output", "edgedata-output", "lanedata-output", "statistic-", "statistics-"),
    *("deadlock-output", "save-", "device.fcd.", "device.ssm.", "device.emissions."),
    *("device.tripinfo.", "device.vehroute.", "device.btreceiver.", "device.btsender."),
    *("person-device.fcd.", "emissions.", "phemlight-", "device.battery."),
    # Reports, TraCI and the GUI.
    *("verbose", "v", "print-options", "xml-validation", "X", "no-warnings", "W"),
    *("suppress-warnings", "aggregate-warnings", "log", "l", "log-file", "message-log"),
    *("error-log", "language", "duration-log.", "no-duration-log", "t", "no-step-log"),
    *("step-log.", "remote-port", "num-clients", "gui-", "g", "quit-on-end", "Q", "game", "G"),
    *("start", "S", "delay", "d", "breakpoints", "B", "edgedata-files", "data-files", "m"),
    *("alternative-net-file", "N", "selection-file", "demo", "D", "disable-textures", "T"),
    *("registry-viewport", "window-", "tracker-interval"),
)
"""Options that have no effect here."""


def is_configuration(path: Path) -> bool:
    """Whether a path names a SUMO configuration."""
    return path.suffix.lower() == SUFFIX


def read_configuration(path: Path) -> SumoConfiguration:
    """Read and check a configuration; file names in it are relative to the file itself.

    Raises `ScenarioError`, one line that names the file, the option and what was expected.
    """
    content = read_bytes(path, ScenarioError)
    if len(content) > MAX_SIZE:
        raise ScenarioError(f"{path}: is larger than {MAX_SIZE} bytes; expected a configuration")
    root = parse_xml(path, content, ScenarioError)
    if root.tag not in ("configuration", "sumoConfiguration"):
        raise ScenarioError(
            f"{path}: expected a SUMO configuration <sumoConfiguration>, found <{root.tag[:60]}>"
        )
    options = _options(path, root)
    network = _files(path, "net-file", options)
    if len(network) != 1:
        raise ScenarioError(f"{path}: option net-file: expected one file, found {len(network)}")
    routes = _files(path, "route-files", options)
    if not routes:
        raise ScenarioError(f"{path}: option route-files: expected at least one file, found none")
    begin = _time(path, "begin", options, 0.0)
    end = _time(path, "end", options, -1.0)
    if 0 <= end <= begin:
        raise ScenarioError(
            f"{path}: option end: expected a time after begin ({begin:g} s), found {end:g} s"
        )
    return SumoConfiguration(
        path=path,
        network=network[0],
        routes=routes,
        additional=_files(path, "additional-files", options),
        begin=begin,
        end=end if end >= 0 else None,  # a negative end is SUMO's way to say "none"
        options={name: value for name, value in sorted(options.items()) if name not in _TAKEN},
    )


def _options(path: Path, root: ElementTree.Element) -> dict[str, str]:
    """Options that have an effect, by their full names."""
    synonyms = {short: name for name, others in _TAKEN.items() for short in others}
    options: dict[str, str] = {}
    for element in root.iter():
        value = element.get("value", element.get("v"))
        if element is root or len(element) or value is None:
            continue
        name = synonyms.get(element.tag, element.tag)
        if _is_one_of(name, _LEFT_OUT):
            continue
        if name not in _TAKEN and not _is_one_of(name, _KEPT):
            close = difflib.get_close_matches(name, [*_TAKEN, *_KEPT], n=1)
            hint = f" (did you mean {close[0]}?)" if close else ""
            raise ScenarioError(
                f"{path}: option {name[:60]!r} is none that the bridge can keep{hint}; take it out"
            )
        if name in options:
            raise ScenarioError(f"{path}: option {name} is given twice")
        options[name] = value
    return options


def _is_one_of(name: str, patterns: tuple[str, ...]) -> bool:
    """A pattern that ends in a dot or a dash stands for all options that begin so; any other for
    itself and what is said more closely about it after a dot."""
    return any(
        name == pattern or name.startswith(pattern if pattern[-1] in ".-" else f"{pattern}.")
        for pattern in patterns
    )


def _files(path: Path, option: str, options: Mapping[str, str]) -> tuple[Path, ...]:
    files = []
    for name in filter(None, map(str.strip, options.get(option, "").split(","))):
        file = path.resolve().parent / name
        try:
            found = file.is_file()
        except (OSError, ValueError):
            found = False
        if not found:
            raise ScenarioError(f"{path}: option {option}: no such file: {name[:200]}")
        files.append(file)
    return tuple(files)


def _time(path: Path, option: str, options: Mapping[str, str], default: float) -> float:
    text = options.get(option)
    try:
        return default if text is None else seconds(text)
    except ValueError:
        raise ScenarioError(
            f"{path}: option {option}: expected seconds or hours:minutes:seconds,"
            f" found {text[:60]!r}"  # type: ignore[index]
        ) from None
