"""The reference tier: the same filters, one track at a time, on filterpy objects and plain numpy.

Slow and obvious. The tests hold the kernels against these, and the ratios of the paper's latency
table belong to this tier. States are [px, vx, (ax), (jx), py, vy, (ay), (jy)]; z is a position
(2,) [m], R its covariance (2, 2) [m2], and None instead of z is a frame without a measurement.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from filterpy.kalman import IMMEstimator, KalmanFilter
from scipy.linalg import block_diag
from scipy.stats import multivariate_normal

from mdkf.motion import PROCESS_NOISE, START_VARIANCE, process_noise, transition
from mdkf.tables import FloatArray

Densities = tuple[float, ...]


class NumpyKalman:
    """A Kalman filter in plain numpy, with filterpy's names: x, P, F, Q, H, K."""

    def __init__(self, dim_x: int, dim_z: int) -> None:
        self.x = np.zeros(dim_x)
        self.P = self.F = self.Q = np.eye(dim_x)
        self.H = self.R = np.zeros((dim_z, dim_x))
        self.K = np.zeros((dim_x, dim_z))

    def predict(self) -> None:
        """x = F x, P = F P F' + Q."""
        self.x = self.F @ self.x
        self.P = self.F @ self.P @ self.F.T + self.Q

    def update(self, z: FloatArray | None, R: FloatArray | None = None) -> None:
        """Update with K = P H' S^-1 and Joseph's form."""
        if z is None:
            return
        noise = self.R if R is None else R
        S = self.H @ self.P @ self.H.T + noise
        self.K = self.P @ self.H.T @ np.linalg.inv(S)
        self.x = self.x + self.K @ (z - self.H @ self.x)
        A = np.eye(len(self.x)) - self.K @ self.H
        self.P = A @ self.P @ A.T + self.K @ noise @ self.K.T


def filterpy_kalman(
    position: FloatArray,
    order: int,
    dt: float,
    density: Densities = PROCESS_NOISE,
    start_variance: Densities = START_VARIANCE,
    size: int = 0,
) -> KalmanFilter:
    """A filterpy Kalman filter of motion order 1, 2 or 3 at rest in `position` (2,) [m].

    size: derivatives kept per axis; those above the order stay zero (`filterpy_imm` needs states
    of one size).
    """
    m = max(size, order + 1)
    kf = KalmanFilter(2 * m, 2)
    _set_at_rest(kf, position, order, dt, density, start_variance)
    return kf


def numpy_kalman(
    position: FloatArray,
    order: int,
    dt: float,
    density: Densities = PROCESS_NOISE,
    start_variance: Densities = START_VARIANCE,
) -> NumpyKalman:
    """As `filterpy_kalman`, in plain numpy."""
    kf = NumpyKalman(2 * (order + 1), 2)
    _set_at_rest(kf, position, order, dt, density, start_variance)
    return kf


def set_step(kf: Any, order: int, dt: float, density: Densities = PROCESS_NOISE) -> None:
    """Give a filter the F and Q of a step of dt [s]."""
    m = len(kf.x) // 2
    used = np.ix_(np.arange(order + 1), np.arange(order + 1))
    F, Q = np.zeros((m, m)), np.zeros((m, m))
    F[used], Q[used] = transition(order, dt), process_noise(order, dt, density)
    kf.F, kf.Q = block_diag(F, F), block_diag(Q, Q)


def _set_at_rest(
    kf: Any, position: FloatArray, order: int, dt: float, density: Densities, start: Densities
) -> None:
    m = len(kf.x) // 2
    set_step(kf, order, dt, density)
    kf.H = np.zeros((2, 2 * m))
    kf.H[0, 0] = kf.H[1, m] = 1.0
    variance = np.zeros(m)
    variance[: order + 1] = start[: order + 1]
    kf.P = np.diag(np.tile(variance, 2))
    kf.x = np.zeros(2 * m)
    kf.x[[0, m]] = position


class CoastingImm(IMMEstimator):  # type: ignore[misc]
    """filterpy's IMM with two faults corrected.

    `IMMEstimator.update(None)` multiplies the mode probabilities by the likelihoods of the last
    measurement once more, in every frame of a gap, so that one model soon takes all. Here a
    missing measurement leaves the propagated probabilities cbar.

    After a jump all likelihoods underflow and filterpy takes the same smallest number for each,
    so that the nearest model has no advantage. Here they are taken relative to the best.
    """

    def update(self, z: FloatArray | None) -> None:
        """Update with a position (2,), or coast with None; R is the filters' own."""
        if z is None:
            self.mu = self.cbar.copy()
        else:
            for model in self.filters:
                model.update(z)
            logarithm = np.array([model.log_likelihood for model in self.filters])
            self.mu = self.cbar * np.exp(logarithm - logarithm.max())
            self.mu /= self.mu.sum()
        self._compute_mixing_probabilities()
        self._compute_state_estimate()


def filterpy_imm(
    position: FloatArray,
    order: int,
    dt: float,
    stay: float = 0.95,
    density: Densities = PROCESS_NOISE,
    start_variance: Densities = START_VARIANCE,
) -> CoastingImm:
    """filterpy's IMM of the models CV .. order with zero-padded mixing."""
    models = [
        filterpy_kalman(position, j + 1, dt, density, start_variance, size=order + 1)
        for j in range(order)
    ]
    return CoastingImm(models, np.full(order, 1.0 / order), _markov(order, stay))


class UnbiasedImm:
    """IMM in plain numpy with models of their own size and unbiased mixing (Yuan et al., 2012).

    A smaller model's state is augmented, before it is mixed into a larger one, by the larger
    one's own missing derivatives: mean and covariance, uncorrelated with the rest.
    """

    def __init__(
        self,
        position: FloatArray,
        order: int,
        dt: float,
        stay: float = 0.95,
        density: Densities = PROCESS_NOISE,
        start_variance: Densities = START_VARIANCE,
    ) -> None:
        self.models = [
            numpy_kalman(position, j + 1, dt, density, start_variance) for j in range(order)
        ]
        self.markov = _markov(order, stay)
        self.mu = np.full(order, 1.0 / order)

    def predict(self) -> None:
        """Mix, then predict each model."""
        c = self.mu @ self.markov
        before = [(model.x.copy(), model.P.copy()) for model in self.models]
        for j, model in enumerate(self.models):
            weights = self.markov[:, j] * self.mu / c[j]
            sources = [self._as_model(before, i, j) for i in range(len(before))]
            mean = np.sum([w * x for w, (x, _) in zip(weights, sources, strict=True)], axis=0)
            covariance = np.zeros_like(model.P)
            for w, (x, P) in zip(weights, sources, strict=True):
                covariance += w * (P + np.outer(x - mean, x - mean))
            model.x, model.P = mean, covariance
            model.predict()
        self.mu = c

    def update(self, z: FloatArray | None, R: FloatArray) -> None:
        """Update each model and reweigh, or coast."""
        if z is None:
            return
        likelihood = np.empty(len(self.models))
        for j, model in enumerate(self.models):
            S = model.H @ model.P @ model.H.T + R
            likelihood[j] = multivariate_normal.logpdf(z, model.H @ model.x, S)
            model.update(z, R)
        weight = self.mu * np.exp(likelihood - likelihood.max())
        self.mu = weight / weight.sum()

    @property
    def position(self) -> FloatArray:
        """The mixture's position (2,)."""
        positions = np.array([model.H @ model.x for model in self.models])
        mean: FloatArray = self.mu @ positions
        return mean

    @staticmethod
    def _as_model(
        before: list[tuple[FloatArray, FloatArray]], i: int, j: int
    ) -> tuple[FloatArray, FloatArray]:
        """Model i's state in the size of model j."""
        x, P = before[i]
        mi, mj = i + 2, j + 2
        if mi >= mj:
            kept = np.concatenate([np.arange(mj), mi + np.arange(mj)])
            return x[kept], P[np.ix_(kept, kept)]
        own_x, own_P = before[j]
        known = np.concatenate([np.arange(mi), mj + np.arange(mi)])
        missing = np.setdiff1d(np.arange(2 * mj), known)
        mean, covariance = own_x.copy(), np.zeros_like(own_P)
        mean[known] = x
        covariance[np.ix_(known, known)] = P
        covariance[np.ix_(missing, missing)] = own_P[np.ix_(missing, missing)]
        return mean, covariance


def _markov(order: int, stay: float) -> FloatArray:
    leave = (1.0 - stay) / (order - 1)
    return np.full((order, order), leave) + (stay - leave) * np.eye(order)


class NumpyMotionDynamics:
    """MD-KF in plain numpy, the paper's equations symbol by symbol, with every option.

    The options are those of `mdkf.MotionDynamics`. kalman: what makes the filter inside,
    `numpy_kalman` or `filterpy_kalman`.
    """

    def __init__(
        self,
        position: FloatArray,
        order: int,
        dt: float,
        k: int,
        factors: tuple[float, ...],
        covariance_by: str = "F",
        denoise: str = "literal",
        after_gap: str = "reset",
        axes: str = "independent",
        density: Densities = PROCESS_NOISE,
        start_variance: Densities = START_VARIANCE,
        kalman: Callable[..., Any] = numpy_kalman,
    ) -> None:
        self.filter = kalman(position, order, dt, density, start_variance)
        self.k, self.order, self.factors = k, order, factors
        self.covariance_by, self.denoise = covariance_by, denoise
        self.after_gap, self.axes = after_gap, axes
        self.W = np.eye(2 * (order + 1))
        self.positions = [np.array(position)]
        self.missed = False

    def predict(self) -> None:
        """x = F W x (eq. prediction_state_with_dynamics); P = F P F' + Q, or F W P W' F' + Q."""
        kf = self.filter
        kf.x = self.W @ kf.x
        if self.covariance_by == "FW":
            kf.P = self.W @ kf.P @ self.W.T
        kf.predict()

    def update(self, z: FloatArray | None, R: FloatArray) -> None:
        """Update, denoise, and form the weights; or coast with the weights as they are."""
        if z is None:
            self.missed = True
            return
        kf = self.filter
        innovation = z - kf.H @ kf.x
        kf.update(z, R)
        if self.missed and self.after_gap == "reset":
            self.positions, self.W = [], np.eye(len(self.W))
        self.missed = False
        # z^ = z - (H K) diag(D) (eq. clear_noise_measurement)
        HK = kf.H @ kf.K
        denoised = {
            "literal": z - HK @ np.diag(R),
            "innovation": z - HK @ innovation,
            "posterior": kf.H @ kf.x,
            "raw": z,
        }
        self.positions = [*self.positions, denoised[self.denoise]][-(self.k + self.order - 1) :]
        if len(self.positions) == self.k + self.order - 1:
            self._weigh(np.array(self.positions))

    def _weigh(self, z: FloatArray) -> None:
        """w = min(sigma / l, 1) (eq. deviation_dynamics, weights) of z, dz, d2z over k values."""
        m = self.order + 1
        for d, factor in enumerate(self.factors):
            theta = np.diff(z, n=d, axis=0)[-self.k :]
            sigma = np.sqrt(((theta - theta.mean(axis=0)) ** 2).sum(axis=0) / (self.k - 1))
            if self.axes == "joint":
                sigma[:] = np.hypot(*sigma)
            for axis in range(2):
                entry = axis * m + d + 1
                self.W[entry, entry] = min(sigma[axis] / factor, 1.0)
