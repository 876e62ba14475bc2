"""What a check of an estimator is made of (`mdkf.testing`).

Seeded scenes of wandering cars in; states and their outputs out; claims about these, and one
error that says which does not hold.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from functools import wraps
from typing import Any

import numpy as np

from mdkf.estimator import Estimator
from mdkf.tables import FloatArray, Tracks

Check = Callable[[Estimator], None]

DT = 0.1
"""Time between frames [s]."""

NOISE = np.array([[0.031, 0.004], [0.004, 0.009]])
"""Covariance of a measured position [m2]: a LiDAR detector's, with its axes correlated."""

SAME = 1e-9
"""Relative difference of equal numbers: the order of a sum may change with the rows' number."""


class EstimatorCheckError(AssertionError):
    """An estimator fails a check: its name, what was given, what was expected and what came."""

    def __init__(self, check: str, given: str, expected: str, came: str) -> None:
        super().__init__(check, given, expected, came)
        self.check, self.given, self.expected, self.came = check, given, expected, came

    def __str__(self) -> str:
        return f"{self.check}: given {self.given}; expected {self.expected}; came {self.came}"


class Broken(Exception):
    """A claim does not hold: what was expected, what came, and perhaps closer what was given."""

    def __init__(self, expected: str, came: str, given: str | None = None) -> None:
        super().__init__(expected, came)
        self.expected, self.came, self.given = expected, came, given


def given(what: str) -> Callable[[Check], Check]:
    """Make a check of a function: its failures, and whatever the estimator raises, tell its name.

    what: the input that it gives to the estimator.
    """

    def decorate(function: Check) -> Check:
        name = function.__name__

        @wraps(function)
        def check(estimator: Estimator) -> None:
            try:
                function(estimator)
            except Broken as broken:
                told = broken.given or what
                raise EstimatorCheckError(name, told, broken.expected, broken.came) from None
            except Exception as error:
                raise EstimatorCheckError(name, what, "no error", error_of(error)) from error

        return check

    return decorate


def scene(n: int, frames: int, seed: int = 0, gaps: bool = False) -> FloatArray:
    """Measured positions (frames, n, 2) [m] of n wandering cars, read-only; track 0 stands.

    With gaps, NaN for 1 to 30 frames at a time, but never in the first.
    """
    rng = np.random.default_rng(seed)
    acceleration = rng.normal(0, 2, (frames, n, 2)) + rng.normal(0, 1, (n, 2))
    velocity = rng.normal(0, 8, (n, 2)) + DT * acceleration.cumsum(axis=0)
    velocity[:, 0] = 0.0
    z = rng.normal(0, 50, (n, 2)) + DT * velocity.cumsum(axis=0)
    z += rng.multivariate_normal(np.zeros(2), NOISE, (frames, n))
    for track in range(n if gaps else 0):
        for start in rng.integers(1, frames, frames // 40):
            z[start : start + rng.integers(1, 31), track] = np.nan
    z.flags.writeable = False
    return z


def noise_of(n: int) -> FloatArray:
    """NOISE for n tracks (n, 2, 2), one matrix with a stride of zero, as the tracker gives it."""
    return np.broadcast_to(NOISE, (n, 2, 2))


def states(
    estimator: Estimator, z: FloatArray, dt: float = DT, between: bool = False
) -> Iterator[Any]:
    """States after each frame of positions z (frames, n, 2); those predicted too if `between`."""
    noise = noise_of(z.shape[1])
    state = estimator.start(z[0], noise)
    yield state
    for measured in z[1:]:
        state = estimator.predict(state, dt)
        if between:
            yield state
        state = estimator.update(state, measured, noise)
        yield state


def outputs(estimator: Estimator, state: Any) -> dict[str, FloatArray]:
    """All that can be read from a state, by name."""
    told = {name: getattr(estimator, name)(state) for name in ("position", "velocity")}
    told["covariance"] = estimator.covariance(state)
    return {**told, **estimator.diagnostics(state)}


def stacked(estimator: Estimator, run: Iterable[Any]) -> dict[str, FloatArray]:
    """The outputs of a run's states, frame first."""
    # Copied at once: an output may be a view of a state that is about to be overwritten.
    frames = [
        {name: np.array(values) for name, values in outputs(estimator, state).items()}
        for state in run
    ]
    return {name: np.stack([frame[name] for frame in frames]) for name in frames[0]}


def history(estimator: Estimator, z: FloatArray) -> dict[str, FloatArray]:
    """The outputs after each frame of positions z (frames, n, 2), frame first."""
    return stacked(estimator, states(estimator, z))


def arrays_of(state: Any) -> dict[str, Any]:
    """What an array or a dataclass holds, by name."""
    if isinstance(state, np.ndarray):
        return {"array": state}
    return {field.name: getattr(state, field.name) for field in fields(state)}


def bytes_of(state: Any) -> list[bytes]:
    """The bytes of all of a state's arrays."""
    return [array.tobytes() for array in arrays_of(state).values()]


def require_state(state: Any, n: int, method: str) -> None:
    """What `take` and `join` can handle: an array or a dataclass of arrays of n rows."""
    wanted = f"from {method} an array, or a dataclass of arrays, with {n} rows"
    if not isinstance(state, np.ndarray) and (not is_dataclass(state) or isinstance(state, type)):
        raise Broken(wanted, type(state).__name__)
    for name, array in arrays_of(state).items():
        if not isinstance(array, np.ndarray) or array.shape[:1] != (n,):
            raise Broken(wanted, f"{name}: {_described(array)}")


def require_array(came: Any, name: str, shape: tuple[int, ...], given: str) -> None:
    """An array of this shape and float64."""
    if not isinstance(came, np.ndarray) or came.shape != shape or came.dtype != np.float64:
        raise Broken(f"{name} of shape {shape} and float64", _described(came), given)


def require_diagnostics(came: Any, n: int, given: str) -> None:
    """Columns of n rows under names that the track table does not have."""
    if not isinstance(came, Mapping):
        raise Broken("diagnostics a mapping of names to arrays", _described(came), given)
    for name, values in came.items():
        if not isinstance(name, str) or name in (*Tracks.column_types(), "confirmed"):
            raise Broken("diagnostics named unlike the track table's columns", repr(name), given)
        require_array(values, f"diagnostics {name!r}", (n,), given)


def require_growth(trace: FloatArray, how: str) -> None:
    """Traces (steps, n) [m2] that never fall from one step to the next."""
    shrunk = np.argwhere(~(trace[1:] >= trace[:-1] * (1 - SAME)))
    if len(shrunk):
        k, track = shrunk[0]
        came = f"{trace[k, track]:.6g} m2, then {trace[k + 1, track]:.6g} m2"
        raise Broken(f"the covariance's trace to grow {how} or to stay", came)


def require_same(came: FloatArray, wanted: FloatArray, what: str, relative: float = SAME) -> None:
    """Equal up to a share of the largest value: a zero among metres carries no relative error."""
    finite = np.isfinite(wanted)
    if came.shape != wanted.shape or not np.array_equal(np.isfinite(came), finite):
        raise Broken(what, f"{_described(came)}, not all finite")
    worst = np.abs(came[finite] - wanted[finite]).max(initial=0.0)
    if worst > relative * np.abs(wanted[finite]).max(initial=0.0):
        raise Broken(what, f"a difference of {worst:.3g}")


def error_of(error: Exception) -> str:
    """An error as it is told: its kind and its message."""
    return f"{type(error).__name__}: {error}"


def _described(came: Any) -> str:
    if isinstance(came, np.ndarray):
        return f"an array of shape {came.shape} and {came.dtype}"
    return type(came).__name__
