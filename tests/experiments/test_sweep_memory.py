"""Claim: the memory of a sweep does not grow with its runs."""

import json
import subprocess
import sys
from pathlib import Path

SCRIPT = """
import json, os, sys
from experiments.sweeps import Sweep, run_sweep

def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")

told = []
sweep = Sweep.of(["constant_velocity", "circle"], ["ca", "md"], 120, occlusions=["mid:10"])
watch = lambda progress: told.append(resident())
run_sweep(sweep, sys.argv[1], workers=1, cached=False, watch=watch)
print(json.dumps(told))
"""


def test_memory_after_many_worlds_is_that_after_some(tmp_path: Path) -> None:
    """Resident memory of a process that does all tasks itself and keeps their rows: after 240
    worlds no more than 10 MB above that after 40, when all that is loaded once is loaded. If the
    trace of each world in between were kept, it would be 20 MB and more."""
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(tmp_path / "out")],
        capture_output=True,
        text=True,
        check=True,
    )
    told = json.loads(done.stdout)
    assert len(told) == 241
    assert max(told[41:]) - told[40] < 10e6
