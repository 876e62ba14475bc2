"""RobMOT's settings of the tracker, one set for each detector (Nagy et al., 2024)."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, get_args

import numpy as np

Cost = Literal["distance", "mahalanobis"]
Assignment = Literal["greedy", "optimal"]
Position = Literal["posterior", "measurement"]
Confirmation = Literal["retrospective", "online"]


@dataclass(frozen=True)
class TrackerSettings:
    """Rules and reporting of a tracker.

    gate: largest cost of a prediction and its detection, exclusive: [m], or standard deviations
        where the cost is Mahalanobis' distance.
    validity: a track is confirmed for good once its validity exceeds this.
    score, confirmed_score: detections below the second are dropped; those between the two count
        only within the gate of a confirmed track.
    x_var, y_var: variances of a detection along the world's axes [m2].
    max_variance: a track is deleted once its predicted variance along x or y exceeds this [m2].
    max_missed: a track is deleted after more frames than this without a detection; None: never.
    cost: bird's-eye `distance` (RobMOT) or `mahalanobis` distance of prediction and detection.
    assignment: `greedy`, the pair of least cost first (RobMOT), or `optimal`, the least sum of
        costs.
    position: what a track reports in frames with a detection: the filter's `posterior` or the
        `measurement` itself (RobMOT).
    coasting: whether tracks are reported in frames without a detection.
    confirmation: `retrospective` removes the rows of never-confirmed tracks at the end (RobMOT),
        `online` reports a track from its confirmation on.
    """

    gate: float
    validity: float
    score: float
    confirmed_score: float
    x_var: float
    y_var: float
    max_variance: float = 4.0
    max_missed: int | None = None
    cost: Cost = "distance"
    assignment: Assignment = "greedy"
    position: Position = "posterior"
    coasting: bool = True
    confirmation: Confirmation = "retrospective"

    def __post_init__(self) -> None:
        positive = ("gate", "x_var", "y_var", "max_variance")
        for name in (*positive, "validity", "score", "confirmed_score"):
            # Equal settings read alike wherever they are told.
            value = float(getattr(self, name))
            object.__setattr__(self, name, value)
            if name in positive and not (np.isfinite(value) and value > 0):
                raise ValueError(f"{name} is {value}, expected a number above 0")
            if np.isnan(value):
                raise ValueError(f"{name} is {value}, expected a number")
        if self.max_missed is not None and self.max_missed < 0:
            raise ValueError(f"max_missed is {self.max_missed}, expected a count of frames")
        for option, kind in (
            ("cost", Cost),
            ("assignment", Assignment),
            ("position", Position),
            ("confirmation", Confirmation),
        ):
            if getattr(self, option) not in get_args(kind):
                value = getattr(self, option)
                raise ValueError(f"{option} is {value!r}, expected one of {get_args(kind)}")


DETECTORS: Mapping[str, TrackerSettings] = MappingProxyType(
    {
        "virconv": TrackerSettings(4, 20, 0, -1, 0.017221, 0.005901),
        "casa": TrackerSettings(3, 25, 0, 0, 0.034966, 0.019720),
        "pointrcnn": TrackerSettings(4, 35, 0, 0, 0.030874, 0.009379),
        "pvrcnn": TrackerSettings(2, 20, 0.5, 0.5, 0.036383, 0.013067),
        "second": TrackerSettings(3, 10, -1, -2, 0.039156, 0.014357),
        "casa-waymo": TrackerSettings(4, 8, 0.75, 0.75, 0.030696, 0.015416),
        "ctrl-waymo": TrackerSettings(4, 4, 0.6, 0.6, 0.030696, 0.015416),
    }
)
"""RobMOT's settings by detector; the last two for Waymo."""

FOLDERS: Mapping[str, str] = MappingProxyType({"pvcnn": "pvrcnn", "second_iou": "second"})
"""Detectors by the names of RobMOT's folders of detections, where these are not their own."""


def tracker_settings(name: str) -> TrackerSettings:
    """The settings of a detector, or of a folder of RobMOT's; `ValueError` for an unknown name."""
    name = FOLDERS.get(name, name)
    if name not in DETECTORS:
        known = ", ".join(DETECTORS)
        raise ValueError(f"no tracker settings for {name!r}, expected one of: {known}")
    return DETECTORS[name]
