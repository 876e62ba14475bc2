"""Turns a SUMO scenario and a seed into a `Recording` of raw samples.

SUMO runs in a process of its own (`sim_bridge.sumo_process`), since bad input kills it; every way
in which it can fail or quietly do something else comes back as one `SimulationError`.
"""

import json
import os
import re
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from scenarios import SumoScenario
from sim_bridge.network_check import SimulationError, check_network, check_routes
from sim_bridge.recording import Recording
from sim_bridge.sumo_process import REPORT, SAMPLES

STEP = 0.1  # s; finer steps make SUMO's jerk worse
DEFAULT_TIMEOUT = 300.0  # s of wall clock; the catalogue's scenarios need about 2
MAX_SEED = 2**31 - 1  # SUMO reads its seed as a 32-bit integer
SYSTEM_PACKAGES = "libx11-6 libxext6 libxrender1 libgl1 libatomic1 libexpat1"

_CHILD = Path(__file__).with_name("sumo_process.py")


class Accident(SimulationError):
    """Vehicles collided or teleported: the inputs may be good, but this seed is of no use."""


def run_sumo(
    scenario: SumoScenario, seed: int, *, margin: float = 0.0, timeout: float = DEFAULT_TIMEOUT
) -> Recording:
    """Simulate a scenario; the same scenario and seed give the same bits in any process.

    Time index 0 is the end of the warm-up and the last one is `duration` later; `margin` [s]
    records as much more at both ends, so that smoothing has support there; `timeout` is [s] of
    wall clock.

    Raises `SimulationError` (one line) if an input file is bad, if SUMO fails, drops something or
    crashes, or if the ego never appears; its subclass `Accident` if vehicles collide or teleport.
    """
    if not 0 <= seed <= MAX_SEED:
        raise SimulationError(f"seed must be from 0 to {MAX_SEED}, got {seed}")
    if not 0 <= margin <= scenario.warmup:
        raise SimulationError(
            f"scenario {scenario.name}: warmup is {scenario.warmup:g} s, expected at least the"
            f" {margin:g} s that are recorded before the start"
        )
    check_inputs(scenario)
    routes = scenario.route_xml()

    duration, extra = round(scenario.duration / STEP), round(margin / STEP)
    with tempfile.TemporaryDirectory(prefix="mdkf-sumo-") as scratch:
        folder = Path(scratch)
        route_file = folder / "routes.rou.xml"
        route_file.write_text(routes, encoding="utf-8")
        request = {
            "network": str(scenario.network.resolve()),
            "routes": str(route_file),
            "seed": int(seed),
            "step": STEP,
            "steps_before": round(scenario.warmup / STEP),
            "first_index": -extra,
            "last_index": duration + extra,
        }
        messages = _run_child(folder, request, scenario, timeout)
        simulator = _check_report(folder, messages, scenario, route_file)
        recording = _read_samples(folder, simulator)
    if scenario.ego not in recording.names:
        raise SimulationError(
            f"{scenario.routes}: the ego vehicle {scenario.ego!r} is not on the road between"
            f" {scenario.warmup:g} s and {scenario.warmup + scenario.duration:g} s"
        )
    return recording


def check_inputs(scenario: SumoScenario) -> None:
    """Raise `SimulationError` for whatever is wrong with a scenario's files before SUMO runs."""
    edges = check_network(scenario.network)
    check_routes(scenario.routes, scenario.route_xml(), edges, scenario.ego)


def _run_child(
    folder: Path, request: dict[str, object], scenario: SumoScenario, timeout: float
) -> str:
    """Run SUMO and return what it said; `subprocess.run` kills it on Ctrl-C and on time-out."""
    request_file = folder / "request.json"
    request_file.write_text(json.dumps(request), encoding="utf-8")
    # -P keeps this package's folder off the child's path, where its modules would hide others.
    command = [sys.executable, "-P", str(_CHILD.resolve()), str(request_file)]
    try:
        child = subprocess.run(
            command,
            cwd=folder,
            env=os.environ | {"LIBSUMO_AS_TRACI": "quiet"},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=timeout,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise SimulationError(
            f"SUMO did not finish within {timeout:g} s on {scenario.network}"
        ) from None
    messages = child.stdout.decode("utf-8", errors="replace")
    if child.returncode < 0:
        try:
            name = signal.Signals(-child.returncode).name
        except ValueError:
            name = f"signal {-child.returncode}"
        raise SimulationError(f"SUMO crashed ({name}) on {scenario.network}")
    if child.returncode > 0:
        raise SimulationError(
            f"SUMO's process ended with status {child.returncode} on {scenario.network}:"
            f" {_last_line(messages)}"
        )
    return messages


def _check_report(folder: Path, messages: str, scenario: SumoScenario, route_file: Path) -> str:
    """Turn everything SUMO complained of into an error; return its version."""
    try:
        report = json.loads((folder / REPORT).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        raise SimulationError(
            f"SUMO quit without a result on {scenario.network}: {_last_line(messages)}"
        ) from None
    said = messages.replace(str(route_file), str(scenario.routes))
    if report["problem"] == "import":
        raise SimulationError(_import_advice(report["message"]))
    complaint = _complaint(said)
    if report["problem"] == "sumo":
        told = report["message"].replace(str(route_file), str(scenario.routes))
        raise SimulationError(f"SUMO: {complaint or _one_line(told)}")
    if report["problem"] == "accident":
        raise Accident(f"scenario {scenario.name}: {_one_line(report['message'])}")
    if report["problem"] is not None:
        raise SimulationError(f"scenario {scenario.name}: {_one_line(report['message'])}")
    if complaint:
        raise SimulationError(f"SUMO: {complaint}")
    return str(report["version"])


def _complaint(messages: str) -> str | None:
    """The first error, or warning that something was left out, among SUMO's messages."""
    for line in messages.splitlines():
        if re.search(r"^\s*Error:|\bignor(?:ed|es|ing|e)\b", line, flags=re.IGNORECASE):
            return _one_line(line)
    return None


def _import_advice(message: str) -> str:
    if "No module named" in message:
        return f"libsumo is not installed ({_one_line(message)}); run: pip install libsumo"
    return (
        f"libsumo cannot be loaded ({_one_line(message)}); on Debian or Ubuntu run:"
        f" apt-get install {SYSTEM_PACKAGES}"
    )


def _read_samples(folder: Path, simulator: str) -> Recording:
    with np.load(folder / SAMPLES, allow_pickle=False) as samples:
        arrays = dict(samples)
    names, kinds = arrays.pop("names"), arrays.pop("kinds")
    return Recording(
        step=STEP,
        names=tuple(names.tolist()),
        kinds=tuple(kinds.tolist()),
        simulator=simulator,
        **arrays,
    )


def _last_line(messages: str) -> str:
    lines = [line for line in messages.splitlines() if line.strip()]
    return _one_line(lines[-1]) if lines else "it said nothing"


def _one_line(text: str) -> str:
    return " ".join(text.split())[:500]
