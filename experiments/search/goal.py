"""What is sought: a number of each world, the larger the worse for the filter under test."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from experiments.terminal import SECTIONS

LOSS = "loss"
FAILURES = ("lost", "idsw", "nees")
"""Goals that need no opponent; the metrics they are of."""
GOALS = (LOSS, *FAILURES)

LARGER_IS_BETTER = ("hota", "deta", "assa", "mota", "motp", "idf1")
CONSISTENCY = ("nees", "nis")
"""Metrics that should be `EXPECTED`: a filter is the worse, the further off they are."""
EXPECTED = 2.0

UNITS: Mapping[str, str] = {
    "drift": "m",
    **{
        name: unit
        for _, section in SECTIONS
        for name, unit in section.items()
        if name not in ("gaps", "followed")  # they tell of the world, not of the filter
    },
}
"""Metrics that a filter can lose by, with their units."""


@dataclass(frozen=True)
class Goal:
    """How much worse the filter is than `against`, or, where that is None, how bad it is.

    metric: one of `UNITS`.
    """

    metric: str
    filter: str
    against: str | None = None

    @property
    def filters(self) -> tuple[str, ...]:
        """Those that are run, each once."""
        both = (self.filter, self.against)
        return tuple(dict.fromkeys(name for name in both if name is not None))

    @property
    def unit(self) -> str:
        """Of `value`."""
        return "" if self.metric in CONSISTENCY else UNITS[self.metric]

    @property
    def label(self) -> str:
        """`value` in a few words, with its unit."""
        told = _LABELS.get(self.metric, self.metric.replace("_", " "))
        if self.metric in LARGER_IS_BETTER and self.against is None:
            told = f"minus {told}"
        if self.against is not None:
            pair = (self.filter, self.against)
            first, second = reversed(pair) if self.metric in LARGER_IS_BETTER else pair
            told = f"{told}: {first} − {second}"
        return f"{told} [{self.unit}]" if self.unit else told

    def value(self, measured: Mapping[str, float]) -> float:
        """From the metric's value by filter; NaN ("no value") if one has none."""
        own = _badness(self.metric, measured.get(self.filter, math.nan))
        if self.against is None:
            return own
        return own - _badness(self.metric, measured.get(self.against, math.nan))


_LABELS = {
    **{name: name.upper() for name in ("hota", "mota", "motp", "idf1", "gospa")},
    **{"deta": "DetA", "assa": "AssA", "idsw": "identity switches"},
    **{name: f"|ln({name.upper()} / 2)|" for name in CONSISTENCY},
    **{"lost": "lost tracks", "fp": "false positives", "fn": "false negatives"},
    **{f"error_{phase}": f"error {phase} the gap" for phase in ("before", "after")},
    **{"error_gap": "error in the gap", "drift": "drift in the gap"},
}


def _badness(metric: str, value: float) -> float:
    """A metric's value turned so that more is worse."""
    if metric in CONSISTENCY:
        # As far off by a factor of two above as below.
        return abs(math.log(value / EXPECTED)) if value > 0 else math.nan
    return -value if metric in LARGER_IS_BETTER else value
