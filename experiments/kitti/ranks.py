"""Whether filters differ on simulated detections as on recorded ones, and what one sequence does.

Filters often score so alike that other sequences would rank them differently. So each is compared
with the first, on the same detections, with an interval of the difference d by the jackknife over
the n sequences: with d_k of all sequences but the k-th,

    variance = (n - 1) / n sum_k (d_k - mean d)^2,

and Student's t of n - 1 degrees of freedom. On simulated detections d is the mean over seeds, whose
own scatter is part of the sequences'.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from experiments.kitti.compare import SCORES
from experiments.kitti.run import Results
from experiments.statistics import Interval, jackknife, told
from mdkf.tables import FloatArray

AGREE, CONTRADICT, OPEN = "agree", "contradict", "not separable"
"""Both differences are other than 0 and of one sign; of opposite signs; one may well be 0."""


def against_first(
    recorded: Results, simulated: Sequence[Results], rules: str
) -> list[dict[str, Any]]:
    """One row for each filter: of each of `SCORES` its difference to the first filter's, recorded
    and simulated, with intervals, and whether they `AGREE`, `CONTRADICT` or neither (`OPEN`).

    What has no value is None, and so is everything of the first filter itself.
    """
    filters = [row["filter"] for row in recorded.rows if row["rules"] == rules]
    rows = []
    for name in filters:
        row: dict[str, Any] = {"filter": name}
        for score in SCORES:
            sides = {"recorded": [recorded], "simulated": simulated}
            found = {
                side: _difference(results, (rules, name), (rules, filters[0]), score)
                if name != filters[0]
                else None
                for side, results in sides.items()
            }
            for side, interval in found.items():
                key = f"{score}_{side}_against"
                values = (None,) * 3 if interval is None else _values_of(interval)
                row |= dict(zip((key, f"{key}_low", f"{key}_high"), values, strict=True))
            row[f"{score}_verdict"] = _verdict(found["recorded"], found["simulated"])
        rows.append(row)
    return rows


def most_influential(
    recorded: Results, simulated: Sequence[Results], rules: str
) -> list[dict[str, Any]]:
    """One row for each filter: of each of `SCORES` the sequence without which simulated less
    recorded score, the mean over seeds, is another by most, and what it is then.

    Both are None where there is no value, or one sequence alone.
    """
    filters = [row["filter"] for row in recorded.rows if row["rules"] == rules]
    rows = []
    for name in filters:
        row: dict[str, Any] = {"filter": name}
        for score in SCORES:
            real = _values(recorded, (rules, name), score)
            made = np.mean([_values(each, (rules, name), score) for each in simulated], axis=0)
            apart, known = made - real, None
            if len(apart) > 2 and np.isfinite(apart).all():
                known = int(np.argmax(np.abs(apart[1:] - apart[0])))
            names = list(recorded.left_out[rules, name])
            row[f"{score}_influential"] = None if known is None else names[known]
            row[f"{score}_difference_without"] = None if known is None else float(apart[1 + known])
        rows.append(row)
    return rows


def _difference(
    results: Sequence[Results], one: tuple[str, str], other: tuple[str, str], score: str
) -> Interval:
    """One filter's score less another's, the mean over results."""
    differences = [_values(each, one, score) - _values(each, other, score) for each in results]
    apart = np.mean(differences, axis=0)
    return jackknife(float(apart[0]), apart[1:])


def _values(results: Results, which: tuple[str, str], score: str) -> FloatArray:
    """(1 + sequences,) a score of all sequences, then without each; None is NaN."""
    rows = [row for row in results.rows if (row["rules"], row["filter"]) == which]
    parts = [row[score] for row in (*rows, *results.left_out[which].values())]
    return np.array(parts, dtype=np.float64)


def _verdict(recorded: Interval | None, simulated: Interval | None) -> str | None:
    if recorded is None or simulated is None:
        return None
    signs = [(each.low > 0.0) - float(each.high < 0.0) for each in (recorded, simulated)]
    product = signs[0] * signs[1]
    return OPEN if product == 0 else AGREE if product > 0 else CONTRADICT


def _values_of(interval: Interval) -> tuple[float | None, ...]:
    return tuple(map(told, (interval.mean, interval.low, interval.high)))
