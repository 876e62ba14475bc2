"""The Kalman filter of one motion model: CV, CA or CJ (order 1, 2, 3).

Prediction x = F x, P = F P F' + Q; update with K = P H' (H P H' + R)^-1, covariance in Joseph
form (`mdkf.chain`). RobMOT's baseline is order 2 (CA).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from mdkf import batch
from mdkf.batch import Moments, Noise, Pair, predict_all, update_all
from mdkf.estimator import (
    arrays,
    check_step,
    checked_measurement,
    checked_start,
    copied,
)
from mdkf.kernels import (
    chain_moments,
    predict_track,
    start_track,
    update_track,
    write_innovation,
)
from mdkf.motion import PROCESS_NOISE, START_VARIANCE, process_noise, taylor
from mdkf.tables import FloatArray


@dataclass(frozen=True, eq=False)
class KalmanState:
    """n tracks with m = order + 1 derivatives per axis.

    mean (n, 2m) = [px, vx, .., py, vy, ..], covariance (n, 2m, 2m); innovation (n, 2) [m], the
    last measurement minus its prediction, and nis (n,), its normalised square: NaN where the
    last frame had no measurement.
    """

    mean: FloatArray
    covariance: FloatArray
    innovation: FloatArray
    nis: FloatArray


class OneChain:
    """What is read off a state that holds one chain of derivatives per axis."""

    order: int

    def position(self, state: KalmanState) -> FloatArray:
        """Positions (n, 2) [m]."""
        return state.mean[:, :: self.order + 1]

    def velocity(self, state: KalmanState) -> FloatArray:
        """Velocities (n, 2) [m/s]."""
        return state.mean[:, 1 :: self.order + 1]

    def covariance(self, state: KalmanState) -> FloatArray:
        """Covariances of the positions (n, 2, 2) [m2]."""
        return state.covariance[:, :: self.order + 1, :: self.order + 1]


@dataclass(frozen=True)
class Kalman(OneChain):
    """Kalman filter of motion order 1 (CV), 2 (CA) or 3 (CJ), batched over tracks.

    process_density: spectral densities of the white noise at each derivative (`mdkf.motion`).
    start_variance: variances of a first state's derivatives, position first. A track starts at
    its first detection with all derivatives zero, as in RobMOT.
    """

    order: int = 2
    process_density: tuple[float, ...] = PROCESS_NOISE
    start_variance: tuple[float, ...] = START_VARIANCE

    def __post_init__(self) -> None:
        check_model(self.order, (1, 2, 3), self.process_density, self.start_variance)

    def start(self, position: FloatArray, noise: FloatArray) -> KalmanState:
        """States of n new tracks at positions (n, 2); the noise does not enter (RobMOT)."""
        z = checked_start(position, noise)
        chains = start_chains(z, self.order, self.start_variance)
        return KalmanState(*chains, *no_innovation(len(z)))

    def predict(self, state: KalmanState, dt: float) -> KalmanState:
        """States dt [s] later."""
        check_step(dt)
        new = KalmanState(state.mean.copy(), state.covariance.copy(), *arrays(state)[2:])
        predict_all(self.batch(new, dt), len(new.mean))
        return new

    def update(self, state: KalmanState, position: FloatArray, noise: FloatArray) -> KalmanState:
        """States after positions (n, 2) with covariance (n, 2, 2); NaN rows are not measured."""
        z, R = checked_measurement(len(state.mean), position, noise)
        new = copied(state)
        update_all(self.batch(new), z, R)
        return new

    def batch(self, state: KalmanState, dt: float = 1.0) -> "KalmanBatch":
        """The state's arrays for the kernels (`mdkf.batch`); updates do not depend on dt [s]."""
        first_row, Q = chain(self.order, dt, self.process_density)
        return KalmanBatch(
            **vars(state),
            taylor=first_row,
            Q=Q,
            start_variance=self.start_variance[: self.order + 1],
            work=np.empty((state.mean.shape[1], 2)),
        )

    def diagnostics(self, state: KalmanState) -> Mapping[str, FloatArray]:
        """innovation_x, innovation_y [m], nis."""
        return innovation_columns(state.innovation, state.nis)


def check_model(
    order: int,
    known: tuple[int, ...],
    density: tuple[float, ...],
    start_variance: tuple[float, ...],
) -> None:
    """Raise `ValueError` for a motion order that the estimator does not have, or for densities
    and variances that are too few or negative."""
    if order not in known:
        raise ValueError(f"order is {order}, expected one of {known} (1 CV, 2 CA, 3 CJ)")
    for name, given in (("process_density", density), ("start_variance", start_variance)):
        if not isinstance(given, tuple):
            raise ValueError(f"{name} is {given!r}, expected a tuple of numbers")
    if len(density) < order or not all(np.isfinite(q) and q >= 0 for q in density):
        raise ValueError(f"process_density is {density}, expected {order} numbers, 0 or more")
    if len(start_variance) <= order or not all(np.isfinite(s) and s > 0 for s in start_variance):
        raise ValueError(f"start_variance is {start_variance}, expected {order + 1} above 0")


@lru_cache(maxsize=256)
def chain(
    order: int, dt: float, density: tuple[float, ...]
) -> tuple[tuple[float, ...], FloatArray]:
    """First row of F and Q of one axis, kept: a tracker asks for them in every frame."""
    Q = process_noise(order, dt, density)
    Q.setflags(write=False)
    return taylor(order, dt), Q


def start_chains(
    position: FloatArray, order: int, variance: tuple[float, ...]
) -> tuple[FloatArray, FloatArray]:
    """Means (n, 2m) at rest in the given positions (n, 2) and their covariances (n, 2m, 2m)."""
    n, m = len(position), order + 1
    mean = np.zeros((n, 2 * m))
    mean[:, ::m] = position
    covariance = np.tile(np.diag(np.tile(variance[:m], 2)), (n, 1, 1))
    return mean, covariance


def no_innovation(n: int) -> tuple[FloatArray, FloatArray]:
    """Innovations (n, 2) and NIS (n,) of tracks that were not measured: NaN."""
    return np.full((n, 2), np.nan), np.full(n, np.nan)


def innovation_columns(innovation: FloatArray, nis: FloatArray) -> dict[str, FloatArray]:
    """The diagnostics that all built-in estimators have: innovation_x, innovation_y [m], nis."""
    return {"innovation_x": innovation[:, 0], "innovation_y": innovation[:, 1], "nis": nis}


class KalmanBatch(NamedTuple):
    """A `KalmanState` and its model as the kernels take them; work (2m, 2) is overwritten."""

    mean: FloatArray
    covariance: FloatArray
    innovation: FloatArray
    nis: FloatArray
    taylor: tuple[float, ...]
    Q: FloatArray
    start_variance: tuple[float, ...]
    work: FloatArray


@batch.start.register
def _start(batch: KalmanBatch, k: int, z: Pair) -> None:
    start_track(batch.mean, batch.covariance, k, z, batch.start_variance)
    batch.innovation[k, 0], batch.innovation[k, 1], batch.nis[k] = np.nan, np.nan, np.nan


@batch.predict.register
def _predict(batch: KalmanBatch, k: int) -> None:
    predict_track(batch.mean, batch.covariance, k, batch.taylor, batch.Q)


@batch.update.register
def _update(batch: KalmanBatch, k: int, z: Pair, R: Noise) -> None:
    yx = yy = square = np.nan
    if not np.isnan(z[0]):
        m = len(batch.taylor)
        updated = update_track(batch.mean, batch.covariance, k, m, z, R, batch.work)
        yx, yy, square = updated[:3]
    batch.innovation[k, 0], batch.innovation[k, 1], batch.nis[k] = yx, yy, square


@batch.moments.register
def _moments(batch: KalmanBatch, k: int) -> Moments:
    return chain_moments(batch.mean, batch.covariance, k, len(batch.taylor))


@batch.diagnose.register
def _diagnose(batch: KalmanBatch, k: int, columns: FloatArray, first: int, row: int) -> None:
    write_innovation(batch.innovation, batch.nis, k, columns, first, row)
