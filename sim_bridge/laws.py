"""The laws of a detector profile (`sim_bridge.profile`) as functions of what the sensor faces.

The detector draws by them, and a fit looks for their parameters. distance (n,) [m] along the
ground, visible fraction (n,), LiDAR returns (n,).
"""

import numpy as np
from scipy.special import expit

from mdkf.tables import FloatArray
from sim_bridge.profile import Detection, Error, Flip, Score

NEAREST = 3.0
"""Distance below which errors grow no more [m]."""


def detection_probability(
    law: Detection, distance: FloatArray, visible: FloatArray, points: FloatArray
) -> FloatArray:
    """Probability (n,) that an object within the detector's range is detected."""
    reach = law.range - law.range_hidden * (1.0 - visible)
    # Without half_points any return is enough.
    enough = 1.0 - np.exp2(-points / law.half_points) if law.half_points else points > 0.0
    probability: FloatArray = expit((reach - distance) / law.range_width) * enough
    return probability


def flip_odds(law: Flip, distance: FloatArray, visible: FloatArray) -> FloatArray:
    """Logarithm (n,) of the odds that a box looks backwards."""
    return law.constant + law.per_range * distance + law.hidden * (1.0 - visible)


def flip_probability(law: Flip, distance: FloatArray, visible: FloatArray) -> FloatArray:
    """Probability (n,) that a box looks backwards."""
    probability: FloatArray = expit(flip_odds(law, distance, visible))
    return probability


def error_scale(law: Error, distance: FloatArray, visible: FloatArray) -> FloatArray:
    """Scale (n,) of an error's distribution, in the error's own unit."""
    near = law.near / np.maximum(distance, NEAREST)
    by_range = law.constant + near + law.per_range_squared * distance**2
    scale: FloatArray = by_range * (1.0 + law.hidden * (1.0 - visible) ** 2)
    return scale


def mean_score(law: Score, distance: FloatArray, visible: FloatArray) -> FloatArray:
    """Mean (n,) of the raw score before it is turned upwards at the lowest."""
    by_range = np.minimum(law.ceiling, law.constant - law.per_range * distance)
    hidden = law.hidden * (1.0 - visible) * np.minimum(1.0, distance / law.hidden_range)
    score: FloatArray = by_range - hidden
    return score
