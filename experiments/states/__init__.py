"""Tracks and truth into scores of the state: errors, consistency of the covariance, GOSPA.

Pure functions over pairs of rows or sets of places; which rows count and which track is on which
object is for `experiments.population` to say. Every score is a `Value`: a number with its count,
NaN ("no value") where there is nothing to measure, never 0.
"""

from experiments.states.errors import StateErrors, state_errors
from experiments.states.gospa import GospaScores, gospa
from experiments.states.value import Value, consistency, mean, root_mean_square

__all__ = [
    "GospaScores",
    "StateErrors",
    "Value",
    "consistency",
    "gospa",
    "mean",
    "root_mean_square",
    "state_errors",
]
