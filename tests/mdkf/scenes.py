"""Scenes for the tests of the estimators: measured journeys, noise, and the options to run."""

import hashlib
import itertools
import json
import sys
from collections.abc import Iterator
from dataclasses import fields
from typing import Any, get_args

import numpy as np
import numpy.typing as npt

from mdkf import ESTIMATORS, InteractingMultipleModel, Kalman, MotionDynamics
from mdkf.motion_dynamics import AfterGap, Axes, Covariance, Denoise

Array = npt.NDArray[np.float64]

DT = 0.1
"""Time between frames [s]."""

BUILT_IN = {name: ESTIMATORS[name] for name in ESTIMATORS if f"{name}-retuned" in ESTIMATORS}
"""The built-in estimators by their base names; installed packages' are not ours to test."""

KALMAN = {f"kalman{order}": Kalman(order=order) for order in (1, 2, 3)}
IMM = {
    f"imm{order}-{mixing}": InteractingMultipleModel(order=order, mixing=mixing)
    for order in (2, 3)
    for mixing in ("unbiased", "zero")
}
MD = {
    f"md{order}-{'-'.join(words)}": MotionDynamics(order, 10, None, *words)  # type: ignore
    for order in (2, 3)
    for words in itertools.product(*map(get_args, (Covariance, Denoise, AfterGap, Axes)))
}
EVERY: dict[str, Any] = {**KALMAN, **IMM, **MD}
"""Every order and every combination of options."""


def journey(seed: int, frames: int, tracks: int, gaps: bool = True) -> Array:
    """Measured positions (frames, tracks, 2) [m]: cars that drive, stop and start again.

    With gaps, a row of NaN for 1 to 15 frames at a time, never in the first frame.
    """
    rng = np.random.default_rng(seed)
    moving = np.repeat(rng.random((frames // 25 + 1, tracks, 1)) < 0.6, 25, axis=0)[:frames]
    velocity = rng.normal(0, 8, (tracks, 2)) + rng.normal(0, 0.3, (frames, tracks, 2)).cumsum(0)
    z = rng.normal(0, 50, (tracks, 2)) + DT * np.cumsum(velocity * moving, axis=0)
    z += rng.normal(0, 0.05, z.shape)
    for track in range(tracks if gaps else 0):
        for start in rng.integers(1, frames, frames // 40 + 1):
            z[start : start + rng.integers(1, 16), track] = np.nan
    return z


def covariances(
    rng: np.random.Generator,
    shape: tuple[int, ...],
    low: float = 0.003,
    high: float = 0.3,
    correlated: bool = True,
) -> Array:
    """Random covariances (*shape, 2, 2) [m2]; variances log-uniform in [low, high], correlation
    up to 0.9."""
    deviation = np.exp(rng.uniform(np.log(low), np.log(high), (*shape, 2)) / 2)
    R = np.zeros((*shape, 2, 2))
    R[..., 0, 0], R[..., 1, 1] = deviation[..., 0] ** 2, deviation[..., 1] ** 2
    if correlated:
        R[..., 0, 1] = rng.uniform(-0.9, 0.9, shape) * deviation.prod(axis=-1)
        R[..., 1, 0] = R[..., 0, 1]
    return R


def rotation(angle: float) -> Array:
    """Rotation matrix (2, 2) by an angle [rad]."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def states(estimator: Any, z: Array, R: Array, dt: float | Array = DT) -> Iterator[Any]:
    """States after each frame of z (T, n, 2), R (n, 2, 2) or (T, n, 2, 2), dt [s] or (T - 1,)."""
    R = np.broadcast_to(R, (*z.shape, 2))
    steps = np.broadcast_to(dt, (len(z) - 1,))
    state = estimator.start(z[0], R[0])
    yield state
    for measured, noise, step in zip(z[1:], R[1:], steps, strict=True):
        state = estimator.update(estimator.predict(state, float(step)), measured, noise)
        yield state


def last(estimator: Any, z: Array, R: Array, dt: float | Array = DT) -> Any:
    """The state after the last frame."""
    *_, state = states(estimator, z, R, dt)
    return state


def contents(state: Any) -> dict[str, npt.NDArray[Any]]:
    """A state's arrays by name."""
    return {field.name: getattr(state, field.name) for field in fields(state)}


def bytes_of(state: Any) -> bytes:
    """All bits of a state."""
    return b"".join(array.tobytes() for array in contents(state).values())


def assert_same_moments(
    came: tuple[Array, Array], wanted: tuple[Array, Array], relative: float
) -> None:
    """Means and covariances, rows of one size, that agree in proportion.

    Means to the largest entry of their row, and an entry of a covariance to the two deviations
    it belongs to: what a correlation of zero among metres can carry.
    """
    for array in (*came, *wanted):
        assert np.isfinite(array).all()
    (x, P), (y, C) = came, wanted
    assert x.shape == y.shape
    worst = np.abs(x - y) / np.abs(y).max(axis=-1, keepdims=True)
    assert worst.max() <= relative, f"means differ by {worst.max():.2g} of the largest entry"
    variance = np.diagonal(C, axis1=-2, axis2=-1)
    # The missing derivatives of an IMM's smaller models have variance 0, and must keep it.
    size = np.sqrt(variance[..., :, None] * variance[..., None, :])
    difference = np.abs(P - C)
    assert (difference[size == 0] == 0).all()
    worst = difference[size > 0] / size[size > 0]
    assert worst.max() <= relative, f"covariances differ by {worst.max():.2g} of the deviations"


def digests() -> dict[str, str]:
    """A hash of every bit of every state of each built-in estimator over a journey of 100 frames,
    with gaps, one detection's noise unlike the next one's, and uneven steps."""
    rng = np.random.default_rng(1)
    z, R = journey(1, 100, 3), covariances(rng, (100, 3))
    # A third of the noise is diagonal; track 0 stays uncoupled.
    diagonal = rng.random((100, 3)) < 0.3
    diagonal[:, 0] = True
    R[diagonal] *= np.eye(2)
    steps = rng.choice([0.05, 0.1, 0.3], 99)
    found = {}
    for name, estimator in BUILT_IN.items():
        digest = hashlib.sha256()
        for state in states(estimator, z, R, steps):
            digest.update(bytes_of(state))
        found[name] = digest.hexdigest()
    return found


if __name__ == "__main__":
    json.dump(digests(), sys.stdout)
