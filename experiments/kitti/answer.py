"""What came of a detector's detections: tables for people, rows for files and programs."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import polars as pl
from rich.console import RenderableType
from rich.markup import escape

from experiments.kitti.compare import LABELLED, OFFICIAL, compared
from experiments.kitti.gaps import gap_rows
from experiments.kitti.published import Published
from experiments.kitti.ranks import against_first, most_influential
from experiments.kitti.recordings import DetectorFolder
from experiments.kitti.run import Plan, Results
from experiments.kitti.tables import (
    WIDTH,
    comparison_table,
    differences_table,
    gap_table,
    scores_table,
    scores_title,
)


@dataclass(frozen=True, eq=False)
class Answer:
    """The plan's results on one detector's recorded detections, and on simulated ones by seed."""

    plan: Plan
    detector: DetectorFolder
    recorded: Results
    simulated: Sequence[Results]
    known: Sequence[Published] = ()

    def published(self) -> list[Published]:
        """What is known of this detector, of the plan's filters and rules."""
        filters = ("", *self.plan.filters)
        rules = [each.name for each in self.plan.rules]
        return [
            entry
            for entry in self.known
            if entry.detector == self.detector.detector
            and entry.filter in filters
            and entry.rules in rules
        ]

    def rows(self) -> list[dict[str, Any]]:
        """One row for each filter, rules and source of detections, "recorded" or "simulated"."""
        real = [{"detections": "recorded", "seed": None, **row} for row in self.recorded.rows]
        made = [
            {"detections": "simulated", "seed": seed, **row}
            for seed, results in enumerate(self.simulated)
            for row in results.rows
        ]
        return [*real, *made]

    def gaps(self) -> list[dict[str, Any]]:
        """`gap_rows` of the recorded detections; none without an occlusion protocol."""
        which = {"detector": self.detector.name, "occlusion": str(self.plan.occlusion)}
        return [{**which, **row} for row in gap_rows(self.recorded.errors)]

    def comparison(self, rules: str) -> list[dict[str, Any]]:
        """`compared` rows under some rules, with their `against_first` and `most_influential`."""
        made = [row for results in self.simulated for row in results.rows]
        rows = compared(
            [row for row in self.recorded.rows if row["rules"] == rules],
            [row for row in made if row["rules"] == rules],
        )
        against = against_first(self.recorded, self.simulated, rules)
        influence = most_influential(self.recorded, self.simulated, rules)
        return [{**a, **b, **c} for a, b, c in zip(rows, against, influence, strict=True)]

    def shown(self, width: int) -> Iterator[RenderableType]:
        """Tables, those of the scores first, for a terminal of so many characters."""
        wide = width >= WIDTH
        published, occlusion = self.published(), str(self.plan.occlusion)
        name = escape(self.detector.name)
        for rules in self.plan.rules:
            title = scores_title(name, rules, occlusion)
            rows = [row for row in self.recorded.rows if row["rules"] == rules.name]
            yield scores_table(title, rows, [e for e in published if e.rules == rules.name], wide)
        if gaps := self.gaps():
            n = gaps[0]["gaps"]
            title = f"{name}, occlusion {occlusion}: errors in {n} gap{'s' * (n != 1)}"
            yield gap_table(title, gaps, wide)
        elif self.plan.occlusion.kind == "natural":
            yield f"{name}: no object is hidden by others, for {occlusion}\n"
        elif self.plan.occlusion.kind != "none":
            yield f"{name}: no object has detections enough for {occlusion}\n"
        for rules in self.plan.rules if self.simulated else ():
            rows = self.comparison(rules.name)
            title = f"{name}, rules {rules.name}: recorded against simulated"
            title = f"{title} detections, {len(self.simulated)} seeds"
            yield comparison_table(title, rows, OFFICIAL, ("idsw", "fp", "fn"), width)
            title += "; without what is tracked of labelled cars before or after their labels"
            yield comparison_table(title, rows, LABELLED, ("labelled_fp",), width)
            if len(rows) > 1:
                title = f"{self.detector.name}, rules {rules.name}: do the filters differ alike?"
                yield differences_table(title, rows, OFFICIAL, width)


def results_frame(answers: Sequence[Answer]) -> pl.DataFrame:
    """All rows, one for each detector, filter, rules, occlusion, source of detections and seed."""
    rows = [row for answer in answers for row in answer.rows()]
    return pl.DataFrame(rows, infer_schema_length=None)


def errors_frame(answers: Sequence[Answer]) -> pl.DataFrame:
    """`Results.errors` of all detectors' recorded detections: what the gaps' table is made of."""
    parts = [
        answer.recorded.errors.with_columns(detector=pl.lit(answer.detector.name))
        for answer in answers
        if not answer.recorded.errors.is_empty()
    ]
    return pl.concat(parts) if parts else pl.DataFrame()


def document(answers: Sequence[Answer]) -> dict[str, Any]:
    """All results as they go into one JSON document."""
    return {
        "rows": [row for answer in answers for row in answer.rows()],
        "gaps": [row for answer in answers for row in answer.gaps()],
        "comparisons": [
            {"detector": answer.detector.name, "rules": rules.name, **row}
            for answer in answers
            if answer.simulated
            for rules in answer.plan.rules
            for row in answer.comparison(rules.name)
        ],
        "published": [
            {
                "source": entry.source,
                "detector": answer.detector.name,
                "filter": entry.filter or None,
                "rules": entry.rules,
                **entry.values,
            }
            for answer in answers
            for entry in answer.published()
        ],
    }
