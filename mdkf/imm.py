"""The interacting multiple model filter (Blom and Bar-Shalom, 1988): CV + CA, or CV + CA + CJ.

Each step mixes the models' states by mu_{i|j} = pi_ij mu_i / c_j, c_j = sum_i pi_ij mu_i, lets
each model predict and update, and weighs them by mu_j = c_j Lambda_j / sum. In a gap the
probabilities propagate by the Markov matrix, mu_j = c_j, and no likelihood is applied.

The models differ in size. Every state is stored in the largest model's; `zero` mixing takes a
smaller model's missing derivatives as zero, `unbiased` mixing takes them, mean and covariance,
from the model that is mixed into (Yuan et al., 2012), so that CV does not pull CA's acceleration
towards zero.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, NamedTuple, get_args

import numpy as np

from mdkf import batch
from mdkf.batch import Moments, Noise, Pair, moments_of_all, predict_all, update_all
from mdkf.estimator import check_step, checked_measurement, checked_start, copied
from mdkf.kalman import chain, check_model, innovation_columns, no_innovation, start_chains
from mdkf.kernels import predict_track, start_track, update_track, write_innovation
from mdkf.mixing import Models, copy_track, mix_models, mixture_innovation, mixture_moments
from mdkf.motion import PROCESS_NOISE, START_VARIANCE, taylor
from mdkf.tables import FloatArray, IntArray

Mixing = Literal["unbiased", "zero"]


@dataclass(frozen=True, eq=False)
class ImmState:
    """n tracks of K models, all in the largest model's m = order + 1 derivatives per axis.

    mean (n, K, 2m), covariance (n, K, 2m, 2m), probability (n, K); innovation (n, 2) [m], the
    last measurement minus the mixture's prediction, and nis (n,), its square normalised by the
    mixture's covariance: NaN where the last frame had no measurement.
    """

    mean: FloatArray
    covariance: FloatArray
    probability: FloatArray
    innovation: FloatArray
    nis: FloatArray


@dataclass(frozen=True)
class InteractingMultipleModel:
    """IMM filter of the models CV .. order, batched over tracks.

    stay: the Markov matrix's diagonal; the rest of a row is spread evenly. Modes start uniform.
    """

    order: int = 2
    mixing: Mixing = "unbiased"
    stay: float = 0.95
    process_density: tuple[float, ...] = PROCESS_NOISE
    start_variance: tuple[float, ...] = START_VARIANCE

    def __post_init__(self) -> None:
        check_model(self.order, (2, 3), self.process_density, self.start_variance)
        if self.mixing not in get_args(Mixing):
            raise ValueError(f"mixing is {self.mixing!r}, expected one of {get_args(Mixing)}")
        if not 0 < self.stay < 1:
            raise ValueError(f"stay is {self.stay}, expected a probability in (0, 1)")

    @property
    def markov(self) -> FloatArray:
        """Markov matrix (K, K): probability of model j after model i."""
        leave = (1.0 - self.stay) / (self.order - 1)
        return np.full((self.order, self.order), leave) + (self.stay - leave) * np.eye(self.order)

    def start(self, position: FloatArray, noise: FloatArray) -> ImmState:
        """States of n new tracks at positions (n, 2); the noise does not enter (RobMOT)."""
        z = checked_start(position, noise)
        n, K, m = len(z), self.order, self.order + 1
        mean = np.zeros((n, K, 2 * m))
        covariance = np.zeros((n, K, 2 * m, 2 * m))
        for j in range(K):
            x, P = start_chains(z, self.order, self.start_variance)
            missing = np.flatnonzero(np.tile(np.arange(m) > j + 1, 2))
            P[:, missing, missing] = 0.0
            mean[:, j], covariance[:, j] = x, P
        return ImmState(mean, covariance, np.full((n, K), 1.0 / K), *no_innovation(n))

    def predict(self, state: ImmState, dt: float) -> ImmState:
        """States dt [s] later, mixed first."""
        check_step(dt)
        mean, covariance = state.mean.copy(), state.covariance.copy()
        new = ImmState(mean, covariance, state.probability.copy(), state.innovation, state.nis)
        predict_all(self.batch(new, dt), len(mean))
        return new

    def update(self, state: ImmState, position: FloatArray, noise: FloatArray) -> ImmState:
        """States after positions (n, 2) with covariance (n, 2, 2); NaN rows are not measured."""
        z, R = checked_measurement(len(state.mean), position, noise)
        new = copied(state)
        update_all(self.batch(new), z, R)
        return new

    def batch(self, state: ImmState, dt: float = 1.0) -> "ImmBatch":
        """The state's arrays for the kernels (`mdkf.batch`); updates do not depend on dt [s]."""
        _, K, size = state.mean.shape
        markov, Q = _bank(self, dt)
        return ImmBatch(
            state.mean.reshape(-1, size),
            state.covariance.reshape(-1, size, size),
            state.probability,
            state.innovation,
            state.nis,
            taylor(self.order, dt),
            Q,
            self.start_variance[: self.order + 1],
            markov,
            self.mixing == "unbiased",
            (np.empty((K, size)), np.empty((K, size, size))),
            (np.empty((K, size), dtype=np.int64), np.empty((K, size))),
            np.empty((size, 2)),
            np.empty((2, K)),
        )

    def position(self, state: ImmState) -> FloatArray:
        """Positions (n, 2) of the mixture's mean [m]."""
        return self._mixture(state)[0]

    def velocity(self, state: ImmState) -> FloatArray:
        """Velocities (n, 2) of the mixture's mean [m/s]."""
        return self._mixture(state)[1]

    def covariance(self, state: ImmState) -> FloatArray:
        """Covariances (n, 2, 2) of the mixture's position, the models' spread included [m2]."""
        return self._mixture(state)[2]

    def _mixture(self, state: ImmState) -> tuple[FloatArray, FloatArray, FloatArray]:
        n = len(state.mean)
        position, velocity, covariance = np.empty((n, 2)), np.empty((n, 2)), np.empty((n, 2, 2))
        moments_of_all(self.batch(state), position, velocity, covariance)
        return position, velocity, covariance

    def diagnostics(self, state: ImmState) -> Mapping[str, FloatArray]:
        """probability_cv, probability_ca, (probability_cj); innovation_x, innovation_y [m], nis."""
        names = ("cv", "ca", "cj")[: self.order]
        modes = {f"probability_{name}": state.probability[:, j] for j, name in enumerate(names)}
        return modes | innovation_columns(state.innovation, state.nis)


@lru_cache(maxsize=256)
def _bank(
    estimator: InteractingMultipleModel, dt: float
) -> tuple[tuple[tuple[float, ...], ...], FloatArray]:
    """Markov matrix (K, K) and the models' process noise (K, m, m), zero where one has no entry."""
    K, m = estimator.order, estimator.order + 1
    Q = np.zeros((K, m, m))
    for j in range(K):
        Q[j, : j + 2, : j + 2] = chain(j + 1, dt, estimator.process_density)[1]
    Q.setflags(write=False)
    return tuple(tuple(row) for row in estimator.markov.tolist()), Q


class ImmBatch(NamedTuple):
    """An `ImmState` and its models as the kernels take them.

    mean (n K, 2m), covariance (n K, 2m, 2m): row k K + j is model j of track k; Q (K, m, m). What
    follows `unbiased` is overwritten (`mdkf.mixing`).
    """

    mean: FloatArray
    covariance: FloatArray
    probability: FloatArray
    innovation: FloatArray
    nis: FloatArray
    taylor: tuple[float, ...]
    Q: FloatArray
    start_variance: tuple[float, ...]
    markov: tuple[tuple[float, ...], ...]
    unbiased: bool
    before: Models
    mixed: tuple[IntArray, FloatArray]
    work: FloatArray
    by_model: FloatArray


@batch.start.register
def _start(batch: ImmBatch, k: int, z: Pair) -> None:
    K, m = len(batch.markov), len(batch.taylor)
    for j in range(K):
        row = k * K + j
        start_track(batch.mean, batch.covariance, row, z, batch.start_variance)
        for d in range(j + 2, m):
            batch.covariance[row, d, d] = 0.0
            batch.covariance[row, m + d, m + d] = 0.0
        batch.probability[k, j] = 1.0 / K
    batch.innovation[k, 0], batch.innovation[k, 1], batch.nis[k] = np.nan, np.nan, np.nan


@batch.predict.register
def _predict(batch: ImmBatch, k: int) -> None:
    mean, covariance, markov = batch.mean, batch.covariance, batch.markov
    m = len(batch.taylor)
    K = len(markov)
    c, weight = batch.by_model
    copy_track(mean, covariance, k, K, m, batch.before)
    for j in range(K):
        c[j] = 0.0
        for i in range(K):
            c[j] += markov[i][j] * batch.probability[k, i]
        for i in range(K):
            weight[i] = markov[i][j] * batch.probability[k, i] / c[j]
        row = k * K + j
        mixing = batch.unbiased, mean, covariance, row, batch.mixed
        mix_models(batch.before, weight, j, K, m, *mixing)
        # A smaller model's missing derivatives are exactly zero: it moves by the same chain.
        predict_track(mean, covariance, row, batch.taylor, batch.Q[j])
    for j in range(K):
        batch.probability[k, j] = c[j]


@batch.update.register
def _update(batch: ImmBatch, k: int, z: Pair, R: Noise) -> None:
    if np.isnan(z[0]):
        batch.innovation[k, 0], batch.innovation[k, 1], batch.nis[k] = np.nan, np.nan, np.nan
        return
    mean, covariance, probability = batch.mean, batch.covariance, batch.probability
    K, m = len(batch.markov), len(batch.taylor)
    yx, yy, nis = mixture_innovation(mean, covariance, probability, k, z, R, K, m)
    batch.innovation[k, 0], batch.innovation[k, 1], batch.nis[k] = yx, yy, nis
    # Likelihoods but for a common factor, relative to the nearest model's, so that a large
    # jump cannot underflow them all. A model that has underflowed has no part in it.
    square, determinant = batch.by_model
    nearest = math.inf
    for j in range(K):
        updated = update_track(mean, covariance, k * K + j, m, z, R, batch.work)
        square[j], determinant[j] = updated[2], updated[3]
        if probability[k, j] > 0.0:
            nearest = min(nearest, square[j])
    total = 0.0
    for j in range(K):
        if probability[k, j] > 0.0:
            likelihood = math.exp(0.5 * (nearest - square[j])) / math.sqrt(determinant[j])
            probability[k, j] *= likelihood
            total += probability[k, j]
    for j in range(K):
        probability[k, j] /= total


@batch.moments.register
def _moments(batch: ImmBatch, k: int) -> Moments:
    K, m = len(batch.markov), len(batch.taylor)
    return mixture_moments(batch.mean, batch.covariance, batch.probability, k, K, m)


@batch.diagnose.register
def _diagnose(batch: ImmBatch, k: int, columns: FloatArray, first: int, row: int) -> None:
    K = len(batch.markov)
    for j in range(K):
        columns[first + j, row] = batch.probability[k, j]
    write_innovation(batch.innovation, batch.nis, k, columns, first + K, row)
