"""The Kalman filter of one motion model: CV, CA or CJ (order 1, 2, 3).

Prediction x = F x, P = F P F' + Q; update with K = P H' (H P H' + R)^-1, covariance in Joseph
form (`mdkf.chain`). RobMOT's baseline is order 2 (CA).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from mdkf.compiled import kernel
from mdkf.estimator import (
    arrays,
    check_step,
    checked_measurement,
    checked_start,
    copied,
)
from mdkf.kernels import predict_track, update_track
from mdkf.motion import PROCESS_NOISE, START_VARIANCE, derivatives, process_noise, taylor
from mdkf.sequence import Estimates
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
        mean, covariance = state.mean.copy(), state.covariance.copy()
        _predict(mean, covariance, *chain(self.order, dt, self.process_density))
        return KalmanState(mean, covariance, state.innovation, state.nis)

    def update(self, state: KalmanState, position: FloatArray, noise: FloatArray) -> KalmanState:
        """States after positions (n, 2) with covariance (n, 2, 2); NaN rows are not measured."""
        z, R = checked_measurement(len(state.mean), position, noise)
        new = copied(state)
        _update(new.mean, new.covariance, new.innovation, new.nis, z, R, derivatives(self.order))
        return new

    def run_compiled(
        self,
        state: KalmanState,
        positions: FloatArray,
        noise: FloatArray,
        dt: float,
        out: Estimates,
    ) -> None:
        """The compiled pass of `mdkf.filter_sequence`: fills `out`, and overwrites the state."""
        model = (derivatives(self.order), *chain(self.order, dt, self.process_density))
        arguments = (*arrays(state), positions, noise, *model, *arrays(out))
        _filter(*arguments)

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


@kernel
def _predict(
    mean: FloatArray, covariance: FloatArray, taylor: tuple[float, ...], Q: FloatArray
) -> None:
    for k in range(mean.shape[0]):
        predict_track(mean, covariance, k, taylor, Q)


@kernel
def _update(
    mean: FloatArray,
    covariance: FloatArray,
    innovation: FloatArray,
    nis: FloatArray,
    z: FloatArray,
    R: FloatArray,
    derivatives: tuple[int, ...],
) -> None:
    m = len(derivatives)
    work = np.empty((2 * m, 2))
    for k in range(mean.shape[0]):
        if np.isnan(z[k, 0]):
            innovation[k, 0], innovation[k, 1], nis[k] = np.nan, np.nan, np.nan
            continue
        yx, yy, square, _, _, _, _, _ = update_track(mean, covariance, k, m, z, R, k, work)
        innovation[k, 0], innovation[k, 1], nis[k] = yx, yy, square


@kernel
def record(
    mean: FloatArray,
    covariance: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    position_covariance: FloatArray,
) -> None:
    """Position, velocity and the position's covariance of every track of one chain."""
    m = mean.shape[1] // 2
    for k in range(mean.shape[0]):
        for a in range(2):
            position[k, a] = mean[k, a * m]
            velocity[k, a] = mean[k, a * m + 1]
            position_covariance[k, a, 0] = covariance[k, a * m, 0]
            position_covariance[k, a, 1] = covariance[k, a * m, m]


@kernel
def _filter(
    mean: FloatArray,
    covariance: FloatArray,
    innovation: FloatArray,
    nis: FloatArray,
    z: FloatArray,
    R: FloatArray,
    derivatives: tuple[int, ...],
    taylor: tuple[float, ...],
    Q: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    position_covariance: FloatArray,
) -> None:
    for t in range(z.shape[0]):
        if t > 0:
            _predict(mean, covariance, taylor, Q)
            R_t = R[t % R.shape[0]]
            _update(mean, covariance, innovation, nis, z[t], R_t, derivatives)
        record(mean, covariance, position[t], velocity[t], position_covariance[t])
