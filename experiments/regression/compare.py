"""A baseline and what is measured now into verdicts, and these into a table of plain text."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from experiments.regression.baseline import Pin, Seconds
from experiments.regression.metrics import METRICS, distance_to_best

Verdict = Literal["same", "better", "worse", "changed"]
"""`changed`: of a metric that knows no better, or that has a value where it had none, or none
where it had one."""

NEGLIGIBLE = 1e-9
"""A change that is never one, in any unit: a nanometre, a billionth of a percent."""

WORST = 5
"""Objects and seconds that a report names at most."""

SHOWN_GROWTH = 1e-3
"""Relative growth of an error below which the four digits of a baseline do not show it."""


@dataclass(frozen=True)
class Row:
    """One metric, then and now."""

    metric: str
    pin: Pin
    now: float

    @property
    def change(self) -> float:
        """In the metric's unit; NaN where there is no value."""
        return self.now - self.pin.value

    @property
    def verdict(self) -> Verdict:
        """What the change is."""
        then, now = self.pin.value, self.now
        if math.isnan(then) and math.isnan(now):
            return "same"
        if math.isnan(then) or math.isnan(now):
            return "changed"
        if abs(now - then) <= max(self.pin.allowed(), NEGLIGIBLE):
            return "same"
        if METRICS[self.metric].better == "neither":
            return "changed"
        was, is_now = distance_to_best(self.metric, then), distance_to_best(self.metric, now)
        return "worse" if is_now > was else "better"


def table(rows: Sequence[Row]) -> list[str]:
    """Lines that say what became of each metric."""
    head = ("metric", "unit", "baseline", "now", "change", "allowed", "verdict")
    cells = [
        (
            row.metric,
            METRICS[row.metric].unit,
            _number(row.pin.value, 7),
            _number(row.now, 7),
            _change(row),
            _number(row.pin.allowed(), 2),
            row.verdict,
        )
        for row in rows
    ]
    return aligned([head, *cells], left=(0, 1, 6))


def changes(rows: Sequence[Row]) -> list[str]:
    """Lines of old and new values, for a notice."""
    cells = [
        (
            row.metric,
            _number(row.pin.value, 7),
            "->",
            _number(row.now, 7),
            METRICS[row.metric].unit,
            row.verdict,
        )
        for row in rows
    ]
    return [f"  {line}" for line in aligned(cells, left=(0, 4, 5))] if cells else []


def worst(then: Seconds, now: Seconds) -> list[str]:
    """Lines that say where the position error grew most; none where it did not grow."""
    grown = []
    for identifier, errors in now.items():
        for second, (before, after) in enumerate(
            zip(then.get(identifier, []), errors, strict=False)
        ):
            if before is not None and after is not None and after > before * (1 + SHOWN_GROWTH):
                grown.append((after - before, identifier, second, before, after))
    if not grown:
        return []
    head = ("object", "seconds", "baseline [m]", "now [m]", "growth [m]")
    cells = [
        (identifier, f"{second}-{second + 1}", f"{before:.4g}", f"{after:.4g}", f"+{more:.2g}")
        for more, identifier, second, before, after in sorted(grown, reverse=True)[:WORST]
    ]
    return ["where the mean position error grew most:", *aligned([head, *cells])]


def aligned(rows: Sequence[Sequence[str]], left: Sequence[int] = ()) -> list[str]:
    """Rows of cells as lines: numbers to the right, the columns of `left` to the left."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.ljust(width) if k in left else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def _number(value: float, digits: int) -> str:
    return "–" if math.isnan(value) else f"{value:.{digits}g}"


def _change(row: Row) -> str:
    if math.isnan(row.change):
        return "–"
    share = f" ({100 * row.change / abs(row.pin.value):+.3g} %)" if row.pin.value else ""
    return f"{row.change:+.2g}{share}"
