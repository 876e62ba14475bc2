"""The motion-dynamics Kalman filter (MD-KF): one motion model, its derivatives weighted.

Prediction (paper, eq. prediction_state_with_dynamics): x = F W x, W = diag(1, w_v, w_a, w_j) per
axis. The weights (eq. weights) compare how much the last k denoised positions, their first and
their second differences vary with the motion dynamics factors l:
w_v = min(sigma(z) / l_v, 1), w_a = min(sigma(dz) / l_a, 1), w_j = min(sigma(d2z) / l_j, 1),
sigma the sample standard deviation (eq. deviation_dynamics), differences in metres per frame.
W = I until the window (`mdkf.motion_window`) holds enough positions. In a gap W stays as it was.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from mdkf.compiled import inlined, kernel
from mdkf.estimator import (
    arrays,
    check_step,
    checked_measurement,
    checked_start,
    copied,
)
from mdkf.kalman import (
    KalmanState,
    OneChain,
    chain,
    check_model,
    innovation_columns,
    no_innovation,
    record,
    start_chains,
)
from mdkf.kernels import predict_track, update_track
from mdkf.motion import PROCESS_NOISE, START_VARIANCE
from mdkf.motion_window import remember, weigh
from mdkf.sequence import Estimates
from mdkf.tables import BoolArray, FloatArray, IntArray

Covariance = Literal["F", "FW"]
Denoise = Literal["literal", "innovation", "posterior", "raw"]
AfterGap = Literal["reset", "keep"]
Axes = Literal["independent", "joint"]

FACTORS = {2: (0.15, 0.2), 3: (0.15, 0.1, 0.5)}
"""The paper's motion dynamics factors l_v, l_a, (l_j) [m], by motion order."""


@dataclass(frozen=True, eq=False)
class MotionDynamicsState(KalmanState):
    """A `KalmanState` of n tracks, m = order + 1 derivatives per axis, and what weighs them.

    weight (n, 2, m), the diagonal of W by axis; window (n, k + order - 1, 2): denoised positions
    [m], oldest first, the last `count` (n,) of them valid; missed (n,): whether the last frame
    had no measurement.
    """

    weight: FloatArray
    window: FloatArray
    count: IntArray
    missed: BoolArray


@dataclass(frozen=True)
class MotionDynamics(OneChain):
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
        check_model(self.order, (2, 3), self.process_density, self.start_variance)
        if self.window < 2:
            raise ValueError(f"window is {self.window}, expected at least 2 values")
        factors = self.motion_factors
        if len(factors) != self.order or not all(0 < f < math.inf for f in factors):
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
        z = checked_start(position, noise)
        n = len(z)
        window = np.zeros((n, self.window + self.order - 1, 2))
        window[:, -1] = z
        return MotionDynamicsState(
            *start_chains(z, self.order, self.start_variance),
            *no_innovation(n),
            weight=np.ones((n, 2, self.order + 1)),
            window=window,
            count=np.ones(n, dtype=np.int64),
            missed=np.zeros(n, dtype=np.bool_),
        )

    def predict(self, state: MotionDynamicsState, dt: float) -> MotionDynamicsState:
        """States dt [s] later."""
        check_step(dt)
        mean, covariance = state.mean.copy(), state.covariance.copy()
        by_fw = self.covariance_by == "FW"
        model = chain(self.order, dt, self.process_density)
        _predict(mean, covariance, state.weight, by_fw, *model)
        return MotionDynamicsState(mean, covariance, *arrays(state)[2:])

    def update(
        self, state: MotionDynamicsState, position: FloatArray, noise: FloatArray
    ) -> MotionDynamicsState:
        """States after positions (n, 2) with covariance (n, 2, 2); NaN rows are not measured."""
        z, R = checked_measurement(len(state.mean), position, noise)
        new = copied(state)
        arguments = (*arrays(new), z, R, *self._choices)
        _update(*arguments)
        return new

    def run_compiled(
        self,
        state: MotionDynamicsState,
        positions: FloatArray,
        noise: FloatArray,
        dt: float,
        out: Estimates,
    ) -> None:
        """The compiled pass of `mdkf.filter_sequence`: fills `out`, and overwrites the state."""
        model = (self.covariance_by == "FW", *chain(self.order, dt, self.process_density))
        choices = (*self._choices, *model)
        arguments = (*arrays(state), positions, noise, *choices, *arrays(out))
        _filter(*arguments)

    @property
    def _choices(self) -> tuple[tuple[float, ...], int, bool, bool]:
        """The options as the kernels take them; the factors as the paper's vector (1, l_v, ..)."""
        denoise = get_args(Denoise).index(self.denoise)
        factors = (1.0, *self.motion_factors)
        return factors, denoise, self.after_gap == "reset", self.axes == "joint"

    def diagnostics(self, state: MotionDynamicsState) -> Mapping[str, FloatArray]:
        """weight_vx, weight_vy, weight_ax, .. (weight_jy); innovation_x, innovation_y [m], nis."""
        weights = {
            f"weight_{derivative}{axis}": state.weight[:, a, d + 1]
            for d, derivative in enumerate("vaj"[: self.order])
            for a, axis in enumerate("xy")
        }
        return weights | innovation_columns(state.innovation, state.nis)


@kernel
def _predict(
    mean: FloatArray,
    covariance: FloatArray,
    weight: FloatArray,
    by_fw: bool,
    taylor: tuple[float, ...],
    Q: FloatArray,
) -> None:
    for k in range(mean.shape[0]):
        _apply(mean, covariance, weight, k, len(taylor), by_fw)
        predict_track(mean, covariance, k, taylor, Q)


@inlined
def _apply(
    mean: FloatArray, covariance: FloatArray, weight: FloatArray, k: int, m: int, by_fw: bool
) -> None:
    """x <- W x of track k and, for covariance `FW`, P <- W P W."""
    for axis in range(2):
        for d in range(1, m):
            mean[k, axis * m + d] *= weight[k, axis, d]
    if by_fw:
        for axis in range(2):
            for d in range(1, m):
                for other in range(2 * m):
                    covariance[k, axis * m + d, other] *= weight[k, axis, d]
                    covariance[k, other, axis * m + d] *= weight[k, axis, d]


@kernel
def _update(
    mean: FloatArray,
    covariance: FloatArray,
    innovation: FloatArray,
    nis: FloatArray,
    weight: FloatArray,
    window: FloatArray,
    count: IntArray,
    missed: BoolArray,
    z: FloatArray,
    R: FloatArray,
    factors: tuple[float, ...],
    denoise: int,
    reset: bool,
    joint: bool,
) -> None:
    m = len(factors)
    work = np.empty((2 * m, 2))
    for k in range(mean.shape[0]):
        if np.isnan(z[k, 0]):
            innovation[k, 0], innovation[k, 1], nis[k] = np.nan, np.nan, np.nan
            missed[k] = True
            continue
        yx, yy, square, _, h00, h01, h10, h11 = update_track(mean, covariance, k, m, z, R, k, work)
        innovation[k, 0], innovation[k, 1], nis[k] = yx, yy, square
        if reset and missed[k]:
            count[k] = 0
            for d in range(1, m):
                weight[k, 0, d] = 1.0
                weight[k, 1, d] = 1.0
        missed[k] = False
        # The denoised position (eq. clear_noise_measurement); options in the order of `Denoise`.
        x, y = z[k, 0], z[k, 1]
        if denoise == 0:
            x -= h00 * R[k, 0, 0] + h01 * R[k, 1, 1]
            y -= h10 * R[k, 0, 0] + h11 * R[k, 1, 1]
        elif denoise == 1:
            x -= h00 * yx + h01 * yy
            y -= h10 * yx + h11 * yy
        elif denoise == 2:
            x, y = mean[k, 0], mean[k, m]
        count[k] = min(count[k] + 1, window.shape[1])
        of_positions, of_steps, of_changes = remember(window, k, x, y, m)
        if count[k] == window.shape[1]:
            weigh(weight, k, 1, of_positions, factors[1], joint)
            weigh(weight, k, 2, of_steps, factors[2], joint)
            if m > 3:
                weigh(weight, k, 3, of_changes, factors[-1], joint)


@kernel
def _filter(
    mean: FloatArray,
    covariance: FloatArray,
    innovation: FloatArray,
    nis: FloatArray,
    weight: FloatArray,
    window: FloatArray,
    count: IntArray,
    missed: BoolArray,
    z: FloatArray,
    R: FloatArray,
    factors: tuple[float, ...],
    denoise: int,
    reset: bool,
    joint: bool,
    by_fw: bool,
    taylor: tuple[float, ...],
    Q: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    position_covariance: FloatArray,
) -> None:
    for t in range(z.shape[0]):
        if t > 0:
            _predict(mean, covariance, weight, by_fw, taylor, Q)
            _update(
                mean,
                covariance,
                innovation,
                nis,
                weight,
                window,
                count,
                missed,
                z[t],
                R[t % R.shape[0]],
                factors,
                denoise,
                reset,
                joint,
            )
        record(mean, covariance, position[t], velocity[t], position_covariance[t])
