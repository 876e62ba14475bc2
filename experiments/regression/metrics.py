"""Scores of one world into the numbers that a baseline pins, each with its unit and direction.

Relative changes, measured in the golden worlds with seven filters: rounding, another order of
summation and the same equations written otherwise, at most 6e-13; 1 % in the noise of positions,
4e-3 to 9e-3 in NEES, 2e-3 to 3e-3 in position_sigma, in most others 1e-5 to 3e-3. The default
tolerance, 1e-6, is far from both.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np

from experiments.scoring import Scores
from experiments.states.errors import DEGREES
from experiments.terminal import SECTIONS

Better = Literal["higher", "lower", "nearer 2", "neither"]
"""`nearer 2`: of NEES and NIS, what a filter with true covariances has. `neither`: any change is
one that only the user can judge."""

DEFAULT_TOLERANCE = "0.0001 %"
"""Of what is measured; counts must be the same."""

DIGITS = 10
"""Significant digits that a baseline holds."""


@dataclass(frozen=True)
class Metric:
    """What a number is: its unit, which way is better, and how far it may be off by default: a
    share of the baseline's value as `1 %`, or a number in its unit."""

    unit: str
    better: Better
    tolerance: str | float = DEFAULT_TOLERANCE


_HIGHER = ("hota", "deta", "assa", "mota", "motp", "idf1", "followed")
_COUNTS = ("idsw", "fp", "fn", "gaps", "followed", "tracks", "estimates")


def _metric(name: str, unit: str) -> Metric:
    better: Better = "lower"
    if name in _HIGHER:
        better = "higher"
    elif name in ("nees", "nis"):
        better = "nearer 2"
    elif name in ("gaps", "tracks", "estimates", "position_sigma"):
        better = "neither"
    return Metric(unit, better, 0.0 if name in _COUNTS else DEFAULT_TOLERANCE)


_SCORES = {name: unit for _, units in SECTIONS for name, unit in units.items()}

METRICS: Mapping[str, Metric] = MappingProxyType(
    {
        name: _metric(name, unit)
        for name, unit in {**_SCORES, "position_sigma": "m", "tracks": "", "estimates": ""}.items()
    }
)
"""By name. All of `Scores.summary`, and what tells any other change of a tracker: position_sigma,
the mean standard deviation of the position that the covariances claim; the numbers of tracks and
of their rows (estimates)."""


def measured(scores: Scores) -> dict[str, float]:
    """All metrics by name, as a baseline writes them; NaN is "no value"."""
    tracks = scores.matched.tracks
    row = scores.states.track_row
    variance = (tracks.cov_xx[row] + tracks.cov_yy[row]) / 2
    values = {
        **scores.summary(),
        "position_sigma": float(np.sqrt(variance).mean()) if len(row) else float("nan"),
        "tracks": float(len(tracks.ids())),
        "estimates": float(len(tracks)),
    }
    return {name: float(f"{values[name]:.{DIGITS}g}") for name in METRICS}


def error_by_second(scores: Scores) -> dict[str, list[float | None]]:
    """Mean position error [m] of every object in every second of the world, to four digits; None
    where no track is on it. It tells where a change is, and is not compared itself."""
    trace, states = scores.matched.trace, scores.states
    second = (trace.frame[states.truth_row] * trace.dt).astype(np.int64)
    owner = trace.object_id[states.truth_row]
    n_seconds = int(np.ceil(trace.n_frames * trace.dt))
    found: dict[str, list[float | None]] = {}
    for identifier in np.unique(owner):
        own = owner == identifier
        count = np.bincount(second[own], minlength=n_seconds)
        total = np.bincount(second[own], states.position[own], minlength=n_seconds)
        found[str(identifier)] = [
            float(f"{metres / n:.4g}") if n else None
            for metres, n in zip(total, count, strict=True)
        ]
    return found


def distance_to_best(name: str, value: float) -> float:
    """How bad a value is: a number that is smaller for a better one."""
    better = METRICS[name].better
    if better == "nearer 2":
        return abs(value - DEGREES)
    return -value if better == "higher" else value
