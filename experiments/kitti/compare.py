"""Scores on recorded against scores on simulated detections of the same recorded cars."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.stats import kendalltau

from experiments.statistics import mean_interval

SCORES = ("hota", "mota")
COUNTS = ("idsw", "fp", "fn")

POINTS = 2.0
"""Points of HOTA and MOTA within which simulation is to be of reality."""

Rows = Sequence[Mapping[str, Any]]


def compared(recorded: Rows, simulated: Rows) -> list[dict[str, Any]]:
    """One row for each filter: of each of `SCORES` the recorded value and the simulated mean over
    seeds, with ranks among the filters, and their difference with its interval over seeds; of
    `COUNTS` the values alone. All rows are of one detector and one set of rules."""
    rows: list[dict[str, Any]] = []
    for real in recorded:
        made = [row for row in simulated if row["filter"] == real["filter"]]
        row: dict[str, Any] = {"filter": real["filter"], "seeds": len(made)}
        for name in COUNTS:
            row[f"{name}_recorded"] = real[name]
            row[f"{name}_simulated"] = float(np.mean([other[name] for other in made]))
        for name in SCORES:
            apart = mean_interval([other[name] - real[name] for other in made])
            row[f"{name}_recorded"] = real[name]
            row[f"{name}_simulated"] = real[name] + apart.mean
            row[f"{name}_difference"] = apart.mean
            row[f"{name}_difference_low"] = None if np.isnan(apart.low) else apart.low
            row[f"{name}_difference_high"] = None if np.isnan(apart.high) else apart.high
        rows.append(row)
    for name in SCORES:
        for side in ("recorded", "simulated"):
            values = [row[f"{name}_{side}"] for row in rows]
            for row, value in zip(rows, values, strict=True):
                row[f"{name}_{side}_rank"] = 1 + sum(other > value for other in values)
    return rows


def verdict(rows: Rows) -> str:
    """How far apart recorded and simulated scores are, and how alike the filters rank, in a line.

    Kendall's tau: 1 where every pair of filters ranks alike, -1 where none does; there is none
    where all filters score alike.
    """
    told = []
    for name in SCORES:
        apart = [row[f"{name}_difference"] for row in rows]
        within = sum(abs(value) <= POINTS for value in apart)
        line = f"{name.upper()} within {POINTS:g} points for {within} of {len(rows)} filters"
        if len(rows) > 1:
            sides = ([row[f"{name}_{side}"] for row in rows] for side in ("recorded", "simulated"))
            tau = kendalltau(*sides).statistic
            line += ", no ranks" if np.isnan(tau) else f", ranks alike with tau {tau:+.2f}"
        told.append(line)
    return "; ".join(told)
