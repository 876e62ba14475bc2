"""Scores on recorded against scores on simulated detections of the same recorded cars."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from experiments.statistics import mean_interval, told

POINTS = 2.0
"""Points of HOTA and MOTA within which simulation is to be of reality."""

OFFICIAL, LABELLED = ("hota", "mota"), ("labelled_hota", "labelled_mota")
"""Scores that are compared: KITTI's, and those that spare cars in frames without their label."""

SCORES = (*OFFICIAL, *LABELLED)
COUNTS = ("idsw", "fp", "fn", "labelled_fp")

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
            values = np.array([other[name] for other in made], dtype=np.float64)  # None is NaN
            apart = mean_interval(values - (np.nan if real[name] is None else real[name]))
            row[f"{name}_recorded"] = real[name]
            row[f"{name}_simulated"] = told(mean_interval(values).mean)
            row[f"{name}_difference"] = told(apart.mean)
            row[f"{name}_difference_low"] = told(apart.low)
            row[f"{name}_difference_high"] = told(apart.high)
        rows.append(row)
    for name in SCORES:
        for side in ("recorded", "simulated"):
            scores = [row[f"{name}_{side}"] for row in rows]
            for row, value in zip(rows, scores, strict=True):
                better = [other for other in scores if None not in (other, value) and other > value]
                row[f"{name}_{side}_rank"] = None if value is None else 1 + len(better)
    return rows


def verdict(rows: Rows, scores: Sequence[str] = OFFICIAL) -> str:
    """How far apart recorded and simulated scores are, in a line, and of the first filter's what
    the sequence has part in it that changes it most."""
    parts = []
    for name in scores:
        apart = [row[f"{name}_difference"] for row in rows]
        within = sum(value is not None and abs(value) <= POINTS for value in apart)
        line = f"{heading(name)} within {POINTS:g} points for {within} of {len(rows)} filters"
        if (sequence := rows[0][f"{name}_influential"]) is not None:
            line += f" ({rows[0]['filter']} {rows[0][f'{name}_difference']:+.2f}, without sequence"
            line += f" {sequence} {rows[0][f'{name}_difference_without']:+.2f})"
        parts.append(line)
    return "; ".join(parts)


def heading(name: str) -> str:
    """What people call a score."""
    return name.removeprefix("labelled_").upper()
