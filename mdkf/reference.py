"""The reference tier: the same filters, one track at a time, on filterpy objects and plain numpy.

Slow and obvious. The tests hold the kernels against these, and the ratios of the paper's latency
table belong to this tier. States are [px, vx, (ax), py, vy, (ay)].
"""

import copy

import numpy as np
from filterpy.kalman import IMMEstimator, KalmanFilter
from scipy.linalg import block_diag
from scipy.stats import multivariate_normal

from mdkf.motion import PROCESS_NOISE, START_VARIANCE, process_noise, transition
from mdkf.tables import FloatArray


def filterpy_kalman(position: FloatArray, order: int, dt: float, size: int = 0) -> KalmanFilter:
    """A filterpy Kalman filter of motion order 1, 2 or 3 at rest in `position` (2,) [m].

    size: derivatives kept per axis; those above the order stay zero (`filterpy_imm` needs states
    of one size).
    """
    m = max(size, order + 1)
    used = np.arange(m) <= order
    F, Q = np.zeros((m, m)), np.zeros((m, m))
    F[np.ix_(used, used)] = transition(order, dt)
    Q[np.ix_(used, used)] = process_noise(order, dt, PROCESS_NOISE)
    built = KalmanFilter(dim_x=2 * m, dim_z=2)
    built.F, built.Q = block_diag(F, F), block_diag(Q, Q)
    built.H = np.zeros((2, 2 * m))
    built.H[0, 0] = built.H[1, m] = 1.0
    built.P = np.diag(np.tile(np.where(used, START_VARIANCE[:m], 0.0), 2))
    built.x = np.zeros(2 * m)
    built.x[[0, m]] = position
    return built


class CoastingImm(IMMEstimator):  # type: ignore[misc]
    """filterpy's IMM with a gap that is a gap.

    `IMMEstimator.update(None)` multiplies the mode probabilities by the likelihoods of the last
    measurement once more, in every frame of a gap, so that one model soon takes all. Here a
    missing measurement leaves the propagated probabilities cbar.
    """

    def update(self, z: FloatArray | None) -> None:
        """Update with a position (2,), or coast with None."""
        if z is None:
            self.mu = self.cbar.copy()
            self._compute_mixing_probabilities()
            self._compute_state_estimate()
        else:
            super().update(z)


def filterpy_imm(position: FloatArray, order: int, dt: float, stay: float = 0.95) -> CoastingImm:
    """filterpy's IMM of the models CV .. order with zero-padded mixing."""
    models = [filterpy_kalman(position, j + 1, dt, size=order + 1) for j in range(order)]
    leave = (1.0 - stay) / (order - 1)
    markov = np.full((order, order), leave) + (stay - leave) * np.eye(order)
    return CoastingImm(models, np.full(order, 1.0 / order), markov)


class UnbiasedImm:
    """IMM in plain numpy with models of their own size and unbiased mixing (Yuan et al., 2012).

    A smaller model's state is augmented, before it is mixed into a larger one, by the larger
    one's own missing derivatives: mean and covariance, uncorrelated with the rest.
    """

    def __init__(self, position: FloatArray, order: int, dt: float, stay: float = 0.95) -> None:
        self.models = [filterpy_kalman(position, j + 1, dt) for j in range(order)]
        leave = (1.0 - stay) / (order - 1)
        self.markov = np.full((order, order), leave) + (stay - leave) * np.eye(order)
        self.mu = np.full(order, 1.0 / order)

    def predict(self) -> None:
        """Mix, then predict each model."""
        c = self.mu @ self.markov
        before = [(model.x.copy(), model.P.copy()) for model in self.models]
        for j, model in enumerate(self.models):
            weights = self.markov[:, j] * self.mu / c[j]
            sources = [self._as_model(before, i, j) for i in range(len(before))]
            mean = sum(w * x for w, (x, _) in zip(weights, sources, strict=True))
            covariance = np.zeros_like(model.P)
            for w, (x, P) in zip(weights, sources, strict=True):
                covariance += w * (P + np.outer(x - mean, x - mean))
            model.x, model.P = mean, covariance
            model.predict()
        self.mu = c

    def update(self, z: FloatArray | None, R: FloatArray) -> None:
        """Update each model with a position (2,) and reweigh, or coast with None."""
        if z is None:
            return
        likelihood = np.empty(len(self.models))
        for j, model in enumerate(self.models):
            S = model.H @ model.P @ model.H.T + R
            likelihood[j] = multivariate_normal.logpdf(z, model.H @ model.x, S)
            model.update(z, R=R)
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


class NumpyMotionDynamics:
    """MD-KF of the paper in plain numpy, default options, equations symbol by symbol."""

    def __init__(
        self, position: FloatArray, order: int, dt: float, k: int, factors: tuple[float, ...]
    ) -> None:
        self.filter = filterpy_kalman(position, order, dt)
        self.plain_F = copy.deepcopy(self.filter.F)
        self.k, self.order, self.factors = k, order, factors
        self.W = np.eye(2 * (order + 1))
        self.positions = [np.array(position)]
        self.missed = False

    def predict(self) -> None:
        """x = F W x, P = F P F' + Q."""
        kf = self.filter
        kf.x = self.plain_F @ self.W @ kf.x
        kf.P = self.plain_F @ kf.P @ self.plain_F.T + kf.Q

    def update(self, z: FloatArray | None, R: FloatArray) -> None:
        """Update, denoise, and form the weights; None coasts."""
        if z is None:
            self.missed = True
            return
        kf = self.filter
        kf.update(z, R=R)
        if self.missed:
            self.positions, self.W = [], np.eye(len(self.W))
            self.missed = False
        self.positions.append(z - (kf.H @ kf.K) @ np.diag(R))
        if len(self.positions) < self.k + self.order - 1:
            return
        values = np.array(self.positions)
        m = self.order + 1
        for d, factor in enumerate(self.factors):
            deviation = np.std(np.diff(values, n=d, axis=0)[-self.k :], axis=0, ddof=1)
            for axis in range(2):
                entry = axis * m + d + 1
                self.W[entry, entry] = min(deviation[axis] / factor, 1.0)
