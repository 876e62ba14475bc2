"""Your own filter beside MD, on exactly the same detections: python own_filter.py [FOLDER]."""

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import experiments
import mdkf
import scenarios
import sim_bridge


@dataclass(frozen=True)
class Walks:  # the state of n tracks: arrays with a row for each
    position: np.ndarray  # (n, 2) [m]
    variance: np.ndarray  # (n,) [m2], the same along both axes


class RandomWalk:
    """An object may be anywhere near where it was: a Kalman filter without a velocity."""

    def start(self, position: np.ndarray, noise: np.ndarray) -> Walks:
        return Walks(position.copy(), noise[:, 0, 0].copy())

    def predict(self, state: Walks, dt: float) -> Walks:
        return replace(state, variance=state.variance + 5.0 * dt)  # 5 m2 more in a second

    def update(self, state: Walks, position: np.ndarray, noise: np.ndarray) -> Walks:
        gain = state.variance / (state.variance + noise[:, 0, 0])
        gain = np.where(np.isnan(position[:, 0]), 0.0, gain)  # a row of NaN: not measured
        moved = gain[:, None] * np.nan_to_num(position - state.position)
        return Walks(state.position + moved, (1 - gain) * state.variance)

    def position(self, state: Walks) -> np.ndarray:
        return state.position

    def velocity(self, state: Walks) -> np.ndarray:
        return np.zeros_like(state.position)

    def covariance(self, state: Walks) -> np.ndarray:
        return state.variance[:, None, None] * np.eye(2)

    def diagnostics(self, state: Walks) -> dict[str, np.ndarray]:
        return {}


mdkf.testing.check_estimator(RandomWalk(), strict=False)  # says what it does not keep, if anything
trace = sim_bridge.simulate(scenarios.load("stop_and_go"), seed=0)
gap = experiments.OcclusionProtocol(kind="mid", length=10)
seen = gap.apply(sim_bridge.detect(trace, detector="pointrcnn", seed=0))
tracks = {"walk": mdkf.Tracker(RandomWalk()).run(seen)}
tracks["md"] = mdkf.Tracker(mdkf.estimator("md")).run(seen)
for name, told in tracks.items():
    print(name, experiments.score(trace, told, gap))
folder = Path(sys.argv[1] if len(sys.argv) > 1 else "mdkf-out/own_filter")
folder.mkdir(parents=True, exist_ok=True)
experiments.plot(tracks, trace).savefig(folder / "errors.png")
