"""Motion regimes into the filters' errors in a gap, by Monte Carlo.

Closed-form motions (`experiments.paper.motions`), white measurement noise in the history, no
measurement in the gap, every filter on the same measurements with the true noise covariance:
perfect association, no clutter, no deletion. A cell is the mean over seeds of the mean position
error over the gap's first frames, with Student's 95 % interval; differences are paired by seed.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

import mdkf
from experiments.paper.motions import REGIMES, Regime
from experiments.statistics import mean_intervals, told
from mdkf import DETECTORS, Estimator, MotionDynamics
from mdkf.tables import FloatArray
from sim_bridge.randomness import stream

DT = 0.1
"""Time between frames [s]."""
HISTORIES = (40, 10)
"""Observed frames before the gap: a track's whole history. The short one is the long one's end,
measurements and all."""
GAPS = (10, 20)
"""Frames of the gap that are scored, from its first on."""
SEEDS = 500
NOISES = ("pointrcnn", "0.1")

VARIANTS: Mapping[str, Estimator] = {
    "md-window5": MotionDynamics(window=5),
    "md-window20": MotionDynamics(window=20),
}
"""Filters of this table that have no name elsewhere: MD with shorter and longer windows."""

FILTERS = (
    *("cv", "ca", "cj", "imm", "imm-zero", "imm3", "imm3-zero", "md", "md3"),
    *("md-joint", "md-innovation", "md-posterior", "md-raw", "md-fw", "md-window5", "md-window20"),
    *("ca-retuned", "imm-retuned", "imm-zero-retuned", "md-retuned"),
)
"""Compared unless told otherwise. `md-keep` is `md` where no measurement follows the gap."""

SUBJECT = "md"
RETUNED = "-retuned"


@dataclass(frozen=True)
class Note:
    """What the notes give for a regime: 40 frames of history, white noise of 0.1 to 0.13 m.

    ca, imm_zero, md: mean errors over the first 10 and 20 frames of the gap [m].
    difference, half: MD minus unbiased IMM over 20 frames, half of its 95 % interval [m].
    """

    ca: tuple[float, float]
    imm_zero: tuple[float, float]
    md: tuple[float, float]
    difference: float
    half: float


NOTES: Mapping[str, Note] = {
    "stationary": Note((0.18, 0.25), (0.16, 0.21), (0.12, 0.12), -0.10, 0.01),
    "stopped": Note((1.35, 3.25), (0.25, 0.43), (0.13, 0.13), -0.28, 0.02),
    "constant-velocity": Note((0.18, 0.26), (0.17, 0.22), (0.15, 0.18), -0.06, 0.01),
    "acceleration-ended": Note((0.42, 1.31), (0.32, 0.98), (0.39, 0.61), -0.90, 0.04),
    "stop-and-go": Note((1.76, 4.40), (1.01, 2.65), (1.12, 2.66), -0.52, 0.09),
    "braking": Note((1.87, 4.61), (2.03, 4.98), (1.94, 4.86), 0.62, 0.02),
    "accelerating": Note((0.76, 1.76), (1.03, 2.41), (1.04, 2.50), 1.59, 0.01),
    "turning": Note((1.19, 3.00), (1.40, 3.52), (1.39, 3.56), 1.09, 0.01),
    "crawling": Note((0.17, 0.24), (0.16, 0.20), (0.23, 0.36), 0.14, 0.01),
}
"""The project's first Monte Carlo table. It does not record its motions and noise; white
noise of 0.1 to 0.13 m fits it best."""

NOTED = {"history": 40, "gap": 20, "filter": SUBJECT, "against": "imm"}
"""The differences that the notes speak of."""


@dataclass(frozen=True)
class Noise:
    """White measurement noise: its name, and its variances along x and y [m2]."""

    name: str
    x_var: float
    y_var: float

    @classmethod
    def parse(cls, text: str) -> "Noise":
        """RobMOT's R of a detector by name, or a standard deviation of both axes [m]."""
        if text in DETECTORS:
            return cls(text, DETECTORS[text].x_var, DETECTORS[text].y_var)
        try:
            deviation = float(text)
        except ValueError:
            deviation = float("nan")
        if not (np.isfinite(deviation) and deviation > 0):
            known = ", ".join(DETECTORS)
            raise ValueError(
                f"noise {text!r}, expected a standard deviation above 0 m, or one of: {known}"
            )
        return cls(f"{deviation:g}", deviation**2, deviation**2)


@dataclass(frozen=True)
class Plan:
    """All that decides the table. seeds: how many, from 0; filters: their names."""

    seeds: int = SEEDS
    noises: tuple[Noise, ...] = tuple(map(Noise.parse, NOISES))
    filters: tuple[str, ...] = FILTERS
    regimes: tuple[Regime, ...] = REGIMES


@dataclass(frozen=True)
class Results:
    """rows: a cell for each regime, noise, history, gap and filter. differences: `md` minus each
    other filter of its start. over_time: errors in each frame of the gap. All in metres."""

    rows: pl.DataFrame
    differences: pl.DataFrame
    over_time: pl.DataFrame


def named(name: str) -> Estimator:
    """The filter of a name; `ValueError` lists the known ones."""
    if name in VARIANTS:
        return VARIANTS[name]
    try:
        return mdkf.estimator(name)
    except ValueError as error:
        raise ValueError(f"{error}; here also: {', '.join(VARIANTS)}") from None


def run(plan: Plan, progress: Callable[[float], None] = lambda done: None) -> Results:
    """The whole table; the same plan gives the same numbers to the last bit.

    progress is told how much is done, from 0 to 1.
    """
    estimators = [named(name) for name in plan.filters]
    rows: list[dict[str, Any]] = []
    differences: list[dict[str, Any]] = []
    over_time: list[dict[str, Any]] = []
    for done, regime in enumerate(plan.regimes):
        progress(done / len(plan.regimes))
        truth, white = drawn(regime, plan.seeds)
        for noise in plan.noises:
            seen = truth[:, : white.shape[1]] + white * np.sqrt([noise.x_var, noise.y_var])
            for history in HISTORIES:
                errors = np.stack(
                    [
                        gap_errors(estimator, seen[:, -history:], truth[:, -max(GAPS) :], noise)
                        for estimator in estimators
                    ],
                    axis=1,
                )
                setting = {"regime": regime.id, "noise": noise.name, "history": history}
                over_time += _curves(setting, plan.filters, errors)
                for gap in GAPS:
                    scores = errors[:, :, :gap].mean(axis=2)
                    cell = {**setting, "gap": gap, "seeds": plan.seeds}
                    rows += _cells(cell, plan.filters, scores)
                    differences += _paired(cell, plan.filters, scores)
    return Results(
        *(
            pl.DataFrame(table, schema=columns).with_columns(pl.selectors.float().fill_nan(None))
            for table, columns in (
                (rows, {**_KEY, "filter": pl.String, **_floats("error"), "notes": pl.Float64}),
                (differences, {**_KEY, **_PAIR, **_floats("difference"), **_NOTED}),
                (over_time, {**_SETTING, "filter": pl.String, "time": pl.Float64, **_floats()}),
            )
        )
    )


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


def agreement(difference: Mapping[str, Any]) -> str | None:
    """Whether a difference has the notes' sign: `agrees`, `disagrees`, or `not separable` where
    its interval holds zero; None where the notes give none, or one seed no interval."""
    if difference["notes"] is None or difference["low"] is None:
        return None
    if difference["low"] <= 0 <= difference["high"]:
        return "not separable"
    return "agrees" if (difference["difference"] < 0) == (difference["notes"] < 0) else "disagrees"


_SETTING = {"regime": pl.String, "noise": pl.String, "history": pl.Int64}
_KEY = {**_SETTING, "gap": pl.Int64, "seeds": pl.Int64}
_PAIR = {"filter": pl.String, "against": pl.String}
_NOTED = {"notes": pl.Float64, "sign": pl.String}


def _floats(value: str = "error") -> dict[str, Any]:
    return {value: pl.Float64, "low": pl.Float64, "high": pl.Float64}


def _cells(
    cell: dict[str, Any], filters: Sequence[str], scores: FloatArray
) -> list[dict[str, Any]]:
    """Rows of the scores (seeds, filters)."""
    note = NOTES.get(cell["regime"])
    known: dict[str, tuple[float, float]] = {}
    if note is not None and cell["history"] == NOTED["history"]:
        known = {"ca": note.ca, "imm-zero": note.imm_zero, "md": note.md}
    return [
        {
            **cell,
            "filter": name,
            **dict(zip(_floats(), values, strict=True)),
            "notes": known[name][GAPS.index(cell["gap"])] if name in known else None,
        }
        for name, *values in zip(filters, *mean_intervals(scores), strict=True)
    ]


def _paired(
    cell: dict[str, Any], filters: Sequence[str], scores: FloatArray
) -> list[dict[str, Any]]:
    """Rows of the differences of scores (seeds, filters): MD minus each other filter that
    starts with the same variances."""
    rows = []
    for start in ("", RETUNED):
        subject = SUBJECT + start
        others = [k for k, name in enumerate(filters) if name.endswith(RETUNED) == bool(start)]
        others = [k for k in others if filters[k] != subject]
        if subject not in filters or not others:
            continue
        own = scores[:, [filters.index(subject)]] - scores[:, others]
        for k, *values in zip(others, *mean_intervals(own), strict=True):
            row = {**cell, "filter": subject, "against": filters[k]}
            row |= dict(zip(_floats("difference"), values, strict=True))
            noted = cell["regime"] in NOTES and all(row[key] == NOTED[key] for key in NOTED)
            row["notes"] = NOTES[cell["regime"]].difference if noted else None
            row["low"], row["high"] = map(told, values[1:])
            rows.append({**row, "sign": agreement(row)})
    return rows


def _curves(
    setting: dict[str, Any], filters: Sequence[str], errors: FloatArray
) -> list[dict[str, Any]]:
    """Rows of the errors (seeds, filters, frames), by filter and frame."""
    mean, low, high = mean_intervals(errors)
    return [
        {**setting, "filter": name, "time": k * DT}
        | {"error": mean[i, k], "low": low[i, k], "high": high[i, k]}
        for i, name in enumerate(filters)
        for k in range(errors.shape[2])
    ]
