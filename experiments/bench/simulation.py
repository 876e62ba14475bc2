"""Dense traffic: what its trace and detections cost beside SUMO, all processes included."""

import dataclasses
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import scenarios
from experiments.bench.measure import Block, Case
from experiments.bench.plan import Plan
from experiments.bench.start_up import children
from scenarios import RoutedScenario
from sim_bridge import detect, simulate, sumo, sumo_process

WHAT = "simulation"
TIER = "process"
TRACE, DETECTIONS = "trace", "detections"
SEED = 0
VEHICLES = 200
"""About as many are there at once in bus_stop with the most traffic."""
ALONE = """
import json, runpy, sys
options = runpy.run_path(sys.argv[1])["options"]
import libsumo
request = json.loads(sys.argv[2])
libsumo.start(options(request))
for _ in range(request["steps"]):
    libsumo.simulationStep()
libsumo.close()
"""
"""The same traffic, and nothing asked about it."""


def cpu_time() -> float:
    """CPU time of this process and of all that it has started and waited for [s]."""
    return time.process_time() + children()


def blocks(plan: Plan) -> list[Block]:
    """One block: a trace beside SUMO without one, both with the warm-up before it, and detections
    of the trace."""
    dense = world(plan.simulated)
    simulated = cache(lambda: simulate(dense, SEED))
    trace = _case(TRACE, lambda _: simulate(dense, SEED))
    alone = _case("SUMO alone", lambda _: sumo_alone(dense))
    detections = _case(DETECTIONS, lambda found: detect(found, seed=SEED), simulated)
    return [Block((trace, detections, alone), anchor=alone)]


def world(duration: float) -> RoutedScenario:
    """bus_stop with the most traffic, for so many seconds."""
    most = {
        spec.name: spec.maximum
        for spec in scenarios.load("bus_stop").parameter_specs
        if spec.name.endswith("traffic")
    }
    scenario = scenarios.load("bus_stop", **most)
    assert isinstance(scenario, RoutedScenario)
    return dataclasses.replace(scenario, duration=duration)


def sumo_alone(scenario: RoutedScenario) -> None:
    """Run SUMO for as long as a trace of the scenario needs, in a process of its own."""
    with tempfile.TemporaryDirectory() as scratch:
        routes = Path(scratch, "routes.rou.xml")
        routes.write_text(scenario.route_xml(), encoding="utf-8")
        request = {
            "network": str(scenario.network.resolve()),
            "routes": [str(routes)],
            "additional": [],
            "options": {},
            "begin": scenario.begin,
            "seed": SEED,
            "step": sumo.STEP,
            "steps": round((scenario.warmup + scenario.duration) / sumo.STEP),
        }
        command = [sys.executable, "-P", "-c", ALONE, sumo_process.__file__, json.dumps(request)]
        subprocess.run(command, check=True, capture_output=True)


def _case(
    name: str, run: Callable[[Any], object], prepare: Callable[[], object] = lambda: None
) -> Case:
    return Case(WHAT, name, TIER, VEHICLES, 1, "s", 1.0, prepare, run)
