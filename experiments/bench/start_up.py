"""A fresh process with warm caches: the CPU time until the filters have done their first step."""

import resource
import subprocess
import sys

from experiments.bench.measure import Block, Case
from experiments.bench.plan import Plan

WHAT = "start-up"
TIER = "process"
NAME = "ca, imm, md"
TRACKS = 1
IMPORT = "import mdkf"
FIRST_STEP = f"""{IMPORT}
import numpy as np
R = np.diag([0.03, 0.01])[None]
for name in ("ca", "imm", "md"):
    filter = mdkf.estimator(name)
    state = filter.start(np.zeros((1, 2)), R)
    filter.position(filter.update(filter.predict(state, 0.1), np.ones((1, 2)), R))
"""


def children() -> float:
    """CPU time of all processes that this one has started and waited for [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def blocks(plan: Plan) -> list[Block]:
    """The import alone, and with a prediction and an update of CA, IMM and MD."""
    return [Block((_case("import", 0, IMPORT), _case(NAME, TRACKS, FIRST_STEP)))]


def _case(name: str, tracks: int, code: str) -> Case:
    def run(_: None) -> None:
        subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.DEVNULL)

    return Case(WHAT, name, TIER, tracks, 1, "s", 1.0, lambda: None, run)
