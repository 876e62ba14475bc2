"""The tables that pass between the rooms: trace, ego path, detections, tracks.

Each is a frozen structure of arrays, one row per object, box or estimate and frame, sorted by
(frame, id); `frame_start` holds the offsets, so a frame is a slice. SI units, radians,
right-handed x-y-z, yaw counter-clockwise from x, everything in the world frame. `from_columns` is
where data enters: any row order in, sorted and validated out.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mdkf.columns import (
    BoolArray,
    CodeArray,
    FloatArray,
    IntArray,
    TableError,
    as_column,
    as_count,
    as_time,
    reordered,
    row_order,
)
from mdkf.summary import Summarised

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
CLUTTER = -1
"""`Detections.source` of a box that no object caused."""


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Table(Summarised):
    """Equally long one-dimensional columns over `n_frames` frames of `dt` seconds.

    `provenance` says where the rows came from (scenario, seed, source, versions); it travels
    with the table and into its file, and takes no part in equality.
    """

    CODED: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    ID: ClassVar[str | None] = None
    POSITIVE: ClassVar[tuple[str, ...]] = ()

    n_frames: int
    dt: float
    provenance: Mapping[str, str] = field(default_factory=dict)
    frame: IntArray
    frame_start: IntArray = field(init=False)

    def __post_init__(self) -> None:
        name = type(self).__name__
        object.__setattr__(self, "n_frames", as_count(name, self.n_frames))
        object.__setattr__(self, "dt", as_time(name, self.dt))
        for array in self.columns().values():
            array.flags.writeable = False
        starts = np.searchsorted(self.frame, np.arange(self.n_frames + 1))
        starts.flags.writeable = False
        object.__setattr__(self, "frame_start", starts.astype(np.int64, copy=False))

    @classmethod
    def column_types(cls) -> dict[str, np.dtype[Any]]:
        """Fixed columns in their order with the type that each is stored as."""
        return {f.name: _TYPES[f.type] for f in fields(cls) if f.init and f.type in _TYPES}

    @classmethod
    def from_columns(
        cls, columns: Mapping[str, ArrayLike], *, n_frames: int, dt: float, **others: Any
    ) -> Self:
        """A sorted and validated table from columns in any row order.

        Raises `TableError` for missing, unknown, unequally long or unconvertible columns and for
        whatever `validate` refuses. `others` are the table's further fields (`provenance`, ...).
        """
        types = cls.column_types()
        name = cls.__name__
        if missing := [c for c in types if c not in columns]:
            raise TableError(f"{name}: column {missing[0]!r} is missing; expected {list(types)}")
        if unknown := [c for c in columns if c not in types]:
            raise TableError(f"{name}: unknown column {unknown[0]!r}; expected {list(types)}")
        arrays = {c: as_column(name, c, columns[c], types[c]) for c in types}
        extra = others.pop("diagnostics", None) or {}
        own = {c: as_column(name, c, a, np.dtype(np.float64)) for c, a in extra.items()}
        lengths = {len(a) for a in (*arrays.values(), *own.values())}
        if len(lengths) > 1:
            described = ", ".join(f"{c} {len(a)}" for c, a in (arrays | own).items())
            raise TableError(f"{name}: columns differ in length: {described}")
        order = row_order(arrays, ["frame"] if cls.ID is None else ["frame", cls.ID])
        values: dict[str, Any] = {c: reordered(a, order) for c, a in arrays.items()}
        if own:
            others["diagnostics"] = {c: reordered(a, order) for c, a in own.items()}
        if not isinstance(others.get("provenance", {}), Mapping):
            told = type(others["provenance"]).__name__
            raise TableError(f"{name}: provenance is {told}, expected texts by name")
        table = cls(n_frames=n_frames, dt=dt, **values, **others)
        table.validate()
        return table

    def columns(self) -> dict[str, NDArray[Any]]:
        """All columns by name, in the order in which they are stored."""
        return {c: getattr(self, c) for c in self.column_types()}

    def __len__(self) -> int:
        return len(self.frame)

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and self.content_hash() == other.content_hash()

    __hash__ = None  # type: ignore[assignment]

    def content_hash(self) -> str:
        """SHA-256 of all values (not of the provenance), the same on every machine."""
        return self._content_hash

    @cached_property
    def _content_hash(self) -> str:
        return self._digest()

    def _digest(self) -> str:
        digest = hashlib.sha256()
        digest.update(json.dumps([type(self).__name__, self.n_frames, self.dt]).encode())
        for column, array in self.columns().items():
            digest.update(f"{column}:{array.dtype.str}:{len(array)};".encode())
            digest.update(array.tobytes())
        return digest.hexdigest()

    def frame_rows(self, k: int) -> slice:
        """The rows of frame `k` as a slice; `IndexError` outside 0..n_frames-1."""
        if not 0 <= k < self.n_frames:
            raise IndexError(f"{type(self).__name__}: frame {k} is outside 0..{self.n_frames - 1}")
        return slice(int(self.frame_start[k]), int(self.frame_start[k + 1]))

    def rows_of(self, identifier: int) -> IntArray:
        """The row numbers of one object (or track, or source), in order of frames."""
        if self.ID is None:
            raise TypeError(f"{type(self).__name__} has no objects")
        order, own = self._by_id
        first, last = np.searchsorted(own, [identifier, identifier + 1])
        return order[first:last].copy()

    @cached_property
    def _by_id(self) -> tuple[IntArray, IntArray]:
        """All row numbers by identifier, of each in order of frames, and their identifiers."""
        own = getattr(self, str(self.ID))
        order = np.argsort(own, kind="stable")
        return order, own[order]

    def ids(self) -> IntArray:
        """The identifiers that occur, ascending."""
        if self.ID is None:
            raise TypeError(f"{type(self).__name__} has no objects")
        return np.unique(getattr(self, self.ID))

    def take(self, rows: IntArray | BoolArray) -> Self:
        """The table of some rows (ascending row numbers or a mask); frames keep their numbers."""
        columns: dict[str, Any] = {c: a[rows] for c, a in self.columns().items()}
        return replace(self, **columns)

    def between(self, start: int, stop: int) -> Self:
        """The rows of frames start..stop-1; frames keep their numbers."""
        return self.take((self.frame >= start) & (self.frame < stop))

    def validate(self) -> None:
        """Raise `TableError` at the first row that breaks the table's contract."""
        name = type(self).__name__
        if self.n_frames < 0 or not (np.isfinite(self.dt) and self.dt > 0):
            raise TableError(
                f"{name}: {self.n_frames} frames of {self.dt} s; expected a count and a time > 0"
            )
        columns = self.columns()
        self._refuse((self.frame < 0) | (self.frame >= self.n_frames), "frame", "in 0..n_frames-1")
        for column, names in self.CODED.items():
            self._refuse(columns[column] >= len(names), column, f"a code below {len(names)}")
        for column, array in columns.items():
            if array.dtype == np.float64:
                self._refuse(~np.isfinite(array) & ~self._may_miss(column), column, "finite")
        for column in self.POSITIVE:
            self._refuse(columns[column] <= 0, column, "above 0")
        if self.ID is not None:
            ids = columns[self.ID]
            repeated = np.zeros(len(self), dtype=np.bool_)
            repeated[1:] = (np.diff(self.frame) == 0) & (np.diff(ids) == 0) & (ids[1:] != CLUTTER)
            self._refuse(repeated, self.ID, "at most once in a frame")

    def _may_miss(self, column: str) -> BoolArray:
        """Rows in which a column may be NaN."""
        return np.zeros(len(self), dtype=np.bool_)

    def _refuse(self, bad: BoolArray, column: str, expected: str) -> None:
        if not bad.any():
            return
        row = int(np.argmax(bad))
        where = f"frame {self.frame[row]}"
        if self.ID is not None:
            where += f", {self.ID} {getattr(self, self.ID)[row]}"
        value = self.columns()[column][row]
        raise TableError(
            f"{type(self).__name__}: row {row} ({where}): {column} is {value}, expected {expected}"
        )


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


_TYPES: dict[Any, np.dtype[Any]] = {
    IntArray: np.dtype(np.int64),
    FloatArray: np.dtype(np.float64),
    BoolArray: np.dtype(np.bool_),
    CodeArray: np.dtype(np.uint8),
}
