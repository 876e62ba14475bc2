"""The interacting multiple model filter (Blom and Bar-Shalom, 1988): CV + CA, or CV + CA + CJ.

Each step mixes the models' states by mu_{i|j} = pi_ij mu_i / c_j, c_j = sum_i pi_ij mu_i, lets
each model predict and update, and weighs them by mu_j = c_j Lambda_j / sum. In a gap the
probabilities propagate by the Markov matrix, mu_j = c_j, and no likelihood is applied.

The models differ in size. Every state is stored in the largest model's; `zero` mixing takes a
smaller model's missing derivatives as zero, `unbiased` mixing takes them, mean and covariance,
from the model that is mixed into (Yuan et al., 2012), so that CV does not pull CA's acceleration
towards zero.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numba import njit

from mdkf.estimator import check_measurement, check_step
from mdkf.kalman import chain, check_order, start_chains
from mdkf.kernels import predict_covariance, predict_mean, update_state
from mdkf.motion import PROCESS_NOISE, START_VARIANCE
from mdkf.tables import FloatArray

Mixing = Literal["unbiased", "zero"]


@dataclass(frozen=True, eq=False)
class ImmState:
    """n tracks of K models, all in the largest model's m = order + 1 derivatives per axis.

    mean (n, K, 2m), covariance (n, K, 2m, 2m), probability (n, K).
    """

    mean: FloatArray
    covariance: FloatArray
    probability: FloatArray


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
        check_order(self.order, (2, 3))
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
        n, K, m = len(position), self.order, self.order + 1
        mean = np.zeros((n, K, 2 * m))
        covariance = np.zeros((n, K, 2 * m, 2 * m))
        for j in range(K):
            x, P = start_chains(position, self.order, self.start_variance)
            missing = np.flatnonzero(np.tile(np.arange(m) > j + 1, 2))
            P[:, missing, missing] = 0.0
            mean[:, j], covariance[:, j] = x, P
        return ImmState(mean, covariance, np.full((n, K), 1.0 / K))

    def predict(self, state: ImmState, dt: float) -> ImmState:
        """States dt [s] later, mixed first."""
        check_step(dt)
        K, m = self.order, self.order + 1
        F, Q = np.zeros((K, m, m)), np.zeros((K, m, m))
        for j in range(K):
            F[j, : j + 2, : j + 2], Q[j, : j + 2, : j + 2] = chain(j + 1, dt, self.process_density)
        mean, covariance = np.empty_like(state.mean), np.empty_like(state.covariance)
        probability = state.probability.copy()
        unbiased = self.mixing == "unbiased"
        arrays = (state.mean, state.covariance, mean, covariance, probability)
        _predict(*arrays, self.markov, F, Q, unbiased)
        return ImmState(mean, covariance, probability)

    def update(self, state: ImmState, position: FloatArray, noise: FloatArray) -> ImmState:
        """States after positions (n, 2) with covariance (n, 2, 2); NaN rows are not measured."""
        check_measurement(len(state.mean), position, noise)
        mean, covariance = state.mean.copy(), state.covariance.copy()
        probability = state.probability.copy()
        _update(mean, covariance, probability, position, noise)
        return ImmState(mean, covariance, probability)

    def position(self, state: ImmState) -> FloatArray:
        """Positions (n, 2) of the mixture's mean [m]."""
        return _mixture_mean(state)[:, :: self.order + 1]

    def velocity(self, state: ImmState) -> FloatArray:
        """Velocities (n, 2) of the mixture's mean [m/s]."""
        return _mixture_mean(state)[:, 1 :: self.order + 1]

    def covariance(self, state: ImmState) -> FloatArray:
        """Covariances (n, 2, 2) of the mixture's position, the models' spread included [m2]."""
        m = self.order + 1
        positions = state.mean[:, :, ::m]
        spread = positions - self.position(state)[:, None, :]
        within = state.covariance[:, :, ::m, ::m] + spread[:, :, :, None] * spread[:, :, None, :]
        combined: FloatArray = np.einsum("nk,nkij->nij", state.probability, within)
        return combined

    def diagnostics(self, state: ImmState) -> Mapping[str, FloatArray]:
        """Mode probabilities: probability_cv, probability_ca, (probability_cj)."""
        names = ("cv", "ca", "cj")[: self.order]
        return {f"probability_{name}": state.probability[:, j] for j, name in enumerate(names)}


def _mixture_mean(state: ImmState) -> FloatArray:
    mean: FloatArray = np.einsum("nk,nki->ni", state.probability, state.mean)
    return mean


@njit(cache=True)
def _predict(
    mean: FloatArray,
    covariance: FloatArray,
    new_mean: FloatArray,
    new_covariance: FloatArray,
    probability: FloatArray,
    markov: FloatArray,
    F: FloatArray,
    Q: FloatArray,
    unbiased: bool,
) -> None:
    models = mean.shape[1]
    c, weight = np.empty(models), np.empty(models)
    for k in range(mean.shape[0]):
        for j in range(models):
            c[j] = 0.0
            for i in range(models):
                c[j] += markov[i, j] * probability[k, i]
            for i in range(models):
                weight[i] = markov[i, j] * probability[k, i] / c[j]
            _mix(mean[k], covariance[k], weight, j, unbiased, new_mean[k, j], new_covariance[k, j])
            predict_mean(new_mean[k, j], F[j])
            predict_covariance(new_covariance[k, j], F[j], Q[j])
        for j in range(models):
            probability[k, j] = c[j]


@njit(cache=True)
def _mix(
    mean: FloatArray,
    covariance: FloatArray,
    weight: FloatArray,
    j: int,
    unbiased: bool,
    x: FloatArray,
    P: FloatArray,
) -> None:
    """Mix all models' means (K, 2m) and covariances into model j's x and P.

    Model i knows the derivatives 0..i+1 of an axis; entries that model j has no use for are 0.
    """
    K, n = mean.shape
    m = n // 2
    for a in range(n):
        x[a] = 0.0
        if a % m <= j + 1:
            for i in range(K):
                source = j if unbiased and a % m > i + 1 else i
                x[a] += weight[i] * mean[source, a]
    for a in range(n):
        for b in range(n):
            P[a, b] = 0.0
            if a % m > j + 1 or b % m > j + 1:
                continue
            for i in range(K):
                a_missing, b_missing = a % m > i + 1, b % m > i + 1
                source_a = j if unbiased and a_missing else i
                source_b = j if unbiased and b_missing else i
                # What is taken from the larger model is uncorrelated with what is not.
                value = covariance[source_a, a, b] if source_a == source_b else 0.0
                spread = (mean[source_a, a] - x[a]) * (mean[source_b, b] - x[b])
                P[a, b] += weight[i] * (value + spread)


@njit(cache=True)
def _update(
    mean: FloatArray,
    covariance: FloatArray,
    probability: FloatArray,
    position: FloatArray,
    noise: FloatArray,
) -> None:
    models = mean.shape[1]
    likelihood = np.empty(models)
    for k in range(mean.shape[0]):
        if np.isnan(position[k, 0]):
            continue
        for j in range(models):
            likelihood[j] = update_state(mean[k, j], covariance[k, j], position[k], noise[k])[0]
        # Relative to the best, so that a large jump cannot underflow every model.
        best = likelihood.max()
        total = 0.0
        for j in range(models):
            probability[k, j] *= np.exp(likelihood[j] - best)
            total += probability[k, j]
        for j in range(models):
            probability[k, j] /= total
