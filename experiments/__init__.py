"""Questions into answers: the occlusion protocol, scores, runs over many worlds, reports, plots."""

from typing import TYPE_CHECKING, Any

from experiments.occlusion import Gaps, OcclusionProtocol
from experiments.score import Scores, score

if TYPE_CHECKING:
    from experiments.plots import plot

__all__ = ["Gaps", "OcclusionProtocol", "Scores", "plot", "score"]


def __getattr__(name: str) -> Any:
    # matplotlib takes longer to import than all else here: only who plots waits for it.
    if name == "plot":
        from experiments.plots import plot

        return plot
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
