"""The tables that pass between the rooms: trace, ego path, detections, tracks.

One row per object, box or estimate and frame. SI units, radians, right-handed x-y-z, yaw
counter-clockwise from x, everything in the world frame. What they have in common: `mdkf.table`.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from mdkf.columns import BoolArray, CodeArray, FloatArray, IntArray, TableError
from mdkf.table import CLUTTER, Table

__all__ = [
    "CLUTTER",
    "KINDS",
    "REGIMES",
    "UNKNOWN_REGIME",
    "WALL",
    "BoolArray",
    "CodeArray",
    "Detections",
    "EgoPath",
    "FloatArray",
    "IntArray",
    "Table",
    "TableError",
    "Trace",
    "Tracks",
]

KINDS = ("car", "van", "bus", "truck", "bicycle", "pedestrian", "wall")
"""Names of the codes in `Trace.kind`; a `wall` hides what is behind it and is no road user."""

WALL = KINDS.index("wall")

REGIMES = (
    "stationary",
    "constant_velocity",
    "constant_acceleration",
    "changing_acceleration",
    "unknown",
)
"""Names of the codes in `Trace.regime`; `unknown` is for recordings without derivatives."""

UNKNOWN_REGIME = REGIMES.index("unknown")


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class EgoPath(Table):
    """The sensor's pose, one row in every frame: x, y, z [m], yaw [rad]."""

    x: FloatArray
    y: FloatArray
    z: FloatArray
    yaw: FloatArray

    def validate(self) -> None:
        """Raise `TableError` as every table does, and unless there is one row in every frame."""
        super().validate()
        if not np.array_equal(self.frame, np.arange(self.n_frames)):
            raise TableError(f"EgoPath: expected one row in each of the {self.n_frames} frames")


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Trace(Table):
    """Exact truth: one object in one frame, and the sensor's path.

    x, y, z and yaw of the box centre [m, rad]; vx, vy [m/s], ax, ay [m/s2], jx, jy [m/s3] its
    exact derivatives; yaw_rate [rad/s]; length, width, height [m]; kind and regime are codes of
    `KINDS` and `REGIMES`; turning is a flag; visible is the exact visible fraction in [0, 1].
    Derivatives may be NaN where the regime is `unknown`.
    """

    CODED: ClassVar[Mapping[str, tuple[str, ...]]] = {"kind": KINDS, "regime": REGIMES}
    ID = "object_id"
    POSITIVE = ("length", "width", "height")

    object_id: IntArray
    kind: CodeArray
    x: FloatArray
    y: FloatArray
    z: FloatArray
    yaw: FloatArray
    vx: FloatArray
    vy: FloatArray
    ax: FloatArray
    ay: FloatArray
    jx: FloatArray
    jy: FloatArray
    yaw_rate: FloatArray
    length: FloatArray
    width: FloatArray
    height: FloatArray
    regime: CodeArray
    turning: BoolArray
    visible: FloatArray
    ego: EgoPath

    def _digest(self) -> str:
        both = super()._digest() + self.ego.content_hash()
        return hashlib.sha256(both.encode()).hexdigest()

    def sensor_distance(self) -> FloatArray:
        """Ground distance of every row's box centre from the sensor [m]."""
        return np.hypot(self.x - self.ego.x[self.frame], self.y - self.ego.y[self.frame])

    def road_users(self) -> BoolArray:
        """Which rows are there to be detected, tracked and scored: all but those of walls."""
        return np.not_equal(self.kind, WALL)

    def validate(self) -> None:
        """Raise `TableError` as every table does, and for a visible fraction outside [0, 1], an
        object_id below 0, and an ego path that is bad or of other frames.
        """
        super().validate()
        self._refuse((self.visible < 0) | (self.visible > 1), "visible", "in [0, 1]")
        self._refuse(self.object_id < 0, "object_id", "at least 0")
        self.ego.validate()
        if self.ego.n_frames != self.n_frames or self.ego.dt != self.dt:
            raise TableError(
                f"Trace: the ego path has {self.ego.n_frames} frames of {self.ego.dt} s, "
                f"the trace {self.n_frames} of {self.dt} s"
            )

    def _may_miss(self, column: str) -> BoolArray:
        if column in ("vx", "vy", "ax", "ay", "jx", "jy", "yaw_rate"):
            return np.equal(self.regime, UNKNOWN_REGIME)
        return super()._may_miss(column)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Detections(Table):
    """Measured boxes: centre x, y, z [m], yaw [rad], length, width, height [m], score.

    `source` is the object's id, `CLUTTER` for false boxes. It serves the experiments (which
    detections to hide) and is never shown to a tracker. Scores are the detector's raw ones.
    """

    ID = "source"
    POSITIVE = ("length", "width", "height")

    x: FloatArray
    y: FloatArray
    z: FloatArray
    yaw: FloatArray
    length: FloatArray
    width: FloatArray
    height: FloatArray
    score: FloatArray
    source: IntArray

    def validate(self) -> None:
        """Raise `TableError` as every table does, and for a source below `CLUTTER`."""
        super().validate()
        self._refuse(self.source < CLUTTER, "source", f"an object's id or {CLUTTER}")


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Tracks(Table):
    """Estimated boxes: position, yaw and size [m, rad], velocity vx, vy [m/s], score.

    cov_xx, cov_xy, cov_yy [m2] is the covariance of the filter's position; `coasted` marks
    frames without a detection; `diagnostics` are the estimator's own columns (innovation, MD
    weights, IMM mode probabilities), NaN where it has no value.

    Files of other trackers do not tell everything. NaN is what they leave out, in all columns of
    one of `UNKNOWN` together; of `coasted`, `knows_coasting` tells whether it means anything.
    """

    ID = "track_id"
    POSITIVE = ("length", "width", "height")
    BOX: ClassVar[tuple[str, ...]] = ("z", "yaw", "length", "width", "height")
    UNKNOWN: ClassVar[tuple[tuple[str, ...], ...]] = (
        ("vx", "vy"),
        ("cov_xx", "cov_xy", "cov_yy"),
        BOX,
    )
    """Columns that are known together or not at all, row by row."""

    track_id: IntArray
    x: FloatArray
    y: FloatArray
    z: FloatArray
    yaw: FloatArray
    length: FloatArray
    width: FloatArray
    height: FloatArray
    vx: FloatArray
    vy: FloatArray
    cov_xx: FloatArray
    cov_xy: FloatArray
    cov_yy: FloatArray
    score: FloatArray
    coasted: BoolArray
    diagnostics: Mapping[str, FloatArray] = field(default_factory=dict)

    def columns(self) -> dict[str, NDArray[Any]]:
        """All columns by name, the diagnostics last."""
        return {**super().columns(), **self.diagnostics}

    def take(self, rows: IntArray | BoolArray) -> Self:
        """The table of some rows and of their diagnostics, as `Table.take`."""
        columns: dict[str, Any] = {c: getattr(self, c)[rows] for c in self.column_types()}
        return replace(
            self, **columns, diagnostics={c: a[rows] for c, a in self.diagnostics.items()}
        )

    def _may_miss(self, column: str) -> BoolArray:
        # There is no innovation in a frame without a measurement.
        if column in self.diagnostics:
            return np.isnan(self.diagnostics[column])
        for together in self.UNKNOWN:
            if column in together:
                columns = np.column_stack([getattr(self, name) for name in together])
                missing: BoolArray = np.isnan(columns).all(axis=1)
                return missing
        return super()._may_miss(column)

    @property
    def knows_coasting(self) -> bool:
        """Whether `coasted` is known; a tracker's file of boxes does not tell."""
        return self.provenance.get("coasted") != "unknown"

    def knows_boxes(self) -> bool:
        """Whether height, heading and size are known in all rows."""
        return not np.isnan(self.length).any()

    def validate(self) -> None:
        """Raise `TableError` as every table does, and where the covariance is not positive."""
        super().validate()
        with np.errstate(over="ignore", invalid="ignore"):
            determinant = self.cov_xx * self.cov_yy - self.cov_xy**2
        positive = (self.cov_xx > 0) & (determinant > 0)
        self._refuse(~positive & ~np.isnan(self.cov_xx), "cov_xx", "a positive covariance")
