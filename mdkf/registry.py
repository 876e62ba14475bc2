"""Estimators by name, as the commands take them."""

import difflib
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from mdkf.estimator import Estimator
from mdkf.imm import InteractingMultipleModel
from mdkf.kalman import Kalman
from mdkf.motion_dynamics import MotionDynamics

RETUNED_START_VARIANCE = (2.0, 100.0, 8.0, 8.0)
"""Start variances with a speed of 10 m/s in them; RobMOT's 4 (m/s)2 handicaps every filter
on tracks with a short history."""

_NAMED: dict[str, Kalman | InteractingMultipleModel | MotionDynamics] = {
    "cv": Kalman(order=1),
    "ca": Kalman(order=2),
    "cj": Kalman(order=3),
    "imm": InteractingMultipleModel(order=2, mixing="unbiased"),
    "imm-zero": InteractingMultipleModel(order=2, mixing="zero"),
    "md": MotionDynamics(order=2),
    "md-keep": MotionDynamics(order=2, after_gap="keep"),
    "md3": MotionDynamics(order=3),
}

ESTIMATORS: Mapping[str, Estimator] = MappingProxyType(
    {
        **_NAMED,
        **{
            f"{name}-retuned": replace(built, start_variance=RETUNED_START_VARIANCE)
            for name, built in _NAMED.items()
        },
    }
)
"""Estimators by name; `NAME-retuned` starts with the speed variance of 100 (m/s)2."""


def estimator(name: str) -> Estimator:
    """The estimator of a name; `ValueError` lists the known ones."""
    if name not in ESTIMATORS:
        close = difflib.get_close_matches(name, ESTIMATORS, n=1)
        hint = f" (did you mean {close[0]!r}?)" if close else ""
        raise ValueError(f"unknown filter {name!r}{hint}; known filters: {', '.join(ESTIMATORS)}")
    return ESTIMATORS[name]
