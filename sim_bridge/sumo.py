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
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from scenarios import ConfiguredScenario, SumoScenario
from scenarios.scenario import EGO
from sim_bridge.network_check import (
    SimulationError,
    check_network,
    check_routes,
    without_outputs,
)
from sim_bridge.recording import Recording
from sim_bridge.sumo_process import REPORT, SAMPLES

STEP = 0.1  # s; finer steps make SUMO's jerk worse
TIMEOUT, TIMEOUT_PER_SECOND = 300.0, 5.0
"""Wall clock after which SUMO is taken to hang [s], and how much more it has for each second that
it simulates; the catalogue's scenarios need about 2 s in all."""
MAX_SEED = 2**31 - 1  # SUMO reads its seed as a 32-bit integer
REACH = 200.0
"""Distance from the sensor within which the objects of a user's configuration are recorded [m]:
what hides something within a LiDAR's range is nearer still, and a smooth motion needs a run-up."""
MIN_DURATION = 1.0  # s; the shortest trace of a user's configuration
SYSTEM_PACKAGES = "libx11-6 libxext6 libxrender1 libgl1 libatomic1 libexpat1"

_CHILD = Path(__file__).with_name("sumo_process.py")


class Accident(SimulationError):
    """Vehicles collided or teleported: the inputs may be good, but this seed is of no use."""


def run_sumo(
    scenario: SumoScenario, seed: int, *, margin: float = 0.0, timeout: float | None = None
) -> Recording:
    """Simulate a scenario; the same scenario and seed give the same bits in any process.

    Time index 0 is the end of the warm-up and the last one is `duration` later; `margin` [s]
    records as much more at both ends, so that smoothing has support there; `timeout` is [s] of
    wall clock, by default enough for any but a hanging SUMO.

    Raises `SimulationError` (one line) if an input file is bad, if SUMO fails, drops something or
    crashes, or if the ego never appears; its subclass `Accident` if vehicles collide or teleport.
    """
    if not 0 <= margin <= scenario.warmup:
        raise SimulationError(
            f"scenario {scenario.name}: warmup is {scenario.warmup:g} s, expected at least the"
            f" {margin:g} s that are recorded before the start"
        )
    check_inputs(scenario)
    duration, extra = round(scenario.duration / STEP), round(margin / STEP)
    window = {"first_index": -extra, "last_index": duration + extra, "look_for_ego": False}
    near = REACH if isinstance(scenario, ConfiguredScenario) else 0.0
    with _simulated(scenario, seed, {**window, "reach": near}, timeout) as (folder, report):
        recording = _read_samples(folder, str(report["version"]))
    if scenario.ego not in recording.names:
        raise SimulationError(
            f"{scenario.definition}: the ego vehicle {scenario.ego!r} is not on the road between"
            f" {scenario.warmup:g} s and {scenario.warmup + scenario.duration:g} s"
        )
    return recording


def with_ego(
    scenario: ConfiguredScenario, seed: int, *, margin: float, timeout: float | None = None
) -> ConfiguredScenario:
    """The scenario with the vehicle that carries the sensor, while it is on the road.

    Traffic is the same whoever carries the sensor, so it is simulated once to see who could:
    `ego`, `warmup` and `duration` of the result say who does, and when. margin [s]: how much
    earlier and longer it must be there. Raises `SimulationError` as `run_sumo`, and if there is no
    such vehicle for `MIN_DURATION`.
    """
    check_inputs(scenario)
    duration, extra = round(scenario.duration / STEP), round(margin / STEP)
    window = {"first_index": -extra, "last_index": duration + extra, "look_for_ego": True}
    with _simulated(scenario, seed, {**window, "preferred": EGO}, timeout) as (_, report):
        pass
    begin = scenario.begin + scenario.warmup
    between = f"between {begin:g} s and {begin + scenario.duration:g} s"
    if report["ego"] is None:
        who = f"the ego vehicle {scenario.ego!r} is not" if scenario.ego else "no vehicle is"
        raise SimulationError(f"{scenario.definition}: {who} on the road {between}")
    first, last = report["first"] + extra, report["last"] - extra
    if (last - first) * STEP < MIN_DURATION:
        seconds = (report["last"] - report["first"]) * STEP
        raise SimulationError(
            f"{scenario.definition}: the ego vehicle {report['ego']!r} is on the road for only"
            f" {seconds:.1f} s {between}; expected at least {MIN_DURATION + 2 * margin:g} s"
        )
    return replace(
        scenario,
        ego=report["ego"],
        warmup=round(scenario.warmup + first * STEP, 6),
        duration=round((last - first) * STEP, 6),
    )


def check_inputs(scenario: SumoScenario) -> None:
    """Raise `SimulationError` for whatever is wrong with a scenario's files before SUMO runs."""
    edges = check_network(scenario.network)
    additional = scenario.additional_files()
    # The vehicle of a configuration may come out of a flow: only SUMO knows their names.
    ego = "" if isinstance(scenario, ConfiguredScenario) else scenario.ego
    check_routes(scenario.route_files(), additional, edges, ego)
    for path, content in additional:
        without_outputs(path, content)


@contextmanager
def _simulated(
    scenario: SumoScenario, seed: int, request: dict[str, object], timeout: float | None
) -> Iterator[tuple[Path, dict[str, Any]]]:
    """The folder in which SUMO has left its samples, and its report."""
    if not 0 <= seed <= MAX_SEED:
        raise SimulationError(f"seed must be from 0 to {MAX_SEED}, got {seed}")
    with tempfile.TemporaryDirectory(prefix="mdkf-sumo-") as scratch:
        folder = Path(scratch)
        # SUMO reads copies: templates filled in, and detectors that write nothing.
        originals: dict[str, Path] = {}
        copies: dict[str, list[str]] = {"routes": [], "additional": []}
        for kind, files in (
            ("routes", scenario.route_files()),
            ("additional", scenario.additional_files()),
        ):
            for path, content in files:
                copy = folder / f"{kind}-{len(originals)}.xml"
                if kind == "additional":
                    content = without_outputs(path, content)
                copy.write_text(content, encoding="utf-8")
                originals[str(copy)] = path
                copies[kind].append(str(copy))
        request = {
            "network": str(scenario.network.resolve()),
            **copies,
            "begin": scenario.begin,
            "options": dict(scenario.options),
            "seed": int(seed),
            "step": STEP,
            "steps_before": round(scenario.warmup / STEP),
            "ego": scenario.ego,
            **request,
        }
        simulated = scenario.warmup + scenario.duration
        limit = TIMEOUT + TIMEOUT_PER_SECOND * simulated if timeout is None else timeout
        messages = _run_child(folder, request, scenario, limit)
        yield folder, _checked_report(folder, messages, scenario, originals)


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
            f"SUMO did not finish within {timeout:g} s on {scenario.network}; simulate a shorter"
            " time or fewer vehicles"
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


def _checked_report(
    folder: Path, messages: str, scenario: SumoScenario, originals: dict[str, Path]
) -> dict[str, Any]:
    """Turn everything SUMO complained of into an error; return its report."""
    try:
        report: dict[str, Any] = json.loads((folder / REPORT).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        raise SimulationError(
            f"SUMO quit without a result on {scenario.network}: {_last_line(messages)}"
        ) from None

    def told(text: str) -> str:
        for copy, original in originals.items():
            text = text.replace(copy, str(original))
        return text

    if report["problem"] == "import":
        raise SimulationError(_import_advice(report["message"]))
    complaint = _complaint(told(messages))
    if report["problem"] == "sumo":
        raise SimulationError(f"SUMO: {complaint or _one_line(told(report['message']))}")
    if report["problem"] == "accident":
        raise Accident(f"scenario {scenario.name}: {_one_line(report['message'])}")
    if report["problem"] is not None:
        raise SimulationError(f"scenario {scenario.name}: {_one_line(report['message'])}")
    if complaint:
        raise SimulationError(f"SUMO: {complaint}")
    return report


def _complaint(messages: str) -> str | None:
    """The first error, or warning that something was left out, among SUMO's messages."""
    for line, following in pairwise([*messages.splitlines(), ""]):
        if re.search(r"^\s*Error:|\bignor(?:ed|es|ing|e)\b", line, flags=re.IGNORECASE):
            # What comes after a colon is what is wrong.
            return _one_line(f"{line} {following}" if line.rstrip().endswith(":") else line)
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
