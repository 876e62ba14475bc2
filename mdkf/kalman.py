"""The Kalman filter of one motion model: CV, CA or CJ (order 1, 2, 3).

Prediction x = F x, P = F P F' + Q; update with K = P H' (H P H' + R)^-1, covariance in Joseph
form. RobMOT's baseline is order 2 (CA).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numba import njit

from mdkf.estimator import check_measurement, check_step
from mdkf.kernels import predict_covariance, predict_mean, update_state
from mdkf.motion import PROCESS_NOISE, START_VARIANCE, process_noise, transition
from mdkf.tables import FloatArray


@dataclass(frozen=True, eq=False)
class KalmanState:
    """n tracks; mean (n, 2m) = [px, vx, .., py, vy, ..], covariance (n, 2m, 2m), m = order + 1."""

    mean: FloatArray
    covariance: FloatArray


@dataclass(frozen=True)
class Kalman:
    """Kalman filter of motion order 1 (CV), 2 (CA) or 3 (CJ), batched over tracks.

    process_density: spectral densities of the white noise at each derivative (`mdkf.motion`).
    start_variance: variances of a first state's derivatives, position first. A track starts at
    its first detection with all derivatives zero, as in RobMOT.
    """

    order: int = 2
    process_density: tuple[float, ...] = PROCESS_NOISE
    start_variance: tuple[float, ...] = START_VARIANCE

    def __post_init__(self) -> None:
        check_order(self.order, (1, 2, 3))

    def start(self, position: FloatArray, noise: FloatArray) -> KalmanState:
        """States of n new tracks at positions (n, 2); the noise does not enter (RobMOT)."""
        return KalmanState(*start_chains(position, self.order, self.start_variance))

    def predict(self, state: KalmanState, dt: float) -> KalmanState:
        """States dt [s] later."""
        check_step(dt)
        mean, covariance = state.mean.copy(), state.covariance.copy()
        F, Q = chain(self.order, dt, self.process_density)
        _predict(mean, covariance, F, Q)
        return KalmanState(mean, covariance)

    def update(self, state: KalmanState, position: FloatArray, noise: FloatArray) -> KalmanState:
        """States after positions (n, 2) with covariance (n, 2, 2); NaN rows are not measured."""
        check_measurement(len(state.mean), position, noise)
        mean, covariance = state.mean.copy(), state.covariance.copy()
        _update(mean, covariance, position, noise)
        return KalmanState(mean, covariance)

    def position(self, state: KalmanState) -> FloatArray:
        """Positions (n, 2) [m]."""
        return state.mean[:, :: self.order + 1]

    def velocity(self, state: KalmanState) -> FloatArray:
        """Velocities (n, 2) [m/s]."""
        return state.mean[:, 1 :: self.order + 1]

    def covariance(self, state: KalmanState) -> FloatArray:
        """Covariances of the positions (n, 2, 2) [m2]."""
        return state.covariance[:, :: self.order + 1, :: self.order + 1]

    def diagnostics(self, state: KalmanState) -> Mapping[str, FloatArray]:
        """None."""
        return {}


def check_order(order: int, known: tuple[int, ...]) -> None:
    """Raise `ValueError` for a motion order that the estimator does not have."""
    if order not in known:
        raise ValueError(f"order is {order}, expected one of {known} (1 CV, 2 CA, 3 CJ)")


@lru_cache(maxsize=256)
def chain(order: int, dt: float, density: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    """F and Q of one axis, not to be written to: a tracker asks for them in every frame."""
    return transition(order, dt), process_noise(order, dt, density)


def start_chains(
    position: FloatArray, order: int, variance: tuple[float, ...]
) -> tuple[FloatArray, FloatArray]:
    """Means (n, 2m) at rest in the given positions (n, 2) and their covariances (n, 2m, 2m)."""
    n, m = len(position), order + 1
    mean = np.zeros((n, 2 * m))
    mean[:, ::m] = position
    covariance = np.tile(np.diag(np.tile(variance[:m], 2)), (n, 1, 1))
    return mean, covariance


@njit(cache=True)
def _predict(mean: FloatArray, covariance: FloatArray, F: FloatArray, Q: FloatArray) -> None:
    for k in range(mean.shape[0]):
        predict_mean(mean[k], F)
        predict_covariance(covariance[k], F, Q)


@njit(cache=True)
def _update(
    mean: FloatArray, covariance: FloatArray, position: FloatArray, noise: FloatArray
) -> None:
    for k in range(mean.shape[0]):
        if not np.isnan(position[k, 0]):
            update_state(mean[k], covariance[k], position[k], noise[k])
