"""The motion-dynamics Kalman filter (MD-KF): one motion model, its derivatives weighted.

Prediction (paper, eq. prediction_state_with_dynamics): x = F W x, W = diag(1, w_v, w_a, w_j) per
axis. The weights (eq. weights) compare how much the last k denoised positions, their first and
their second differences vary with the motion dynamics factors l:
w_v = min(sigma(z) / l_v, 1), w_a = min(sigma(dz) / l_a, 1), w_j = min(sigma(d2z) / l_j, 1),
sigma the sample standard deviation (eq. deviation_dynamics), differences in metres per frame.
W = I until the window holds enough positions. In a gap W stays as it was.
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
from mdkf.tables import BoolArray, FloatArray, IntArray

Covariance = Literal["F", "FW"]
Denoise = Literal["literal", "innovation", "posterior", "raw"]
AfterGap = Literal["reset", "keep"]
Axes = Literal["independent", "joint"]

FACTORS = {2: (0.15, 0.2), 3: (0.15, 0.1, 0.5)}
"""The paper's motion dynamics factors l_v, l_a, (l_j) [m], by motion order."""


@dataclass(frozen=True, eq=False)
class MotionDynamicsState:
    """n tracks, m = order + 1 derivatives per axis.

    mean (n, 2m), covariance (n, 2m, 2m); weight (n, 2, m), the diagonal of W by axis;
    window (n, k + order - 1, 2): denoised positions [m], oldest first, the last `count` (n,) of
    them valid; missed (n,): whether the last frame had no measurement.
    """

    mean: FloatArray
    covariance: FloatArray
    weight: FloatArray
    window: FloatArray
    count: IntArray
    missed: BoolArray


@dataclass(frozen=True)
class MotionDynamics:
    """MD-KF of motion order 2 (acceleration) or 3 (jerk), batched over tracks.

    window: k, the number of values behind each standard deviation.
    factors: l_v, l_a, (l_j) [m]; the paper's for the order if None.
    covariance: `F` (F P F' + Q, "as usual") or `FW` (F W P W F' + Q).
    denoise: what stands for the position in the window. `literal`: z - H K D with D the
        detector's variances, a constant shift; `innovation`: the same with D = z - H x;
        `posterior`: H x after the update; `raw`: z.
    after_gap: `reset` clears the window at the first measurement after a gap, because a
        difference across it is not one frame's; `keep` goes on.
    axes: `independent` weights (paper) or one `joint` weight from both axes' deviations.
    """

    order: int = 2
    window: int = 10
    factors: tuple[float, ...] | None = None
    covariance_by: Covariance = "F"
    denoise: Denoise = "literal"
    after_gap: AfterGap = "reset"
    axes: Axes = "independent"
    process_density: tuple[float, ...] = PROCESS_NOISE
    start_variance: tuple[float, ...] = START_VARIANCE

    def __post_init__(self) -> None:
        check_order(self.order, (2, 3))
        if self.window < 2:
            raise ValueError(f"window is {self.window}, expected at least 2 values")
        factors = self.motion_factors
        if len(factors) != self.order or min(factors) <= 0:
            raise ValueError(f"factors are {factors}, expected {self.order} lengths above 0 m")
        for option, kind in (
            ("covariance_by", Covariance),
            ("denoise", Denoise),
            ("after_gap", AfterGap),
            ("axes", Axes),
        ):
            if getattr(self, option) not in get_args(kind):
                raise ValueError(
                    f"{option} is {getattr(self, option)!r}, expected one of {get_args(kind)}"
                )

    @property
    def motion_factors(self) -> tuple[float, ...]:
        """l_v, l_a, (l_j) [m]."""
        return FACTORS[self.order] if self.factors is None else self.factors

    def start(self, position: FloatArray, noise: FloatArray) -> MotionDynamicsState:
        """States of n new tracks at positions (n, 2); the noise does not enter (RobMOT)."""
        n = len(position)
        mean, covariance = start_chains(position, self.order, self.start_variance)
        window = np.zeros((n, self.window + self.order - 1, 2))
        window[:, -1] = position
        return MotionDynamicsState(
            mean,
            covariance,
            weight=np.ones((n, 2, self.order + 1)),
            window=window,
            count=np.ones(n, dtype=np.int64),
            missed=np.zeros(n, dtype=np.bool_),
        )

    def predict(self, state: MotionDynamicsState, dt: float) -> MotionDynamicsState:
        """States dt [s] later."""
        check_step(dt)
        mean, covariance = state.mean.copy(), state.covariance.copy()
        F, Q = chain(self.order, dt, self.process_density)
        _predict(mean, covariance, state.weight, F, Q, self.covariance_by == "FW")
        return MotionDynamicsState(
            mean, covariance, state.weight, state.window, state.count, state.missed
        )

    def update(
        self, state: MotionDynamicsState, position: FloatArray, noise: FloatArray
    ) -> MotionDynamicsState:
        """States after positions (n, 2) with covariance (n, 2, 2); NaN rows are not measured."""
        check_measurement(len(state.mean), position, noise)
        new = MotionDynamicsState(
            state.mean.copy(),
            state.covariance.copy(),
            state.weight.copy(),
            state.window.copy(),
            state.count.copy(),
            np.isnan(position[:, 0]),
        )
        denoised = np.empty_like(position)
        denoise = get_args(Denoise).index(self.denoise)
        _update(new.mean, new.covariance, denoised, denoise, position, noise)
        if self.after_gap == "reset":
            reset = state.missed & ~new.missed
            new.count[reset] = 0
            new.weight[reset] = 1.0
        factors = np.array(self.motion_factors)
        _weigh(new.weight, new.window, new.count, denoised, factors, self.axes == "joint")
        return new

    def position(self, state: MotionDynamicsState) -> FloatArray:
        """Positions (n, 2) [m]."""
        return state.mean[:, :: self.order + 1]

    def velocity(self, state: MotionDynamicsState) -> FloatArray:
        """Velocities (n, 2) [m/s]."""
        return state.mean[:, 1 :: self.order + 1]

    def covariance(self, state: MotionDynamicsState) -> FloatArray:
        """Covariances of the positions (n, 2, 2) [m2]."""
        return state.covariance[:, :: self.order + 1, :: self.order + 1]

    def diagnostics(self, state: MotionDynamicsState) -> Mapping[str, FloatArray]:
        """Weights: weight_vx, weight_vy, weight_ax, weight_ay, (weight_jx, weight_jy)."""
        return {
            f"weight_{derivative}{axis}": state.weight[:, a, d + 1]
            for d, derivative in enumerate("vaj"[: self.order])
            for a, axis in enumerate("xy")
        }


@njit(cache=True)
def _predict(
    mean: FloatArray,
    covariance: FloatArray,
    weight: FloatArray,
    F: FloatArray,
    Q: FloatArray,
    weigh_covariance: bool,
) -> None:
    m = F.shape[0]
    for k in range(mean.shape[0]):
        for i in range(2 * m):
            w = weight[k, i // m, i % m]
            mean[k, i] *= w
            if weigh_covariance:
                for j in range(2 * m):
                    covariance[k, i, j] *= w
                    covariance[k, j, i] *= w
        predict_mean(mean[k], F)
        predict_covariance(covariance[k], F, Q)


@njit(cache=True)
def _update(
    mean: FloatArray,
    covariance: FloatArray,
    denoised: FloatArray,
    denoise: int,
    position: FloatArray,
    noise: FloatArray,
) -> None:
    """Update measured tracks and write their denoised positions (eq. clear_noise_measurement);
    NaN where nothing was measured. `denoise` counts in the order of `Denoise`."""
    m = mean.shape[1] // 2
    for k in range(mean.shape[0]):
        z, R = position[k], noise[k]
        denoised[k, 0], denoised[k, 1] = z[0], z[1]
        if np.isnan(z[0]):
            continue
        _, y0, y1, h00, h01, h10, h11 = update_state(mean[k], covariance[k], z, R)
        if denoise == 0:
            denoised[k, 0] -= h00 * R[0, 0] + h01 * R[1, 1]
            denoised[k, 1] -= h10 * R[0, 0] + h11 * R[1, 1]
        elif denoise == 1:
            denoised[k, 0] -= h00 * y0 + h01 * y1
            denoised[k, 1] -= h10 * y0 + h11 * y1
        elif denoise == 2:
            denoised[k, 0] = mean[k, 0]
            denoised[k, 1] = mean[k, m]


@njit(cache=True)
def _weigh(
    weight: FloatArray,
    window: FloatArray,
    count: IntArray,
    denoised: FloatArray,
    factors: FloatArray,
    joint: bool,
) -> None:
    """Append the denoised positions and, where a window is full, weigh the derivatives."""
    length, order = window.shape[1], factors.shape[0]
    k = length - order + 1
    values = np.empty(length)
    deviation = np.empty((2, order))
    for track in range(window.shape[0]):
        if np.isnan(denoised[track, 0]):
            continue
        count[track] = min(count[track] + 1, length)
        for axis in range(2):
            for i in range(length - 1):
                window[track, i, axis] = window[track, i + 1, axis]
            window[track, length - 1, axis] = denoised[track, axis]
        if count[track] < length:
            continue
        for axis in range(2):
            # Relative to the newest position, so that a large coordinate costs no digits.
            for i in range(length):
                values[i] = window[track, i, axis] - window[track, length - 1, axis]
            for d in range(order):
                deviation[axis, d] = _deviation(values, length - k)
                for i in range(length - 1, 0, -1):
                    values[i] -= values[i - 1]
        for d in range(order):
            for axis in range(2):
                spread = deviation[axis, d]
                if joint:
                    spread = np.sqrt(deviation[0, d] ** 2 + deviation[1, d] ** 2)
                weight[track, axis, d + 1] = min(spread / factors[d], 1.0)


@njit(cache=True)
def _deviation(values: FloatArray, first: int) -> float:
    """Sample standard deviation (ddof = 1) of the values from the first on."""
    n = values.shape[0] - first
    mean = 0.0
    for i in range(first, values.shape[0]):
        mean += values[i] / n
    total = 0.0
    for i in range(first, values.shape[0]):
        total += (values[i] - mean) ** 2
    return float(np.sqrt(total / (n - 1)))
