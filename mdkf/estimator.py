"""What a tracker needs of a state estimator, and the few things that all estimators share.

An estimator holds parameters; the tracks' states are separate and batched: an array, or a frozen
dataclass of arrays, whose first axis is the track. Anything with these methods can be passed to
`mdkf.Tracker`; plain numpy is enough.
"""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any, Protocol, TypeVar, runtime_checkable

import numpy as np

from mdkf.tables import FloatArray, IntArray


@runtime_checkable
class Estimator(Protocol):
    """A state estimator batched over n tracks; positions in metres, time in seconds."""

    def start(self, position: FloatArray, noise: FloatArray) -> Any:
        """States of n new tracks from their first positions (n, 2) and noise (n, 2, 2) [m2]."""

    def predict(self, state: Any, dt: float) -> Any:
        """States dt seconds later."""

    def update(self, state: Any, position: FloatArray, noise: FloatArray) -> Any:
        """States after measured positions (n, 2) of covariance noise (n, 2, 2) [m2].

        A row of NaN says that the track was not measured: the prediction stands.
        """

    def position(self, state: Any) -> FloatArray:
        """Estimated positions (n, 2) [m]."""

    def velocity(self, state: Any) -> FloatArray:
        """Estimated velocities (n, 2) [m/s]."""

    def covariance(self, state: Any) -> FloatArray:
        """Covariances of the positions (n, 2, 2) [m2]."""

    def diagnostics(self, state: Any) -> Mapping[str, FloatArray]:
        """The estimator's own columns for the track table, each (n,)."""


State = TypeVar("State")


def take(state: State, rows: IntArray) -> State:
    """The states of some tracks, in the order of `rows`."""
    if isinstance(state, np.ndarray):
        return state[rows]  # type: ignore[return-value]
    _check_state(state)
    arrays = {f.name: getattr(state, f.name)[rows] for f in fields(state)}  # type: ignore[arg-type]
    return replace(state, **arrays)  # type: ignore[type-var]


def join(first: State, second: State) -> State:
    """The states of the first tracks followed by those of the second."""
    if isinstance(first, np.ndarray):
        return np.concatenate([first, second])  # type: ignore[return-value]
    _check_state(first)
    arrays = {
        f.name: np.concatenate([getattr(first, f.name), getattr(second, f.name)])
        for f in fields(first)  # type: ignore[arg-type]
    }
    return replace(first, **arrays)  # type: ignore[type-var]


def _check_state(state: object) -> None:
    if not is_dataclass(state) or isinstance(state, type):
        raise TypeError(
            f"an estimator's state is {type(state).__name__}, expected an array, or a dataclass of"
            " arrays, with one row for each track"
        )


def check_measurement(n: int, position: FloatArray, noise: FloatArray) -> None:
    """Raise `ValueError` unless position is (n, 2), finite or all NaN by row, and noise (n, 2, 2)
    with positive variances where a position is given."""
    if position.shape != (n, 2) or noise.shape != (n, 2, 2):
        raise ValueError(
            f"measurements of {n} tracks have shapes {position.shape} and {noise.shape}, "
            f"expected {(n, 2)} and {(n, 2, 2)}"
        )
    missing = np.isnan(position).all(axis=1)
    bad = ~missing & ~np.isfinite(position).all(axis=1)
    if bad.any():
        row = int(np.argmax(bad))
        raise ValueError(f"measurement {row} is {position[row]}, expected two finite numbers")
    determinant = noise[:, 0, 0] * noise[:, 1, 1] - noise[:, 0, 1] * noise[:, 1, 0]
    bad = ~missing & ~((noise[:, 0, 0] > 0) & (determinant > 0))
    if bad.any():
        row = int(np.argmax(bad))
        raise ValueError(f"noise {row} is {noise[row].tolist()}, expected a positive covariance")


def check_step(dt: float) -> None:
    """Raise `ValueError` unless dt is a finite time above zero [s]."""
    if not (np.isfinite(dt) and dt > 0):
        raise ValueError(f"dt is {dt} s, expected a finite time above 0")
