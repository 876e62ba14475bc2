"""MD's free choices, one at a time: names and values into estimators and rules of the tracker.

Everything else stays as the paper has it. What a choice has in common with the opponents, process
noise and the bound beyond which tracks are deleted, is varied for them too.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import product
from typing import Any

import numpy as np

from mdkf import Estimator, Kalman, MotionDynamics, TrackerSettings, estimator
from mdkf.kalman import KalmanState
from mdkf.motion import PROCESS_NOISE
from mdkf.motion_dynamics import FACTORS

SUBJECT = "md"
OPPONENTS = ("ca", "imm", "imm-zero")
WINDOWS = (3, 5, 10, 20, 30)
TIMES = (0.25, 0.5, 1.0, 2.0, 4.0)
"""What lengths l_v and l_a are multiplied by."""
NOISES = (0.1, 0.3, 1.0, 3.0, 10.0)
"""What RobMOT's process noise is multiplied by."""
BOUNDS = (3.0, 4.0, 8.0, 16.0, 32.0)
"""Variances beyond which a track is deleted [m2]; RobMOT's is 4. Up to 2, which a track starts
with, none would live."""
DELETION = "deletion bound [m²]"


@dataclass(frozen=True)
class ConstantWeights(Kalman):
    """A Kalman filter whose prediction is F W x with W = diag(1, weights) always the same: MD-KF
    that adapts to nothing. P is predicted "as usual"."""

    weights: tuple[float, ...] = (1.0, 0.8)

    def predict(self, state: KalmanState, dt: float) -> KalmanState:
        """States dt [s] later."""
        weighted = state.mean * np.tile((1.0, *self.weights), 2)
        return super().predict(replace(state, mean=weighted), dt)


@dataclass(frozen=True)
class Variant:
    """One value of a choice, for one filter.

    name: what rows call it; that of the filter where the value is the paper's, or RobMOT's. rules:
    of the tracker, in place of the detector's.
    """

    choice: str
    value: str
    filter: str
    name: str
    estimator: Estimator
    rules: Mapping[str, Any] = field(default_factory=dict)


@cache
def variants() -> tuple[Variant, ...]:
    """All values of all choices, choice by choice, each in order."""
    md = MotionDynamics()
    l_v, l_a = FACTORS[2]
    found = [
        *(_md("window", str(k), replace(md, window=k)) for k in WINDOWS),
        *(_md("l_v [m]", f"{l_v * k:g}", replace(md, factors=(l_v * k, l_a))) for k in TIMES),
        *(_md("l_a [m]", f"{l_a * k:g}", replace(md, factors=(l_v, l_a * k))) for k in TIMES),
        _md("weights", "adaptive", md),
        _md("weights", "1, 0.8", ConstantWeights()),
        _md("weights", "1, 1", Kalman(order=2)),
        _md("denoise", "literal", md),
        *(
            _md("denoise", value, replace(md, denoise=value))
            for value in ("innovation", "posterior", "raw")
        ),
        _md("covariance", "F", md),
        _md("covariance", "FW", replace(md, covariance_by="FW")),
        _md("after a gap", "reset", md),
        _md("after a gap", "keep", replace(md, after_gap="keep")),
        _md("axes", "independent", md),
        _md("axes", "joint", replace(md, axes="joint")),
    ]
    filters = (SUBJECT, *OPPONENTS)
    for name, times in product(filters, NOISES):
        built: Any = estimator(name)
        noisy = replace(built, process_density=tuple(q * times for q in PROCESS_NOISE))
        found.append(_variant("process noise, × RobMOT's", f"{times:g}", name, noisy, times == 1))
    for name, bound in product(filters, BOUNDS):
        usual = bound == TrackerSettings.max_variance
        rules = {} if usual else {"max_variance": bound}
        known = estimator(name)
        found.append(_variant(DELETION, f"{bound:g}", name, known, usual, rules))
    return tuple(found)


def _md(choice: str, value: str, built: Estimator) -> Variant:
    """A value of MD's own choice."""
    usual = isinstance(built, MotionDynamics) and (
        replace(built, factors=None) == MotionDynamics() and built.motion_factors == FACTORS[2]
    )
    return _variant(choice, value, SUBJECT, built, usual)


def _variant(
    choice: str,
    value: str,
    name: str,
    built: Estimator,
    usual: bool,
    rules: Mapping[str, Any] | None = None,
) -> Variant:
    told = name if usual else f"{name}, {choice} {value}"
    return Variant(choice, value, name, told, built, rules or {})
