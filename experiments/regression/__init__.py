"""Regression tests on synthetic traces: a tracker's scores pinned beside the user's own tests.

`assert_no_regression` compares tracks of a world with a baseline file; the pytest plugin
(`experiments.regression.plugin`) gives it, and worlds by name, as fixtures. Golden worlds come with
the package. What is named here is imported when it is asked for, as in `experiments`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
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

_MODULES = {
    "METRICS": "metrics",
    "BaselineError": "baseline",
    "Regression": "check",
    "assert_no_regression": "check",
    "golden_detections": "golden",
    "golden_names": "golden",
    "golden_trace": "golden",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
