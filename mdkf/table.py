"""What all tables are: equally long columns sorted by (frame, id), checked and hashed.

A frozen structure of arrays; `frame_start` holds the offsets, so a frame is a slice. `from_columns`
is where data enters: any row order in, sorted and validated out.
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

CLUTTER = -1
"""`Detections.source` of a box that no object caused."""

_TYPES: dict[Any, np.dtype[Any]] = {
    IntArray: np.dtype(np.int64),
    FloatArray: np.dtype(np.float64),
    BoolArray: np.dtype(np.bool_),
    CodeArray: np.dtype(np.uint8),
}


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
