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
from typing import Literal, NamedTuple, get_args

import numpy as np

from mdkf import batch
from mdkf.batch import Moments, Noise, Pair, predict_all, update_all
from mdkf.compiled import inlined
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
    start_chains,
)
from mdkf.kernels import (
    chain_moments,
    predict_track,
    start_track,
    update_track,
    write_innovation,
)
from mdkf.motion import PROCESS_NOISE, START_VARIANCE
from mdkf.motion_window import remember, weigh
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
    [m], oldest first, the last `filled` (n,) of them valid; missed (n,): whether the last frame
    had no measurement.
    """

    weight: FloatArray
    window: FloatArray
    filled: IntArray
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
        if not isinstance(self.window, int | np.integer) or self.window < 2:
            raise ValueError(f"window is {self.window!r}, expected a number of values, 2 or more")
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
            filled=np.ones(n, dtype=np.int64),
            missed=np.zeros(n, dtype=np.bool_),
        )

    def predict(self, state: MotionDynamicsState, dt: float) -> MotionDynamicsState:
        """States dt [s] later."""
        check_step(dt)
        mean, covariance = state.mean.copy(), state.covariance.copy()
        new = MotionDynamicsState(mean, covariance, *arrays(state)[2:])
        predict_all(self.batch(new, dt), len(mean))
        return new

    def update(
        self, state: MotionDynamicsState, position: FloatArray, noise: FloatArray
    ) -> MotionDynamicsState:
        """States after positions (n, 2) with covariance (n, 2, 2); NaN rows are not measured."""
        z, R = checked_measurement(len(state.mean), position, noise)
        new = copied(state)
        update_all(self.batch(new), z, R)
        return new

    def batch(self, state: MotionDynamicsState, dt: float = 1.0) -> "MotionDynamicsBatch":
        """The state's arrays for the kernels (`mdkf.batch`); updates do not depend on dt [s]."""
        first_row, Q = chain(self.order, dt, self.process_density)
        return MotionDynamicsBatch(
            **vars(state),
            taylor=first_row,
            Q=Q,
            start_variance=self.start_variance[: self.order + 1],
            factors=(1.0, *self.motion_factors),
            by_fw=self.covariance_by == "FW",
            denoise=get_args(Denoise).index(self.denoise),
            reset=self.after_gap == "reset",
            joint=self.axes == "joint",
            work=np.empty((state.mean.shape[1], 2)),
        )

    def denoised(self, state: MotionDynamicsState) -> FloatArray:
        """What stands for each track's last measured position in the window (n, 2) [m]."""
        return state.window[:, -1]

    def diagnostics(self, state: MotionDynamicsState) -> Mapping[str, FloatArray]:
        """weight_vx, weight_vy, weight_ax, .. (weight_jy); innovation_x, innovation_y [m], nis."""
        weights = {
            f"weight_{derivative}{axis}": state.weight[:, a, d + 1]
            for d, derivative in enumerate("vaj"[: self.order])
            for a, axis in enumerate("xy")
        }
        return weights | innovation_columns(state.innovation, state.nis)


class MotionDynamicsBatch(NamedTuple):
    """A `MotionDynamicsState` and its model as the kernels take them.

    factors (1, l_v, ..), the paper's vector; denoise: index in `Denoise`; work (2m, 2) is
    overwritten.
    """

    mean: FloatArray
    covariance: FloatArray
    innovation: FloatArray
    nis: FloatArray
    weight: FloatArray
    window: FloatArray
    filled: IntArray
    missed: BoolArray
    taylor: tuple[float, ...]
    Q: FloatArray
    start_variance: tuple[float, ...]
    factors: tuple[float, ...]
    by_fw: bool
    denoise: int
    reset: bool
    joint: bool
    work: FloatArray


@batch.start.register
def _start(batch: MotionDynamicsBatch, k: int, z: Pair) -> None:
    start_track(batch.mean, batch.covariance, k, z, batch.start_variance)
    batch.innovation[k, 0], batch.innovation[k, 1], batch.nis[k] = np.nan, np.nan, np.nan
    _forget(batch, k)
    length = batch.window.shape[1]
    for i in range(length - 1):
        batch.window[k, i, 0], batch.window[k, i, 1] = 0.0, 0.0
    batch.window[k, length - 1, 0], batch.window[k, length - 1, 1] = z
    batch.filled[k] = 1
    batch.missed[k] = False


@batch.predict.register
def _predict(batch: MotionDynamicsBatch, k: int) -> None:
    """x <- F W x; P <- F P F' + Q, with W P W for P by covariance `FW`."""
    mean, covariance, weight, m = batch.mean, batch.covariance, batch.weight, len(batch.taylor)
    for axis in range(2):
        for d in range(1, m):
            mean[k, axis * m + d] *= weight[k, axis, d]
    if batch.by_fw:
        for axis in range(2):
            for d in range(1, m):
                for other in range(2 * m):
                    covariance[k, axis * m + d, other] *= weight[k, axis, d]
                    covariance[k, other, axis * m + d] *= weight[k, axis, d]
    predict_track(mean, covariance, k, batch.taylor, batch.Q)


@batch.update.register
def _update(batch: MotionDynamicsBatch, k: int, z: Pair, R: Noise) -> None:
    if np.isnan(z[0]):
        batch.innovation[k, 0], batch.innovation[k, 1], batch.nis[k] = np.nan, np.nan, np.nan
        batch.missed[k] = True
        return
    m = len(batch.taylor)
    updated = update_track(batch.mean, batch.covariance, k, m, z, R, batch.work)
    yx, yy, square, _, h00, h01, h10, h11 = updated
    batch.innovation[k, 0], batch.innovation[k, 1], batch.nis[k] = yx, yy, square
    if batch.reset and batch.missed[k]:
        _forget(batch, k)
    batch.missed[k] = False
    # The denoised position (eq. clear_noise_measurement); options in the order of `Denoise`.
    x, y = z
    if batch.denoise == 0:
        x -= h00 * R[0] + h01 * R[2]
        y -= h10 * R[0] + h11 * R[2]
    elif batch.denoise == 1:
        x -= h00 * yx + h01 * yy
        y -= h10 * yx + h11 * yy
    elif batch.denoise == 2:
        x, y = batch.mean[k, 0], batch.mean[k, m]
    window, weight, factors = batch.window, batch.weight, batch.factors
    batch.filled[k] = min(batch.filled[k] + 1, window.shape[1])
    of_positions, of_steps, of_changes = remember(window, k, x, y, m)
    if batch.filled[k] == window.shape[1]:
        weigh(weight, k, 1, of_positions, factors[1], batch.joint)
        weigh(weight, k, 2, of_steps, factors[2], batch.joint)
        if m > 3:
            weigh(weight, k, 3, of_changes, factors[-1], batch.joint)


@inlined
def _forget(batch: MotionDynamicsBatch, k: int) -> None:
    """Clear the window of track k: W = I until it can be formed again."""
    batch.filled[k] = 0
    for d in range(len(batch.taylor)):
        batch.weight[k, 0, d] = 1.0
        batch.weight[k, 1, d] = 1.0


@batch.moments.register
def _moments(batch: MotionDynamicsBatch, k: int) -> Moments:
    return chain_moments(batch.mean, batch.covariance, k, len(batch.taylor))


@batch.diagnose.register
def _diagnose(
    batch: MotionDynamicsBatch, k: int, columns: FloatArray, first: int, row: int
) -> None:
    m = len(batch.taylor)
    for d in range(1, m):
        for axis in range(2):
            columns[first + 2 * (d - 1) + axis, row] = batch.weight[k, axis, d]
    write_innovation(batch.innovation, batch.nis, k, columns, first + 2 * (m - 1), row)
