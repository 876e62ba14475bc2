"""The paper's table of simulated occlusions, asked of simulated traffic."""

import polars as pl

from experiments.paper import worlds
from experiments.paper.item import Answer, Cells, Item
from experiments.paper.worlds import Setting

DETECTOR = "virconv"
LENGTHS = (10, 20)
PAPER = {
    ("late", 10): {"cj": (81.01, 83.85, 91.04), "md3": (81.68, 84.72, 91.48)},
    ("late", 20): {"cj": (75.60, 76.56, 87.13), "md3": (76.84, 78.05, 87.92)},
    ("mid", 10): {"cj": (76.44, 78.20, 86.62), "md3": (77.32, 79.07, 86.97)},
    ("mid", 20): {"cj": (65.83, 67.38, 74.74), "md3": (67.05, 68.93, 76.21)},
}
"""HOTA, MOTA and IDF1 [%] by kind and length; the paper's table is of the jerk model."""

SCORES = (("HOTA", "hota"), ("MOTA", "mota"), ("IDF1", "idf1"))


def settings() -> tuple[Setting, ...]:
    """What the table is of."""
    return tuple(
        Setting(DETECTOR, f"{kind}:{length}") for kind in ("late", "mid") for length in LENGTHS
    )


def answer(rows: pl.DataFrame) -> Answer:
    """Every filter's scores, and its drift, by kind and length of the gap."""
    cells = Cells("table-occlusion", rows)
    for (kind, length), published in PAPER.items():
        table = f"{kind}, {length} frames"
        for name in worlds.FILTERS:
            where = {
                **{"study": worlds.STUDY, "detector": DETECTOR, "bin": "all"},
                **{"occlusion": f"{kind}:{length}", "filter": name},
            }
            for place, (heading, metric) in enumerate(SCORES):
                cells.add(
                    (table, name, heading),
                    {**where, "metric": metric},
                    "%",
                    better="higher",
                    paper=published[name][place] if name in published else None,
                )
            cells.add((table, name, "drift"), {**where, "metric": "drift"}, "m", better="lower")
    return Answer(cells.frame())


ITEMS = (
    Item(
        "table-occlusion",
        "Table: simulated occlusions, KITTI, VirConv, jerk model",
        "does MD keep tracks through gaps of 10 and 20 frames better than the baseline?",
        "The paper scores by overlap in the picture on KITTI; here by bird's-eye distance in"
        " simulated traffic, with the simulated VirConv detector.",
        lambda scale: worlds.jobs(scale, settings()),
        answer,
    ),
)
