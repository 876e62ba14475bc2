"""Motion-dynamics, Kalman and interacting-multiple-model filters for multi-object tracking.

The filters and the tracker alone: `Tracker(MotionDynamics()).run(detections)` turns `Detections`
into `Tracks`. Nothing here knows of simulators or files.
"""

from mdkf import testing
from mdkf.estimator import Estimator
from mdkf.imm import InteractingMultipleModel
from mdkf.kalman import Kalman
from mdkf.motion_dynamics import MotionDynamics
from mdkf.registry import ESTIMATORS, estimator, estimator_names
from mdkf.sequence import Estimates, filter_sequence
from mdkf.settings import DETECTORS, TrackerSettings
from mdkf.tables import (
    CLUTTER,
    KINDS,
    REGIMES,
    Detections,
    EgoPath,
    Table,
    TableError,
    Trace,
    Tracks,
)
from mdkf.tracker import Tracker

__all__ = [
    "CLUTTER",
    "DETECTORS",
    "ESTIMATORS",
    "KINDS",
    "REGIMES",
    "Detections",
    "EgoPath",
    "Estimates",
    "Estimator",
    "InteractingMultipleModel",
    "Kalman",
    "MotionDynamics",
    "Table",
    "TableError",
    "Trace",
    "Tracker",
    "TrackerSettings",
    "Tracks",
    "estimator",
    "estimator_names",
    "filter_sequence",
    "testing",
]
