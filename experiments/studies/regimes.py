"""Motion regimes into the filters' errors in a gap, by Monte Carlo.

Closed-form motions (`experiments.studies.motions`), white measurement noise in the history, no
measurement in the gap, every filter on the same measurements with the true noise covariance:
perfect association, no clutter, no deletion. A value is the mean position error of one seed over
the gap's first frames.
"""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import polars as pl

import mdkf
from experiments.bins import EVERYTHING
from experiments.jobs import Job, as_rows
from experiments.studies.motions import REGIMES, Regime
from experiments.studies.scale import Scale
from mdkf import DETECTORS, Estimator, MotionDynamics
from mdkf.tables import FloatArray
from sim_bridge.randomness import stream

STUDY = "regimes"
METRIC = "error"
"""Of the rows [m]."""

DT = 0.1
"""Time between frames [s]."""
HISTORIES = (40, 10)
"""Observed frames before the gap: a track's whole history. The short one is the long one's end,
measurements and all."""
GAPS = (10, 20)
"""Frames of the gap that are scored, from its first on."""

VARIANTS: Mapping[str, Estimator] = {
    "md-window5": MotionDynamics(window=5),
    "md-window20": MotionDynamics(window=20),
}
"""Filters of this study that have no name elsewhere: MD with shorter and longer windows."""

FILTERS = (
    *("cv", "ca", "cj", "imm", "imm-zero", "imm3", "imm3-zero", "md", "md3"),
    *("ca-retuned", "imm-retuned", "imm-zero-retuned", "md-retuned"),
)
READINGS = (
    *("md-joint", "md-innovation", "md-posterior", "md-raw", "md-fw", "md-window5", "md-window20"),
)
"""Of what the paper leaves open, in the longest history and gap alone. `md-keep` is `md` where no
measurement follows the gap."""
DRAWN = ("ca", "imm", "imm-zero", "md")
"""Filters whose errors in each frame are kept too, there alone."""


@dataclass(frozen=True)
class Noise:
    """White measurement noise: its name, and its variances along x and y [m2]."""

    name: str
    x_var: float
    y_var: float

    @classmethod
    def of_detector(cls, name: str) -> "Noise":
        """RobMOT's R of a detector."""
        return cls(name, DETECTORS[name].x_var, DETECTORS[name].y_var)

    @classmethod
    def of_deviation(cls, deviation: float) -> "Noise":
        """The same standard deviation along both axes [m]."""
        return cls(f"{deviation:g} m", deviation**2, deviation**2)


NOISES = (Noise.of_detector("pointrcnn"), Noise.of_deviation(0.1))


@dataclass(frozen=True)
class MonteCarlo(Job):
    """A regime, by id, with `seeds` seeds from 0 on: all noises, histories, gaps and filters."""

    regime: str
    seeds: int

    @property
    def group(self) -> str:
        """Regimes share nothing."""
        return f"regime {self.regime}"

    def key(self) -> Mapping[str, Any]:
        """All that decides the rows."""
        return {
            "study": STUDY,
            "regime": asdict(BY_ID[self.regime]),
            "seeds": self.seeds,
            "noises": [asdict(noise) for noise in NOISES],
        }

    def rows(self) -> pl.DataFrame:
        """`error` [m] by seed, noise (detector), occlusion as `occlusion` names it, and filter; of
        those drawn also by frame of the gap, counted from 1 (bin `frame 1`)."""
        truth, white = drawn(BY_ID[self.regime], self.seeds)
        measured = [
            {"detector": noise.name, **row}
            for noise in NOISES
            for row in _rows(truth, white, noise)
        ]
        return as_rows(measured, study=STUDY, scenario=self.regime, metric=METRIC)


BY_ID: Mapping[str, Regime] = {regime.id: regime for regime in REGIMES}


def jobs(scale: Scale) -> list[MonteCarlo]:
    """Every regime."""
    return [MonteCarlo(name, scale.monte_carlo) for name in BY_ID]


def occlusion(gap: int, history: int) -> str:
    """The name of a gap in the rows."""
    return f"gap {gap} after {history}"


def in_frame(number: int) -> str:
    """The bin of one frame of the gap, counted from 1."""
    return f"frame {number}"


def named(name: str) -> Estimator:
    """The filter of a name of this study, with variants that have no name elsewhere."""
    return VARIANTS[name] if name in VARIANTS else mdkf.estimator(name)


def drawn(regime: Regime, seeds: int) -> tuple[FloatArray, FloatArray]:
    """True positions (seeds, history + gap, 2) [m] and white noise of unit variance (seeds,
    history, 2), of each seed's own stream, for the longest history and gap.

    Noise levels scale the same draws: they differ by the level alone.
    """
    time = DT * np.arange(-max(HISTORIES), max(GAPS))
    shift = np.empty(seeds)
    white = np.empty((seeds, max(HISTORIES), 2))
    for seed in range(seeds):
        random = stream("paper-regimes", regime.id, seed)
        shift[seed] = regime.period * random.random()
        white[seed] = random.standard_normal(white.shape[1:])
    return regime.motion.at(time + shift[:, None]).position, white


def gap_errors(
    estimator: Estimator, seen: FloatArray, truth: FloatArray, noise: Noise
) -> FloatArray:
    """Position errors (n, gap) [m] of n tracks in a gap with true positions truth (n, gap, 2).

    The first of the measured positions seen (n, history, 2) starts a track, the rest update it.
    """
    n = len(seen)
    R = np.tile(np.diag([noise.x_var, noise.y_var]), (n, 1, 1))
    nothing = np.full((n, 2), np.nan)
    state = estimator.start(np.ascontiguousarray(seen[:, 0]), R)
    for k in range(1, seen.shape[1]):
        measured = np.ascontiguousarray(seen[:, k])
        state = estimator.update(estimator.predict(state, DT), measured, R)
    errors = np.empty(truth.shape[:2])
    for k in range(truth.shape[1]):
        state = estimator.update(estimator.predict(state, DT), nothing, R)
        errors[:, k] = np.hypot(*(estimator.position(state) - truth[:, k]).T)
    return errors


def _rows(truth: FloatArray, white: FloatArray, noise: Noise) -> Iterator[dict[str, Any]]:
    """occlusion, filter, seed, bin, value and frames behind it."""
    seen = truth[:, : white.shape[1]] + white * np.sqrt([noise.x_var, noise.y_var])
    for history in HISTORIES:
        longest = history == max(HISTORIES)
        for name in (*FILTERS, *READINGS) if longest else FILTERS:
            errors = gap_errors(named(name), seen[:, -history:], truth[:, -max(GAPS) :], noise)
            for gap in (max(GAPS),) if name in READINGS else GAPS:
                own: dict[str, Any] = {"occlusion": occlusion(gap, history), "filter": name}
                yield from _by_seed({**own, "bin": EVERYTHING, "n": gap}, errors[:, :gap])
            if longest and name in DRAWN:
                own = {"occlusion": occlusion(max(GAPS), history), "filter": name, "n": 1}
                for k in range(max(GAPS)):
                    yield from _by_seed({**own, "bin": in_frame(k + 1)}, errors[:, k : k + 1])


def _by_seed(own: Mapping[str, Any], errors: FloatArray) -> Iterator[dict[str, Any]]:
    """A row for each seed, of its mean error over the frames of errors (seeds, frames)."""
    for seed, value in enumerate(errors.mean(axis=1).tolist()):
        yield {**own, "seed": seed, "value": value}
