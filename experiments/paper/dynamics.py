"""The paper's figure of CV, CA and CJ over a journey: which model is best in which regime?"""

from collections.abc import Sequence
from typing import Any

import polars as pl

from experiments.paper.dynamics_figure import figure
from experiments.paper.item import Answer, Cells, Item, Picture
from experiments.studies.dynamics import (
    BINS,
    DETECTOR,
    DRAWN_SEED,
    FILTERS,
    JOURNEY,
    METRICS,
    RETUNED,
    TRAFFIC,
    jobs,
)
from mdkf import DETECTORS

BASE = "cv"
"""What the others' differences are from."""

_TOLD = {"predicted": "prediction, one step ahead", "posterior": "posterior"}


def answer(rows: pl.DataFrame) -> Answer:
    """Every filter's errors by regime, their differences from CV's, and one journey."""
    cells = Cells("fig-dynamics", rows)
    captions = {}
    sources: Sequence[tuple[str, str, tuple[str, ...], Any]] = (
        (JOURNEY, "journeys", FILTERS, "closed form"),
        (TRAFFIC, "simulated traffic", (*FILTERS, *RETUNED), "synthetic"),
    )
    for study, told, filters, source in sources:
        for metric in METRICS:
            where = {"study": study, "detector": DETECTOR, "metric": metric}
            table = f"{told}: mean error of the {_TOLD[metric]}"
            captions[table] = _CAPTIONS[study]
            for name in filters:
                for column in BINS:
                    own = {**where, "filter": name, "bin": column}
                    place = (table, name, column)
                    cells.add(place, own, "m", source=source, decimals=3, better="lower")
            table = f"{table}, less that of {BASE.upper()}"
            captions[table] = "Paired by seed; below zero is better than CV."
            for name in FILTERS[1:]:
                for column in BINS:
                    own = {**where, "filter": name, "bin": column}
                    place, against = (table, name, column), {"filter": BASE}
                    cells.add(place, own, "m", source=source, decimals=4, against=against)
    return Answer(cells.frame(), captions, [_picture(rows)])


_CAPTIONS = {
    JOURNEY: (
        "Closed form, one car, white noise of the variances that RobMOT's filters are told for"
        f" {DETECTOR}; seen in every frame."
    ),
    TRAFFIC: (
        f"Simulated {DETECTOR} detector, whose errors hang together in time. Each object's own"
        " detections; regimes are the truth's, along the path: an object in a bend at constant"
        " speed has constant velocity."
    ),
}


def _picture(rows: pl.DataFrame) -> Picture:
    one = rows.filter(
        pl.col("study") == JOURNEY,
        pl.col("seed") == DRAWN_SEED,
        pl.col("bin").str.starts_with("frame "),
    )
    data = one.with_columns(frame=pl.col("bin").str.strip_prefix("frame ").cast(pl.Int64)).select(
        "filter", "metric", "frame", "value"
    )
    noise = DETECTORS[DETECTOR]
    caption = (
        f"One journey (seed {DRAWN_SEED}) in closed form, measured with white noise of"
        f" {noise.x_var**0.5:.2f} m along the road and {noise.y_var**0.5:.2f} m across. Errors are"
        " means over 1 s, as those of single frames are mostly noise; below, the truth. Shades: the"
        " true regime."
    )
    return Picture("dynamics", caption, lambda: figure(data), data)


ITEMS = (
    Item(
        "fig-dynamics",
        "Figure: CV, CA and CJ over a journey (Related Work)",
        "which motion model is best in which regime?",
        "The paper draws one car of a KITTI sequence; here one journey in closed form is drawn, and"
        " the errors by true regime are of many journeys and of simulated traffic. Beside the three"
        " models stand the filters that mix or weigh them.",
        jobs,
        answer,
    ),
)
