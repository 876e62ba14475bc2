"""The paper's figure of the denoised measurement: what is closest to the true position?"""

from itertools import product

import polars as pl

from experiments.bins import EVERYTHING
from experiments.estimates import RECORDED, Estimate
from experiments.jobs import Job
from experiments.paper.denoise_figure import bars, cars
from experiments.paper.item import Answer, Cells, Item, Picture, Source
from experiments.statistics import told
from experiments.studies.denoise import (
    AFTER_START,
    ESTIMATES,
    ONE_CAR,
    TRAFFIC,
    WHITE,
    Denoised,
    DenoisedJourneys,
    OneCar,
    recordings,
)
from experiments.studies.journeys import blocks
from experiments.studies.recorded import SPLIT
from experiments.studies.scale import Scale
from experiments.studies.seeds import of_traffic

DETECTORS = ("virconv", "pointrcnn", "second")
CARS = ("city_grid", "small_roundabout")
"""Scenarios of the two drawn cars, each seen in more than 300 frames as the paper's are."""
CARS_DETECTOR = "virconv"
CARS_SEED = 0

PARTS: tuple[tuple[str, str, Source], ...] = (
    (TRAFFIC, "simulated traffic", "synthetic"),
    (WHITE, "journeys with white noise", "closed form"),
    (RECORDED, "recorded", "recorded"),
)
"""Study, what it is called, and what its numbers are."""

WHICH = {EVERYTHING: "all detections", AFTER_START: AFTER_START}
"""What is shown of the bins, and what it is called."""

BASES = ("detection", "posterior")
"""What the post-processed measurement is said to be closer than."""

METRICS = (("mse", "MSE", "m2", 4), ("spread", "spread", "m", 3))
"""Metric, what it is called, unit and decimals."""

_CAPTIONS = {
    TRAFFIC: "Simulated detectors, whose errors hang together in time; every scenario alike.",
    WHITE: (
        "Closed form: one car, white noise of the very variances that the filter is told; seen in"
        " every frame."
    ),
    RECORDED: (
        f"KITTI {SPLIT}, recorded detections; the truth is what people labelled. Interval by"
        " jackknife over sequences."
    ),
}


def _jobs(scale: Scale) -> list[Job]:
    found: list[Job] = [
        DenoisedJourneys(*block, detector) for detector in DETECTORS for block in blocks(scale)
    ]
    found += [OneCar(name, CARS_SEED, CARS_DETECTOR) for name in CARS]
    found += [
        Denoised(*one, detector) for one in of_traffic(scale.worlds) for detector in DETECTORS
    ]
    return [*found, *recordings(DETECTORS)]


def answer(rows: pl.DataFrame) -> Answer:
    """MSE and spread of every estimate by detector, the MSE's differences from those of detection
    and posterior, and two cars over time."""
    cells = Cells("fig-denoise", rows)
    captions = {}
    drawn = []
    for study, part, source in PARTS:
        here = set(rows.filter(study=study, metric="mse")["detector"])
        detectors = [name for name in DETECTORS if name in here]
        for bin_, which in WHICH.items():
            common = {"study": study, "bin": bin_}
            for metric, heading, unit, decimals in METRICS:
                table = f"{heading}, {part}, {which}"
                captions[table] = _CAPTIONS[study]
                for name, detector in product(ESTIMATES, detectors):
                    found = cells.add(
                        (table, name, detector),
                        {**common, "detector": detector, "filter": name, "metric": metric},
                        unit,
                        source=source,
                        decimals=decimals,
                        better="lower",
                    )
                    if metric == "mse":
                        bar = {"part": part, "which": which, "detector": detector, "filter": name}
                        drawn.append({**bar, **_interval(found)})
            for base in BASES:
                table = f"MSE less that of the {base}, {part}, {which}"
                captions[table] = f"Paired; below zero is closer to the truth than the {base}."
                for name, detector in product(ESTIMATES, detectors):
                    if name != base:
                        cells.add(
                            (table, name, detector),
                            {**common, "detector": detector, "filter": name, "metric": "mse"},
                            "m2",
                            source=source,
                            decimals=5,
                            against={"filter": base},
                        )
    there = set(rows.filter(study=ONE_CAR)["scenario"])
    for name, estimate in product([name for name in CARS if name in there], ESTIMATES):
        where = {"study": ONE_CAR, "scenario": name, "bin": EVERYTHING, "filter": estimate}
        for metric, heading, unit, decimals in METRICS:
            place = ("two cars", estimate, f"{name}, {heading}")
            cells.add(place, {**where, "metric": metric}, unit, decimals=decimals, better="lower")
    captions["two cars"] = (
        f"Those with the most detections in seed {CARS_SEED} of two scenarios, simulated"
        f" {CARS_DETECTOR} detector: the cars of the figure."
    )
    return Answer(cells.frame(), captions, [_cars(rows), _bars(pl.DataFrame(drawn))])


def _interval(found: Estimate) -> dict[str, float | None]:
    return {name: told(getattr(found, name)) for name in ("value", "low", "high")}


def _cars(rows: pl.DataFrame) -> Picture:
    one = rows.filter(pl.col("study") == ONE_CAR)
    of_frame = one.filter(pl.col("metric") == "error").with_columns(
        frame=pl.col("bin").str.strip_prefix("frame ").cast(pl.Int64)
    )
    whole = one.filter(pl.col("bin") == EVERYTHING)
    data = pl.concat([of_frame, whole], how="diagonal")
    data = data.select("scenario", "filter", "metric", "frame", "value")
    caption = (
        f"Distance from the truth of two cars, simulated {CARS_DETECTOR} detector: those with the"
        f" most detections in seed {CARS_SEED} of the scenarios {' and '.join(CARS)}. In the legend"
        " the mean squared error and the standard deviation of the error."
    )
    return Picture("denoise-cars", caption, lambda: cars(data), data)


def _bars(data: pl.DataFrame) -> Picture:
    caption = (
        "Mean squared distance from the truth by detector, with 95 % intervals over scenarios and"
        " seeds (recorded: over sequences). Above all detections, below those after one second of"
        " detections in a row: before it, most of the error is the filter's start."
    )
    return Picture("denoise", caption, lambda: bars(data), data)


ITEMS = (
    Item(
        "fig-denoise",
        "Figure: error of detection, posterior and post-processed measurement (Methodology)",
        "which is closest to the true position: detection, posterior, or post-processed?",
        "The paper draws two cars of KITTI; here simulated traffic, white noise and, where the"
        " recordings are there, KITTI. The paper leaves D_t open: all readings are shown; the"
        " reading `raw` is the detection itself. MD of order 2.",
        _jobs,
        answer,
    ),
)
