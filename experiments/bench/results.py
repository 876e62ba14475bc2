"""Times of all cases into rows: medians with spread, and ratios formed round by round."""

from collections.abc import Sequence
from dataclasses import dataclass

from experiments.bench.measure import Block, Case, Samples, Summary, paired, summary

RATIO = "-ratio"
"""Ends the `what` of a row that is a ratio of costs."""


@dataclass(frozen=True)
class Row:
    """One row of the results.

    what, name, tier, size: what was measured, and of how many tracks, objects or boxes.
    median, low, high: time in `unit`, median and 10th and 90th percentiles over rounds.
    ratio, ratio_low, ratio_high: how many times as fast as `ratio_to` (its time over this one);
    null without something to refer to.

    Where `what` ends in -ratio, `name` is A/B, and median and ratio are the cost of A over that
    of B, unit 1.
    """

    what: str
    name: str
    tier: str
    size: int
    median: float
    unit: str
    ratio: float | None
    ratio_to: str | None
    low: float
    high: float
    ratio_low: float | None
    ratio_high: float | None


@dataclass(frozen=True, eq=False)
class Results:
    """What was measured: blocks of cases and the times of each, (rounds,) [s]."""

    blocks: tuple[Block, ...]
    samples: Samples

    def rows(self) -> list[Row]:
        """Rows of times, then those of ratios, block by block."""
        return [row for block in self.blocks for row in (*self._times(block), *self._ratios(block))]

    def cases(self, what: str, tier: str, size: int) -> dict[str, Case]:
        """Cases by name, in their order; none if they were not measured."""
        return {
            case.name: case
            for block in self.blocks
            for case in block.cases
            if (case.what, case.tier, case.size) == (what, tier, size)
        }

    def cost_ratio(self, first: Case, second: Case) -> Summary:
        """The cost of the first over that of the second."""
        return paired(self.samples[first], self.samples[second])

    def _times(self, block: Block) -> list[Row]:
        rows = []
        for case in block.cases:
            faster = None
            if block.anchor is not None and case is not block.anchor:
                faster = self.cost_ratio(block.anchor, case)
            rows.append(
                _row(
                    (case.what, case.name, case.tier, case.size),
                    summary(self.samples[case] * case.per_second),
                    case.unit,
                    faster,
                    _described(block.anchor) if block.anchor and faster else None,
                )
            )
        return rows

    def _ratios(self, block: Block) -> list[Row]:
        rows = []
        for first, second in block.ratios:
            cost = self.cost_ratio(first, second)
            key = first.what + RATIO, f"{first.name}/{second.name}", first.tier, first.size
            rows.append(_row(key, cost, "1", cost, second.name))
        return rows


def _row(
    key: tuple[str, str, str, int],
    value: Summary,
    unit: str,
    ratio: Summary | None,
    ratio_to: str | None,
) -> Row:
    return Row(
        *key,
        median=value.median,
        unit=unit,
        ratio=ratio.median if ratio else None,
        ratio_to=ratio_to,
        low=value.low,
        high=value.high,
        ratio_low=ratio.low if ratio else None,
        ratio_high=ratio.high if ratio else None,
    )


def _described(case: Case) -> str:
    return f"{case.tier} {case.name}, {case.size}"


def select(rows: Sequence[Row], what: str) -> list[Row]:
    """The rows of a kind, in their order."""
    return [row for row in rows if row.what == what]
