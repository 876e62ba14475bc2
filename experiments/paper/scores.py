"""Filters' scores into a table's lines: each filter's own, and MD less each of its opponents, by
column a score of the simulated traffic and, where there is one, of the recorded sequences."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import polars as pl

from experiments.estimates import RECORDED, Where
from experiments.paper.item import Better, Cells, Source
from experiments.paper.published import Scores
from experiments.studies.worlds import ORDER_2, ORDER_3, RETUNED, STUDY

RETUNED_2 = RETUNED[: len(ORDER_2)]
"""The filters of order 2 with the other start variances, in the same order."""

OPPONENTS: Mapping[str, tuple[str, ...]] = {
    family[-1]: family[:-1] for family in (ORDER_2, ORDER_3, RETUNED_2)
}
"""Filters that MD is compared with, by MD's name: of the same order and start variances."""

DETECTORS = {
    "virconv": "VirConv",
    "casa": "CasA",
    "pointrcnn": "PointRCNN",
    "pvrcnn": "PV-RCNN",
    "second": "SECOND",
    "casa-waymo": "CasA (Waymo)",
    "ctrl-waymo": "CTRL (Waymo)",
}
"""What people call the detectors, by the names of their trackers' settings."""


@dataclass(frozen=True)
class Score:
    """A column. heading: for people; metric: of the rows."""

    heading: str
    metric: str
    unit: str = "%"
    better: Better = "higher"
    decimals: int = 2


HOTA = Score("HOTA", "hota")
MOTA = Score("MOTA", "mota")
MOTP = Score("MOTP", "motp")
ASSA = Score("AssA", "assa")
ASSRE = Score("AssRe", "assre")
IDF1 = Score("IDF1", "idf1")
IDSW = Score("IDSW", "idsw", "", "lower")
MISS = Score("miss rate", "miss_rate", better="lower")
DRIFT = Score("drift", "drift", "m", "lower")


def minus(subject: str, opponent: str) -> str:
    """The line, or column, of a paired difference."""
    return f"{subject} − {opponent}"


def simulated(detector: str, occlusion: str = "none", name: str = "all") -> dict[str, str]:
    """Where simulated scores are, of a bin."""
    return {"study": STUDY, "detector": detector, "occlusion": occlusion, "bin": name}


def recorded(rows: pl.DataFrame, detector: str, occlusion: str = "none") -> dict[str, str] | None:
    """Where the scores on a detector's recorded detections are; None if there are none."""
    where = {"study": RECORDED, "detector": detector, "occlusion": occlusion, "bin": "all"}
    return None if rows.filter(**where).is_empty() else where


def add_scores(
    cells: Cells,
    table: str,
    where: Where,
    subjects: Sequence[str],
    scores: Sequence[Score],
    paper: Scores | None = None,
    source: Source = "synthetic",
) -> None:
    """Each subject's opponents' lines, its own, and its paired differences from them. A column of
    recorded scores is headed so."""
    known = {} if paper is None else paper
    for subject in subjects:
        for name in (*OPPONENTS[subject], subject):
            for score in scores:
                cells.add(
                    (table, name, _heading(score, source)),
                    {**where, "filter": name, "metric": score.metric},
                    score.unit,
                    source=source,
                    better=score.better,
                    decimals=score.decimals,
                    paper=known.get(name, {}).get(score.metric),
                )
        for name in OPPONENTS[subject]:
            for score in scores:
                add_gain(
                    cells,
                    (table, minus(subject, name), _heading(score, source)),
                    {**where, "metric": score.metric},
                    (subject, name),
                    score,
                    _difference(known, subject, name, score.metric),
                    source,
                )


def add_gain(
    cells: Cells,
    place: tuple[str, str, str],
    where: Where,
    pair: tuple[str, str],
    score: Score,
    paper: float | None = None,
    source: Source = "synthetic",
) -> None:
    """One paired difference: the first filter's score less the second's. Its sign tells the better
    one, and no difference is better than another."""
    cells.add(
        place,
        {**where, "filter": pair[0]},
        score.unit,
        source=source,
        against={"filter": pair[1]},
        decimals=score.decimals,
        paper=paper,
    )


def _heading(score: Score, source: Source) -> str:
    return f"{score.heading} rec." if source == "recorded" else score.heading


def _difference(paper: Scores, subject: str, opponent: str, metric: str) -> float | None:
    """The paper's own, to its two decimals."""
    own, other = (paper.get(name, {}).get(metric) for name in (subject, opponent))
    return None if own is None or other is None else round(own - other, 2)
