"""The paper's tables of Waymo by distance from the sensor, asked of simulated traffic."""

from collections.abc import Sequence

import polars as pl

from experiments.bins import RANGES
from experiments.jobs import Job
from experiments.paper import published
from experiments.paper.item import Answer, Cells, Item
from experiments.paper.scores import (
    ASSA,
    DETECTORS,
    HOTA,
    MISS,
    MOTA,
    OPPONENTS,
    add_gain,
    add_scores,
    minus,
    simulated,
)
from experiments.studies import worlds
from experiments.studies.scale import Scale
from experiments.studies.worlds import STUDY, Setting

GROUP = "range,level"
TWO = ("casa-waymo", "ctrl-waymo")
NEAR = tuple(name for name, _, _ in RANGES)
MODELS = {"md": "acceleration", "md3": "jerk"}

IN_KIND = (
    "The paper scores Waymo's recordings by overlap of boxes; here by bird's-eye distance, up to"
    " 60 m, in simulated traffic, with Waymo's settings of the tracker. Waymo's levels go by LiDAR"
    " points; ours by the visible fraction: level 1 at least half, level 2 all that counts."
)


def settings(detectors: Sequence[str]) -> tuple[Setting, ...]:
    """Waymo's settings of the tracker, scored by range and level."""
    return tuple(Setting(name, groups=(GROUP,)) for name in detectors)


def jobs_by_range(scale: Scale) -> Sequence[Job]:
    """One detector."""
    return worlds.jobs(scale, settings(TWO[:1]))


def jobs_by_level(scale: Scale) -> Sequence[Job]:
    """Both detectors."""
    return worlds.jobs(scale, settings(TWO))


def ranges(rows: pl.DataFrame) -> Answer:
    """HOTA, MOTA and AssA by range, with CasA."""
    cells = _cells("table-range", rows, TWO[:1])
    for near in NEAR:
        where = simulated(TWO[0], name=_bin(near, 2))
        add_scores(cells, near, where, ("md",), (HOTA, MOTA, ASSA), published.of_range(near))
    caption = "The boxes are of the simulated CasA, whose profile is of KITTI."
    return Answer(cells.frame(), dict.fromkeys(NEAR, caption))


def gains(rows: pl.DataFrame) -> Answer:
    """What MD gains in MOTA and misses, by detector, order, range and level."""
    cells = _cells("table-waymo", rows, TWO)
    captions = {}
    for detector in TWO:
        for subject, model in MODELS.items():
            table = f"{DETECTORS[detector]}, {model}"
            captions[table] = "All are paired differences, in percentage points."
            for near in NEAR:
                for name in OPPONENTS[subject]:
                    _add_gains(cells, table, detector, near, (subject, name))
    return Answer(cells.frame(), captions)


def _add_gains(cells: Cells, table: str, detector: str, near: str, pair: tuple[str, str]) -> None:
    """A line: of one range and opponent the differences at both levels."""
    subject, opponent = pair
    order = 2 + list(OPPONENTS).index(subject)
    for level in (1, 2):
        for score in (MOTA, MISS):
            paper = None
            if opponent == OPPONENTS[subject][0]:
                paper = published.waymo_gain(detector, near, order, level, score.metric)
            add_gain(
                cells,
                (table, f"{near}: {minus(*pair)}", f"{score.heading}, level {level}"),
                {**simulated(detector, name=_bin(near, level)), "metric": score.metric},
                pair,
                score,
                paper,
            )


def _bin(near: str, level: int) -> str:
    """The bin of a range and level; level 2 is all that counts."""
    return f"{near}, LEVEL_{level}"


def _cells(item: str, rows: pl.DataFrame, names: Sequence[str]) -> Cells:
    """For cells of bins of some detectors, without occlusions."""
    own = pl.col("detector").is_in(names) & (pl.col("bin") != "all")
    return Cells(item, rows.filter(own, study=STUDY, occlusion="none"))


ITEMS = (
    Item(
        "table-range",
        "Table 2: Waymo validation by distance, CasA",
        "does MD track better than IMM at every range, and by more the farther?",
        IN_KIND,
        jobs_by_range,
        ranges,
    ),
    Item(
        "table-waymo",
        "Table: what MD gains on Waymo, by distance and level, CasA and CTRL",
        "does MD gain over the baseline at every range and level, and by more the farther?",
        IN_KIND,
        jobs_by_level,
        gains,
    ),
)
