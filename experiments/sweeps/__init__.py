"""Sweeps: everything crossed with everything, done once, and never lost.

`run_sweep(Sweep.of(...), "out")`, or `mdkf sweep FILE.yaml --out out`.
"""

from experiments.sweeps.file import read_sweep
from experiments.sweeps.run import SweepResults, run_sweep
from experiments.sweeps.summary import with_parameters
from experiments.sweeps.sweep import Filter, Rules, Sweep, SweepError, crossed

__all__ = [
    "Filter",
    "Rules",
    "Sweep",
    "SweepError",
    "SweepResults",
    "crossed",
    "read_sweep",
    "run_sweep",
    "with_parameters",
]
