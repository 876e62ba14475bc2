"""Claim: memory grows with the rows of a trace and with nothing else, by a small factor.

Measured in a process of its own, for a short and for a long recording of the same traffic: what
grows from one to the other is neither the interpreter's nor a compiled kernel's.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
MEASURE = """
import dataclasses, json, resource, tracemalloc
import scenarios
from sim_bridge import simulate

busy = scenarios.load("bus_stop", traffic=0.6, frontage_traffic=0.4, bus_traffic=0.1)

def measured(duration):
    scenario = dataclasses.replace(busy, duration=duration)
    tracemalloc.start()
    trace = simulate(scenario, 0)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    child = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024
    return len(trace), sum(column.nbytes for column in trace.columns().values()), peak, child

measured(2.0)
print(json.dumps([measured(15.0), measured(60.0)]))
"""


@pytest.fixture(scope="module")
def growth() -> dict[str, float]:
    """What 45 s more of 200 vehicles add: rows, and bytes of trace, of this project's process at
    its peak, and of SUMO's."""
    done = subprocess.run(
        [sys.executable, "-P", "-c", MEASURE],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    short, long = json.loads(done.stdout)
    names = ("rows", "trace", "peak", "child")
    return {name: b - a for name, a, b in zip(names, short, long, strict=True)}


def test_a_trace_takes_less_than_thrice_its_size_to_make(growth: dict[str, float]) -> None:
    """At the peak, everything included."""
    assert growth["rows"] > 80_000
    assert growth["trace"] <= growth["peak"] < 3.0 * growth["trace"]


def test_sumos_process_keeps_a_few_numbers_per_row(growth: dict[str, float]) -> None:
    """Six machine numbers, and twice that while they are sorted and written; SUMO's own memory
    grows with its traffic."""
    assert growth["child"] < 250 * growth["rows"]
