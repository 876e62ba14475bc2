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
from typing import Literal, get_args

import numpy as np

from mdkf.compiled import kernel
from mdkf.estimator import arrays, check_step, checked_measurement, checked_start, copied
from mdkf.kalman import chain, check_model, innovation_columns, no_innovation, start_chains
from mdkf.kernels import predict_track, update_track
from mdkf.mixing import copy_track, mix_models, mixture_innovation, mixture_moments
from mdkf.motion import PROCESS_NOISE, START_VARIANCE, derivatives, taylor
from mdkf.sequence import Estimates
from mdkf.tables import FloatArray

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
        probability = state.probability.copy()
        _predict(
            *_by_model(mean, covariance),
            probability,
            self.mixing == "unbiased",
            taylor(self.order, dt),
            *_bank(self, dt),
        )
        return ImmState(mean, covariance, probability, state.innovation, state.nis)

    def update(self, state: ImmState, position: FloatArray, noise: FloatArray) -> ImmState:
        """States after positions (n, 2) with covariance (n, 2, 2); NaN rows are not measured."""
        z, R = checked_measurement(len(state.mean), position, noise)
        new = copied(state)
        models = _by_model(new.mean, new.covariance)
        _update(*models, new.probability, new.innovation, new.nis, z, R, *_sizes(self.order))
        return new

    def run_compiled(
        self, state: ImmState, positions: FloatArray, noise: FloatArray, dt: float, out: Estimates
    ) -> None:
        """The compiled pass of `mdkf.filter_sequence`: fills `out`, and overwrites the state."""
        models = _by_model(state.mean, state.covariance)
        modes = (state.probability, state.innovation, state.nis)
        model = (self.mixing == "unbiased", taylor(self.order, dt), *_bank(self, dt))
        sizes = _sizes(self.order)
        arguments = (*models, *modes, positions, noise, *model, *sizes, *arrays(out))
        _filter(*arguments)

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
        models = _by_model(state.mean, state.covariance)
        mixture_moments(*models, state.probability, position, velocity, covariance)
        return position, velocity, covariance

    def diagnostics(self, state: ImmState) -> Mapping[str, FloatArray]:
        """probability_cv, probability_ca, (probability_cj); innovation_x, innovation_y [m], nis."""
        names = ("cv", "ca", "cj")[: self.order]
        modes = {f"probability_{name}": state.probability[:, j] for j, name in enumerate(names)}
        return modes | innovation_columns(state.innovation, state.nis)


def _by_model(mean: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Views with one row for each track and model, as the kernels of a track take them."""
    size = mean.shape[2]
    return mean.reshape(-1, size), covariance.reshape(-1, size, size)


def _sizes(order: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """The derivatives of an axis and the models, as tuples (`mdkf.motion.derivatives`)."""
    return derivatives(order), tuple(range(order))


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


@kernel
def _predict(
    mean: FloatArray,
    covariance: FloatArray,
    probability: FloatArray,
    unbiased: bool,
    taylor: tuple[float, ...],
    markov: tuple[tuple[float, ...], ...],
    Q: FloatArray,
) -> None:
    m = len(taylor)
    K = len(markov)
    before = np.empty((K, 2 * m)), np.empty((K, 2 * m, 2 * m))
    work = np.empty((K, 2 * m), dtype=np.int64), np.empty((K, 2 * m))
    c, weight = np.empty(K), np.empty(K)
    for k in range(probability.shape[0]):
        copy_track(mean, covariance, k, K, m, before)
        for j in range(K):
            c[j] = 0.0
            for i in range(K):
                c[j] += markov[i][j] * probability[k, i]
            for i in range(K):
                weight[i] = markov[i][j] * probability[k, i] / c[j]
            row = k * K + j
            mix_models(before, weight, j, K, m, unbiased, mean, covariance, row, work)
            # A smaller model's missing derivatives are exactly zero: it moves by the same chain.
            predict_track(mean, covariance, row, taylor, Q[j])
        for j in range(K):
            probability[k, j] = c[j]


@kernel
def _update(
    mean: FloatArray,
    covariance: FloatArray,
    probability: FloatArray,
    innovation: FloatArray,
    nis: FloatArray,
    z: FloatArray,
    R: FloatArray,
    derivatives: tuple[int, ...],
    modes: tuple[int, ...],
) -> None:
    m = len(derivatives)
    K = len(modes)
    square, determinant, work = np.empty(K), np.empty(K), np.empty((2 * m, 2))
    for k in range(probability.shape[0]):
        if np.isnan(z[k, 0]):
            innovation[k, 0], innovation[k, 1], nis[k] = np.nan, np.nan, np.nan
            continue
        mixture_innovation(mean, covariance, probability, innovation, nis, k, z, R, K, m)
        # Likelihoods but for a common factor, relative to the nearest model's, so that a large
        # jump cannot underflow them all. A model that has underflowed has no part in it.
        nearest = math.inf
        for j in range(K):
            updated = update_track(mean, covariance, k * K + j, m, z, R, k, work)
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


@kernel
def _filter(
    mean: FloatArray,
    covariance: FloatArray,
    probability: FloatArray,
    innovation: FloatArray,
    nis: FloatArray,
    z: FloatArray,
    R: FloatArray,
    unbiased: bool,
    taylor: tuple[float, ...],
    markov: tuple[tuple[float, ...], ...],
    Q: FloatArray,
    derivatives: tuple[int, ...],
    modes: tuple[int, ...],
    position: FloatArray,
    velocity: FloatArray,
    position_covariance: FloatArray,
) -> None:
    models = mean, covariance, probability
    for t in range(z.shape[0]):
        if t > 0:
            _predict(*models, unbiased, taylor, markov, Q)
            _update(*models, innovation, nis, z[t], R[t % R.shape[0]], derivatives, modes)
        mixture_moments(*models, position[t], velocity[t], position_covariance[t])
