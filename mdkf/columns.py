"""What users give as a table's columns into arrays as tables hold them, or an error that says why.

Nothing is converted that would change a value: no fractions of frames, no masked values, no whole
numbers that a float cannot hold.
"""

import operator
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
CodeArray = NDArray[np.uint8]


class TableError(ValueError):
    """A table breaks its contract; the message names the table, the row and what was expected."""


def as_count(table: str, n_frames: Any) -> int:
    """A number of frames, whatever kind of whole number it is."""
    try:
        return operator.index(n_frames)
    except TypeError:
        raise TableError(f"{table}: n_frames is {n_frames!r}, expected a whole number") from None


def as_time(table: str, dt: Any) -> float:
    """A time [s], whatever kind of number it is."""
    if not isinstance(dt, (int, float, np.integer, np.floating)):
        raise TableError(f"{table}: dt is {dt!r}, expected a number of seconds")
    return float(dt)


def as_column(table: str, column: str, values: ArrayLike, dtype: np.dtype[Any]) -> NDArray[Any]:
    """A column as its stored type, not copied if it is that; refuses what would change a value."""
    if np.ma.is_masked(values):
        raise TableError(f"{table}: column {column!r} has masked values, expected none")
    try:
        given = np.asarray(values)
    except ValueError as error:
        raise TableError(f"{table}: column {column!r} is no array: {error}") from None
    if given.ndim != 1:
        raise TableError(f"{table}: column {column!r} has shape {given.shape}, expected one axis")
    if given.dtype.kind not in "biuf":
        raise TableError(f"{table}: column {column!r} holds {given.dtype}, expected numbers")
    with np.errstate(invalid="ignore"):
        converted = given.astype(dtype, copy=False)
    back = converted
    if dtype.kind == "f" and given.dtype.kind in "iu":
        # Beyond 2^53 not every whole number is a float.
        with np.errstate(invalid="ignore"):
            back = converted.astype(given.dtype)
    if back is not given and dtype.kind + given.dtype.kind != "ff":
        changed = back != given
        if changed.any():
            row = int(np.argmax(changed))
            raise TableError(
                f"{table}: row {row}: column {column!r} holds values that are no {dtype.name}:"
                f" {given[row]}"
            )
    return converted


def row_order(arrays: Mapping[str, NDArray[Any]], keys: list[str]) -> IntArray:
    """The order of rows by the keys; every column breaks ties, so that the order of equal keys does
    not depend on the input's."""
    by = [arrays[key] for key in keys]
    order = np.lexsort(by[::-1])
    repeated = np.ones(max(len(order) - 1, 0), dtype=np.bool_)
    for key in by:
        ordered = key[order]
        repeated &= ordered[1:] == ordered[:-1]
    return np.lexsort([*by, *arrays.values()][::-1]) if repeated.any() else order


def reordered(array: NDArray[Any], order: IntArray) -> NDArray[Any]:
    """A copy of a column in another order."""
    values = np.ascontiguousarray(array[order])
    if values.dtype.kind == "f":
        # Minus zero and zero are one number: equal tables must have equal bytes.
        values += 0.0
    return values
