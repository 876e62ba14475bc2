"""Questions into answers: the occlusion protocol, scores, runs over many worlds, reports, plots.

What is named here is imported when it is asked for: pytest loads the plugin in
`experiments.regression` wherever mdkf is installed, and shall not wait for what nobody uses.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from experiments.gaps import Gaps
    from experiments.occlusion import OcclusionProtocol
    from experiments.plots import plot
    from experiments.scoring import Scores, score

__all__ = ["Gaps", "OcclusionProtocol", "Scores", "plot", "score"]

_MODULES = {
    "Gaps": "experiments.gaps",
    "OcclusionProtocol": "experiments.occlusion",
    "Scores": "experiments.scoring",
    "plot": "experiments.plots",
    "score": "experiments.scoring",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)
