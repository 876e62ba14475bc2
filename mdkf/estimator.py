"""What a tracker needs of a state estimator, and the few things that all estimators share.

An estimator holds parameters; the tracks' states are separate and batched: an array, or a frozen
dataclass of arrays, whose first axis is the track. Anything with these methods can be passed to
`mdkf.Tracker`; plain numpy is enough.
"""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any, Protocol, TypeVar, runtime_checkable

import numpy as np

from mdkf.compiled import kernel
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


def arrays(state: Any) -> tuple[Any, ...]:
    """The arrays of a dataclass, in order, as the kernels take them."""
    return tuple(vars(state).values())


def copied(state: State) -> State:
    """A dataclass of arrays with arrays of its own."""
    return type(state)(*(array.copy() for array in vars(state).values()))


def take(state: State, rows: IntArray) -> State:
    """The states of some tracks, in the order of `rows`."""
    if isinstance(state, np.ndarray):
        return state[rows]  # type: ignore[return-value]
    _check_state(state)
    taken = {f.name: getattr(state, f.name)[rows] for f in fields(state)}  # type: ignore[arg-type]
    return replace(state, **taken)  # type: ignore[type-var]


def join(first: State, second: State) -> State:
    """The states of the first tracks followed by those of the second."""
    if isinstance(first, np.ndarray):
        return np.concatenate([first, second])  # type: ignore[return-value]
    _check_state(first)
    joined = {
        f.name: np.concatenate([getattr(first, f.name), getattr(second, f.name)])
        for f in fields(first)  # type: ignore[arg-type]
    }
    return replace(first, **joined)  # type: ignore[type-var]


def _check_state(state: object) -> None:
    if not is_dataclass(state) or isinstance(state, type):
        raise TypeError(
            f"an estimator's state is {type(state).__name__}, expected an array, or a dataclass of"
            " arrays, with one row for each track"
        )


def checked_start(position: FloatArray, noise: FloatArray) -> FloatArray:
    """First positions (n, 2); raises `ValueError` as `checked_measurement`, and for NaN."""
    z, _ = checked_measurement(len(position), position, noise)
    if np.isnan(z).any():
        row = int(np.argmax(np.isnan(z[:, 0])))
        raise ValueError(f"first position {row} is {z[row]}, expected two finite numbers")
    return z


def checked_measurement(
    n: int, position: FloatArray, noise: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Positions (n, 2) and noise (n, 2, 2) as contiguous arrays.

    Raises `ValueError` unless positions are finite or all NaN by row, and noise a positive
    covariance where a position is given.
    """
    z = np.ascontiguousarray(position, dtype=np.float64)
    R = np.ascontiguousarray(noise, dtype=np.float64)
    if z.shape != (n, 2) or R.shape != (n, 2, 2):
        raise ValueError(
            f"measurements of {n} tracks have shapes {z.shape} and {R.shape}, "
            f"expected {(n, 2)} and {(n, 2, 2)}"
        )
    row = first_bad(z, R)
    if row >= 0:
        raise ValueError(refusal(z[row], R[row], f"{row}"))
    return z, R


def refusal(z: FloatArray, R: FloatArray, where: str) -> str:
    """Why a measurement z (2,) with noise R (2, 2) cannot be used."""
    if not np.isfinite(z).all():
        return f"measurement {where} is {z}, expected two finite numbers or two NaN"
    return f"noise {where} is {R.tolist()}, expected a positive covariance"


def check_step(dt: float) -> None:
    """Raise `ValueError` unless dt is a finite time above zero [s]."""
    if not (np.isfinite(dt) and dt > 0):
        raise ValueError(f"dt is {dt} s, expected a finite time above 0")


@kernel
def first_bad(z: FloatArray, R: FloatArray) -> int:
    """First row of z (n, 2) that cannot be used, -1 if there is none: neither finite nor all NaN,
    or finite with noise that is no positive covariance; R (r, 2, 2) is repeated to n rows."""
    r = -1
    for k in range(z.shape[0]):
        r = r + 1 if r + 1 < R.shape[0] else 0
        if np.isnan(z[k, 0]) and np.isnan(z[k, 1]):
            continue
        r00, r01, r10, r11 = R[r, 0, 0], R[r, 0, 1], R[r, 1, 0], R[r, 1, 1]
        # Written so that NaN fails; a rotated covariance is symmetric up to rounding.
        usable = (
            np.isfinite(z[k, 0])
            and np.isfinite(z[k, 1])
            and 0.0 < r00 < np.inf
            and 0.0 < r11 < np.inf
            and r00 * r11 - r01 * r01 > 0.0
            and abs(r01 - r10) <= 1e-9 * (r00 + r11)
        )
        if not usable:
            return k
    return -1
