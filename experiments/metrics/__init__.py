"""Truth and tracks of one or more sequences into HOTA, CLEAR and Identity scores.

Pure functions: build a `Sequence` once, from boxes or from similarities, hand it to `hota`, `clear`
and `identity`, and join the scores of several sequences with the `combine_*` functions. The numbers
are those of TrackEval wherever a score has a value; a score whose denominator is empty is NaN,
never 0 or 1.
"""

from experiments.metrics.boxes import (
    COLUMNS,
    Pairs,
    Similarity,
    bird_iou,
    box_iou,
    centre_similarity,
    image_coverage,
    image_iou,
)
from experiments.metrics.clear import (
    ClearMatches,
    ClearScores,
    clear,
    clear_matches,
    clear_of,
    combine_clear,
)
from experiments.metrics.hota import ALPHAS, HotaScores, combine_hota, hota
from experiments.metrics.identity import IdentityScores, combine_identity, identity
from experiments.metrics.matching import Sequence, sequence_from_matrices, sequence_from_rows

__all__ = [
    "ALPHAS",
    "COLUMNS",
    "ClearMatches",
    "ClearScores",
    "HotaScores",
    "IdentityScores",
    "Pairs",
    "Sequence",
    "Similarity",
    "bird_iou",
    "box_iou",
    "centre_similarity",
    "clear",
    "clear_matches",
    "clear_of",
    "combine_clear",
    "combine_hota",
    "combine_identity",
    "hota",
    "identity",
    "image_coverage",
    "image_iou",
    "sequence_from_matrices",
    "sequence_from_rows",
]
