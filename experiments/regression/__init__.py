"""Regression tests on synthetic traces: a tracker's scores pinned beside the user's own tests.

`assert_no_regression` compares tracks of a world with a baseline file; the pytest plugin
(`pytest_mdkf`) gives it, and worlds by name, as fixtures. Golden worlds come with the package.
"""

from experiments.regression.baseline import BaselineError
from experiments.regression.check import Regression, assert_no_regression
from experiments.regression.golden import golden_detections, golden_names, golden_trace
from experiments.regression.metrics import METRICS

__all__ = [
    "METRICS",
    "BaselineError",
    "Regression",
    "assert_no_regression",
    "golden_detections",
    "golden_names",
    "golden_trace",
]
