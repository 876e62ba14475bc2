"""Questions into answers: the occlusion protocol, scores, runs over many worlds, reports."""

from experiments.occlusion import Gaps, OcclusionProtocol
from experiments.score import Scores, score

__all__ = ["Gaps", "OcclusionProtocol", "Scores", "score"]
