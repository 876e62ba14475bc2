"""An estimator in plain numpy, and the ways to break it, each with the check that must notice."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mdkf.estimator import check_step, checked_measurement, checked_start


@dataclass(frozen=True)
class AlphaBeta:
    """A sound estimator in plain numpy, broken below in one way at a time.

    Rows of a state: x, y [m], vx, vy [m/s], the position's variance [m2].
    """

    alpha: float = 0.5
    beta: float = 2.0

    def start(self, position: Any, noise: Any) -> Any:
        z = checked_start(position, noise)
        return np.hstack([z, np.zeros_like(z), noise[:, 0, :1]])

    def predict(self, state: Any, dt: float) -> Any:
        check_step(dt)
        return np.hstack([state[:, :2] + dt * state[:, 2:4], state[:, 2:4], state[:, 4:] + dt])

    def update(self, state: Any, position: Any, noise: Any) -> Any:
        z, R = checked_measurement(len(state), position, noise)
        error = np.nan_to_num(z - state[:, :2])
        variance = np.where(np.isnan(z[:, :1]), state[:, 4:], R[:, 0, :1])
        moved = state[:, :4] + np.hstack([self.alpha * error, self.beta * error])
        return np.hstack([moved, variance])

    def position(self, state: Any) -> Any:
        return state[:, :2]

    def velocity(self, state: Any) -> Any:
        return state[:, 2:4]

    def covariance(self, state: Any) -> Any:
        return state[:, 4:, None] * np.eye(2)

    def diagnostics(self, state: Any) -> Any:
        return {"variance": state[:, 4]}


@dataclass(frozen=True)
class Rows:
    """A state of one array, and what should not be in a state."""

    values: Any
    more: Any = field(default=None)


class WithoutDiagnostics(AlphaBeta):
    diagnostics = None  # type: ignore[assignment]


class StateInALists(AlphaBeta):
    def start(self, position: Any, noise: Any) -> Any:
        return super().start(position, noise).tolist()


class StateWithANumber(AlphaBeta):
    def start(self, position: Any, noise: Any) -> Any:
        return Rows(super().start(position, noise), more=0.0)


class TracksInColumns(AlphaBeta):
    def predict(self, state: Any, dt: float) -> Any:
        return super().predict(state, dt).T


class RowsThatStay(AlphaBeta):
    """Positions sorted: they do not move with the rows."""

    def position(self, state: Any) -> Any:
        return np.sort(state[:, :2], axis=0)


class ThreeVelocities(AlphaBeta):
    def velocity(self, state: Any) -> Any:
        return state[:, 2:5]


class FlatCovariance(AlphaBeta):
    def covariance(self, state: Any) -> Any:
        return super().covariance(state).reshape(-1, 4)


class SinglePrecision(AlphaBeta):
    def position(self, state: Any) -> Any:
        return super().position(state).astype(np.float32)


class NeedsATrack(AlphaBeta):
    def predict(self, state: Any, dt: float) -> Any:
        assert state[:, 4].max() > 0
        return super().predict(state, dt)


class DiagnosticsAsAList(AlphaBeta):
    def diagnostics(self, state: Any) -> Any:
        return [state[:, 4]]


class OneDiagnosticForAll(AlphaBeta):
    def diagnostics(self, state: Any) -> Any:
        return {"variance": state[:, 4].sum()}


class DiagnosticOverAColumn(AlphaBeta):
    def diagnostics(self, state: Any) -> Any:
        return {"vx": state[:, 4]}


class DiagnosticsThatComeAndGo(AlphaBeta):
    def diagnostics(self, state: Any) -> Any:
        return super().diagnostics(state) if len(state) < 3 else {}


class WritesToMeasurements(AlphaBeta):
    def update(self, state: Any, position: Any, noise: Any) -> Any:
        position -= state[:, :2]
        position += state[:, :2]
        return super().update(state, position, noise)


class PredictsInPlace(AlphaBeta):
    def predict(self, state: Any, dt: float) -> Any:
        state[:] = super().predict(state, dt)
        return state.copy()


class UpdatesInPlace(AlphaBeta):
    def update(self, state: Any, position: Any, noise: Any) -> Any:
        state[:] = super().update(state, position, noise)
        return state.copy()


class ReadsInPlace(AlphaBeta):
    def diagnostics(self, state: Any) -> Any:
        state[:, 2:4] += 0.0625
        return {}


class NanAsZero(AlphaBeta):
    def update(self, state: Any, position: Any, noise: Any) -> Any:
        return super().update(state, np.nan_to_num(position), noise)


class NanForAll(AlphaBeta):
    """One missing measurement stops the updates of all."""

    def update(self, state: Any, position: Any, noise: Any) -> Any:
        return state if np.isnan(position).any() else super().update(state, position, noise)


class SlowsInGaps(AlphaBeta):
    def update(self, state: Any, position: Any, noise: Any) -> Any:
        missed = np.isnan(position[:, :1])
        new = super().update(state, position, noise)
        return np.hstack([new[:, :2], np.where(missed, 0.9, 1.0) * new[:, 2:4], new[:, 4:]])


class Asymmetric(AlphaBeta):
    def covariance(self, state: Any) -> Any:
        return super().covariance(state) + state[:, 4:, None] * np.array([[0.0, 0.2], [0.0, 0.0]])


class Indefinite(AlphaBeta):
    def covariance(self, state: Any) -> Any:
        return super().covariance(state) + state[:, 4:, None] * np.array([[0.0, 2.0], [2.0, 0.0]])


class NegativeInLongGaps(AlphaBeta):
    def covariance(self, state: Any) -> Any:
        return np.where(state[:, 4:, None] < 2, 1.0, -1.0) * super().covariance(state)


class Underflows(AlphaBeta):
    """A likelihood that a jump sends to 0 / 0."""

    def update(self, state: Any, position: Any, noise: Any) -> Any:
        new = super().update(state, position, noise)
        likelihood = np.exp(-((np.nan_to_num(position - state[:, :2]) / 10) ** 2))
        with np.errstate(invalid="ignore"):
            new[:, :2] *= likelihood / likelihood
        return new


class InfiniteDiagnostic(AlphaBeta):
    def diagnostics(self, state: Any) -> Any:
        return {"precision": np.where(state[:, 4] > 1, np.inf, 1.0)}


class Rolls(AlphaBeta):
    def update(self, state: Any, position: Any, noise: Any) -> Any:
        jitter = 1e-12 * np.random.default_rng().random(state.shape)
        missed = np.isnan(position[:, :1])
        return super().update(state, position, noise) + np.where(missed, 0.0, jitter)


class CopiesDiffer(AlphaBeta):
    def __deepcopy__(self, memo: Any) -> Any:
        return CopiesDiffer(alpha=self.alpha + 1e-9)


class RemembersTheStep(AlphaBeta):
    """beta of one frame, whose length predict leaves on the object."""

    def predict(self, state: Any, dt: float) -> Any:
        object.__setattr__(self, "beta", 0.2 / dt if dt > 0 else dt)
        return super().predict(state, dt)


class LeaksAmongRows(AlphaBeta):
    """The cars' common motion goes into everyone's velocity."""

    def predict(self, state: Any, dt: float) -> Any:
        new = super().predict(state, dt)
        if len(new):
            new[:, 2:4] += 1e-3 * (new[:, 2:4].mean(axis=0) - new[:, 2:4])
        return new


class FirstRowIsTheEgo(AlphaBeta):
    def predict(self, state: Any, dt: float) -> Any:
        new = super().predict(state, dt)
        new[:1, 4] += dt
        return new


class StartsTooUncertain(AlphaBeta):
    def start(self, position: Any, noise: Any) -> Any:
        return super().start(position, 1000 * noise)


class ReprIsAnAddress(AlphaBeta):
    __repr__ = object.__repr__


class SurerInGaps(AlphaBeta):
    def predict(self, state: Any, dt: float) -> Any:
        new = super().predict(state, dt)
        return np.hstack([new[:, :4], state[:, 4:] * (1 - 0.01 * dt)])


class FixedStep(AlphaBeta):
    """A tenth of a second, whatever dt is."""

    def predict(self, state: Any, dt: float) -> Any:
        check_step(dt)
        return super().predict(state, 0.1)


class SurerAfterASecond(AlphaBeta):
    """Process noise that grows and falls with the step."""

    def predict(self, state: Any, dt: float) -> Any:
        new = super().predict(state, dt)
        return np.hstack([new[:, :4], state[:, 4:] + dt * np.exp(-5 * dt)])


class BoundToTheOrigin(AlphaBeta):
    """Roads near the origin are fast."""

    def predict(self, state: Any, dt: float) -> Any:
        new = super().predict(state, dt)
        far = np.abs(state[:, :2]).sum(axis=1, keepdims=True)
        return np.hstack([new[:, :4], new[:, 4:] + 1e-4 * dt * far])


class Lags(AlphaBeta):
    def update(self, state: Any, position: Any, noise: Any) -> Any:
        return AlphaBeta(alpha=0.7, beta=0.0).update(state, position, noise)


class VelocityPerFrame(AlphaBeta):
    def velocity(self, state: Any) -> Any:
        return 0.1 * super().velocity(state)


class AxesSwapped(AlphaBeta):
    def velocity(self, state: Any) -> Any:
        return super().velocity(state)[:, ::-1]


class AnyStep(AlphaBeta):
    def predict(self, state: Any, dt: float) -> Any:
        return super().predict(state, dt if dt > 0 else 0.1)


class AnyStart(AlphaBeta):
    def start(self, position: Any, noise: Any) -> Any:
        return np.hstack([position, np.zeros_like(position), noise[:, 0, :1]])


class AnyMeasurement(AlphaBeta):
    def update(self, state: Any, position: Any, noise: Any) -> Any:
        error = np.where(np.isnan(position), 0.0, position - state[:, :2])
        variance = np.where(np.isnan(position[:, :1]), state[:, 4:], noise[:, 0, :1])
        moved = state[:, :4] + np.hstack([self.alpha * error, self.beta * error])
        return np.hstack([moved, variance])


class RefusesByAnotherError(AlphaBeta):
    def predict(self, state: Any, dt: float) -> Any:
        if not dt > 0:
            raise TypeError("dt")
        return super().predict(state, dt)


class RefusesTooLate(AlphaBeta):
    """The state is spoilt before the measurement is looked at."""

    def update(self, state: Any, position: Any, noise: Any) -> Any:
        if np.shape(position) == (3, 2) and len(state) == 2:
            state += 1.0
        return super().update(state, position, noise)


BROKEN: dict[str, dict[Any, str]] = {
    "check_methods": {WithoutDiagnostics: "none named diagnostics"},
    "check_state": {
        StateInALists: "came list",
        StateWithANumber: "came more: float",
        TracksInColumns: "came array: an array of shape (5, 7)",
        RowsThatStay: "positions that move with the rows",
    },
    "check_shapes": {
        ThreeVelocities: "velocity of shape (1, 2) and float64; came an array of shape (1, 3)",
        FlatCovariance: "covariance of shape (1, 2, 2)",
        SinglePrecision: "(1, 2) and float32",
        NeedsATrack: "came ValueError: zero-size array",
        DiagnosticsAsAList: "a mapping of names to arrays; came list",
        OneDiagnosticForAll: "diagnostics 'variance' of shape (1,)",
        DiagnosticOverAColumn: "unlike the track table's columns; came 'vx'",
        DiagnosticsThatComeAndGo: "3 tracks after start; expected diagnostics named ['variance']",
    },
    "check_read_only": {WritesToMeasurements: "read-only"},
    "check_state_is_kept": {
        PredictsInPlace: "other values after predict",
        UpdatesInPlace: "other values after update",
        ReadsInPlace: "other values after diagnostics",
    },
    "check_gap": {
        NanAsZero: "position as predicted",
        NanForAll: "position of the others",
        SlowsInGaps: "velocity as predicted",
    },
    "check_numbers": {
        Asymmetric: "symmetric, positive definite",
        Indefinite: "symmetric, positive definite",
        NegativeInLongGaps: "symmetric, positive definite",
        Underflows: "finite position",
        InfiniteDiagnostic: "finite precision",
    },
    "check_determinism": {Rolls: "from the same object", CopiesDiffer: "from its copy"},
    "check_memory": {RemembersTheStep: "that the set has alone"},
    "check_rows": {LeaksAmongRows: "of tracks [0] as", FirstRowIsTheEgo: "of tracks [1] as"},
    "check_tracker": {StartsTooUncertain: "a position's variance of 4 m2 ends a track"},
    "check_repr": {ReprIsAnAddress: "a dataclass has a good repr"},
    "check_gap_uncertainty": {SurerInGaps: "to grow with every miss"},
    "check_short_step": {FixedStep: "covariance changed by less than 0.001; came a change by 0.1"},
    "check_longer_step": {SurerAfterASecond: "to grow with the step"},
    "check_translation": {BoundToTheOrigin: "the same covariance"},
    "check_follows": {
        Lags: "position within 0.1 of",
        VelocityPerFrame: "velocity within 1.0 of",
        AxesSwapped: "velocity within 1.0 of",
    },
    "check_bad_input": {
        AnyStart: "a track that starts at NaN; expected ValueError; came no error",
        AnyStep: "a step of 0 s; expected ValueError; came no error",
        AnyMeasurement: "one infinite number; expected ValueError; came no error",
        RefusesByAnotherError: "expected ValueError; came TypeError: dt",
        RefusesTooLate: "3 measurements of 2 tracks; expected the state as before",
    },
}
FAULTS = [(name, cls, told) for name, faults in BROKEN.items() for cls, told in faults.items()]
