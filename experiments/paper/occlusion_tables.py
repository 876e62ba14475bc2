"""The paper's table of simulated occlusions, asked of simulated traffic and recorded sequences."""

from collections.abc import Sequence

import polars as pl

from experiments.jobs import Job
from experiments.paper import published
from experiments.paper.item import Answer, Cells, Item
from experiments.paper.scores import DRIFT, HOTA, IDF1, MOTA, add_scores, simulated
from experiments.paper.scores import recorded as recorded_where
from experiments.studies import recorded, worlds
from experiments.studies.scale import Scale
from experiments.studies.worlds import Setting

DETECTOR = "virconv"
RECORDED_DETECTOR = "pointrcnn"
SUBJECTS = ("md", "md3")
OCCLUSIONS = tuple(f"{kind}:{length}" for kind in ("late", "mid") for length in (10, 20))

IN_KIND = (
    "The paper scores KITTI's recordings with VirConv by overlap in the picture; here by bird's-eye"
    " distance in simulated traffic with the simulated VirConv. Of VirConv there are no recorded"
    " detections at hand: columns headed rec. are PointRCNN's on KITTI's validation split, by"
    " KITTI's rules, intervals by jackknife over sequences. Drift: the filter's own error in all"
    " gaps, association given."
)


def jobs(scale: Scale) -> Sequence[Job]:
    """Each occlusion, in simulated traffic and on the recorded sequences."""
    settings = [Setting(DETECTOR, occlusion) for occlusion in OCCLUSIONS]
    return [*worlds.jobs(scale, settings), *recorded.jobs((RECORDED_DETECTOR,), OCCLUSIONS)]


def answer(rows: pl.DataFrame) -> Answer:
    """Every filter's scores, and its drift, by kind and length of the gap."""
    own = rows.filter(pl.col("occlusion").is_in(OCCLUSIONS), bin="all")
    cells = Cells("table-occlusion", own)
    for occlusion in OCCLUSIONS:
        kind, length = occlusion.split(":")
        table = f"{kind}, {length} frames"
        where, paper = simulated(DETECTOR, occlusion), published.of_occlusion(occlusion)
        add_scores(cells, table, where, SUBJECTS, (HOTA, MOTA, IDF1, DRIFT), paper)
        real = recorded_where(rows, RECORDED_DETECTOR, occlusion)
        if real:
            columns = (HOTA, MOTA, IDF1)
            add_scores(cells, table, real, SUBJECTS, columns, source="recorded")
    return Answer(cells.frame())


ITEMS = (
    Item(
        "table-occlusion",
        "Table: simulated occlusions, KITTI, VirConv, jerk model",
        "does MD keep tracks through gaps of 10 and 20 frames better than the baseline?",
        IN_KIND,
        jobs,
        answer,
    ),
)
