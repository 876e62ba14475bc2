"""The paper's trade-off of accuracy and latency, its latency by number of objects, and its time per
frame for five detectors, measured on the machine at hand."""

from collections.abc import Mapping

import polars as pl

from experiments.bench import filters, recordings
from experiments.bench.targets import PAPER_LATENCY, PAPER_RATIOS
from experiments.estimates import Estimate, Where, chosen
from experiments.jobs import Job
from experiments.paper import speed_figures
from experiments.paper.item import Answer, Cells, Item, Picture
from experiments.paper.published import of_validation
from experiments.paper.speed_figures import Point
from experiments.studies import speed, worlds
from experiments.studies.scale import Scale
from experiments.studies.speed import LATENCY, NAMES, TO_CA, TO_MD
from experiments.studies.worlds import Setting
from mdkf.settings import FOLDERS

ACCURACY = Setting("virconv")
"""What the HOTA of the trade-off is of: the paper's detector, nothing removed."""
AT = 20
"""Objects of the trade-off's filters alone."""

IMMS = ("imm", "imm-zero")
"""Filters that the paper's IMM may be: it does not say how its IMM mixes."""
RATIOS = (("md", "ca", TO_CA), *((name, "md", TO_MD) for name in IMMS))
"""Costs of the first over the second, and the metric that they are."""

_TITLES: Mapping[str, str] = {
    filters.FILTERPY: "filterpy, one object per track",
    filters.NUMPY: "plain numpy, one object per track",
    filters.CALLS: "mdkf, call by call",
    filters.KERNEL: "mdkf, one compiled pass",
    speed.TRACKER: "whole tracker, compiled",
}
"""Tiers of the filters, and the tracker."""
_TRADED: Mapping[str, Where] = {
    **{
        tier: {"scenario": tier, "bin": speed.objects(AT)}
        for tier in (filters.FILTERPY, filters.NUMPY, filters.KERNEL)
    },
    speed.TRACKER: {"scenario": speed.TRAFFIC, "detector": ACCURACY.detector},
}
"""Rows of the trade-off's CPU times, by tier."""

MACHINE = (
    "Means over interleaved rounds of one thread's CPU time on the machine at hand, with memory"
    " kept from run to run: they differ from one measurement to the next; ratios are formed within"
    " rounds."
)

_WHOLE = "HOTA, and CPU time of the whole tracker"
_ALONE = f"CPU time of the filters alone, {speed.objects(AT)} in a frame"
_RATIOS = "ratios of CPU time"
"""Names of tables."""


def tradeoff(rows: pl.DataFrame) -> Answer:
    """HOTA and CPU time of each filter, alone and in the whole tracker."""
    own = rows.filter(pl.col("study").is_in([speed.STUDY, worlds.STUDY]))
    cells = Cells("fig-tradeoff", own)
    points = []
    for name in NAMES:
        gain = _add_accuracy(cells, name)
        for tier, setting in _TRADED.items():
            where = {"study": speed.STUDY, **setting, "filter": name, "metric": LATENCY}
            if _missing(own, where):
                continue
            table, paper = _ALONE, None
            if tier == speed.TRACKER:
                table, paper = _WHOLE, PAPER_LATENCY[_of_paper(name)] / PAPER_LATENCY["ca"]
            found = _add_time(cells, (table, name, tier), where, decimals=1)
            _add_ratio(cells, (table, name, f"{tier} / ca"), {**where, "metric": TO_CA}, paper)
            points.append(Point(_TITLES[tier], name, found, gain=gain))
    told = ", ".join(f"{name} {value:.0f} ms" for name, value in PAPER_LATENCY.items())
    captions = {
        _WHOLE: f"{MACHINE} A frame of simulated traffic with the VirConv detector. The paper's"
        f" latencies are of all of KITTI val ({told}); it does not say how its IMM mixes, so its"
        " numbers stand beside both.",
        _ALONE: "filterpy's IMM mixes with zeros, that in plain numpy without bias.",
    }
    data = speed_figures.tradeoff_data(points)
    picture = Picture(
        "fig-tradeoff",
        "HOTA minus that of CA (bars: 95 % interval, paired by world and seed) against the CPU time"
        f" of a frame: filters alone with {AT} objects, and the whole tracker in simulated traffic."
        f" {MACHINE}",
        lambda: speed_figures.tradeoff(data),
        data,
    )
    return Answer(cells.frame(), captions, (picture,))


def by_objects(rows: pl.DataFrame) -> Answer:
    """CPU time of a frame by number of objects, and the ratios that the paper speaks of."""
    own = rows.filter(study=speed.STUDY)
    cells = Cells("fig-objects", own)
    curves = []
    settings = [
        (tier, number, {"study": speed.STUDY, "scenario": tier, "bin": speed.objects(number)})
        for tier in _TITLES
        for number in speed.MANY
    ]
    for tier, number, where in settings:
        title = _TITLES[tier]
        for name in NAMES:
            latency = {**where, "filter": name, "metric": LATENCY}
            if _missing(own, latency):
                continue
            place = (f"CPU time of a frame: {title}", name, speed.objects(number))
            decimals = 0 if tier in (filters.FILTERPY, filters.NUMPY) else 2
            found = _add_time(cells, place, latency, decimals)
            curves.append(Point(title, name, found, objects=number))
    for tier, number, where in settings:
        for name, other, metric in RATIOS:
            ratio = {**where, "filter": name, "metric": metric}
            if not _missing(own, ratio):
                place = (_RATIOS, f"{tier}: {name} / {other}", speed.objects(number))
                _add_ratio(cells, place, ratio)
    told = ", ".join(f"{pair} {value:.2f}" for pair, value in PAPER_RATIOS.items())
    caption = f"{MACHINE} The paper's latencies on KITTI val: {told}."
    data = speed_figures.objects_data(curves)
    picture = Picture(
        "fig-objects",
        f"CPU time of a frame against the number of its objects. {MACHINE}",
        lambda: speed_figures.by_objects(data),
        data,
    )
    return Answer(cells.frame(), {_RATIOS: caption}, (picture,))


def runtime(rows: pl.DataFrame) -> Answer:
    """Time per frame of each filter, and what MD adds, by detector."""
    own = rows.filter(study=speed.STUDY)
    cells = Cells("table-runtime", own)
    for part in (speed.TRAFFIC, speed.RECORDED):
        for detector in own.filter(scenario=part)["detector"].unique(maintain_order=True):
            _add_detector(cells, part, detector)
    caption = (
        f"{MACHINE} The paper's are of RobMOT's tracker on a laptop, on KITTI's training and"
        " validation sequences."
    )
    return Answer(cells.frame(), dict.fromkeys((speed.TRAFFIC, speed.RECORDED), caption))


def _missing(rows: pl.DataFrame, where: Where) -> bool:
    """Whether there is nothing to tell: not every filter is in every tier."""
    return chosen(rows, where).is_empty()


def _of_paper(name: str) -> str:
    """The paper's filter that a filter is."""
    return "imm" if name in IMMS else name


def _add_accuracy(cells: Cells, name: str) -> Estimate:
    """Add a filter's HOTA and its gain over CA; the gain."""
    where = {
        **{"study": worlds.STUDY, "detector": ACCURACY.detector, "bin": "all"},
        **{"occlusion": ACCURACY.occlusion, "filter": name, "metric": "hota"},
    }
    known = of_validation(ACCURACY.detector)
    paper = known[name]["hota"]
    cells.add((_WHOLE, name, "HOTA"), where, "%", better="higher", paper=paper)
    return cells.add(
        (_WHOLE, name, "HOTA − ca"),
        where,
        "%",
        against={"filter": "ca"},
        paper=round(paper - known["ca"]["hota"], 2),
    )


def paper_times(detector: str) -> tuple[float | None, float | None]:
    """The paper's time of a frame with the baseline, and with motion dynamics [us]."""
    known = of_validation(detector)
    return _microseconds(known.get("ca", {})), _microseconds(known.get("md", {}))


def _microseconds(known: Mapping[str, float]) -> float | None:
    milliseconds = known.get("ms_per_frame")
    return None if milliseconds is None else round(1000 * milliseconds)


def _add_detector(cells: Cells, part: str, detector: str) -> None:
    """Add a detector's line to a part's table."""
    where = {"study": speed.STUDY, "scenario": part, "detector": detector}
    baseline, dynamic = paper_times(FOLDERS.get(detector, detector))
    added = None if baseline is None or dynamic is None else dynamic - baseline
    columns: list[tuple[str, str, str, Where | None, float | None]] = [
        ("ca", "ca", LATENCY, None, baseline),
        ("md", "md", LATENCY, None, dynamic),
        ("added by md", "md", LATENCY, {"filter": "ca"}, added),
        *((name, name, LATENCY, None, None) for name in IMMS),
        *((f"{name} / {other}", name, metric, None, None) for name, other, metric in RATIOS),
    ]
    for column, name, metric, against, paper in columns:
        timed = metric == LATENCY
        cells.add(
            (part, detector, column),
            {**where, "filter": name, "metric": metric},
            "us" if timed else "",
            source="machine",
            against=against,
            decimals=1 if timed else 2,
            paper=paper,
        )


def _add_time(cells: Cells, place: tuple[str, str, str], where: Where, decimals: int) -> Estimate:
    return cells.add(place, where, "us", source="machine", decimals=decimals, better="lower")


def _add_ratio(
    cells: Cells, place: tuple[str, str, str], where: Where, paper: float | None = None
) -> None:
    rounded = None if paper is None else round(paper, 2)
    cells.add(place, where, "", source="machine", paper=rounded)


def _jobs_of_tradeoff(scale: Scale) -> list[Job]:
    return [
        *worlds.jobs(scale, (ACCURACY,)),
        *speed.jobs(speed.FILTERS, (AT,), scale),
        *speed.jobs(speed.TRAFFIC, (ACCURACY.detector,), scale),
    ]


def _jobs_by_objects(scale: Scale) -> list[Job]:
    parts = (speed.FILTERS, speed.TRACKER)
    return [job for part in parts for job in speed.jobs(part, speed.MANY, scale)]


def _jobs_of_runtime(scale: Scale) -> list[Job]:
    return [
        *speed.jobs(speed.TRAFFIC, speed.DETECTORS, scale),
        *speed.jobs(speed.RECORDED, recordings.detectors(), scale),
    ]


ITEMS = (
    Item(
        "fig-tradeoff",
        "Figure 1; Table 1: evaluation on KITTI validation with VirConv",
        "does MD overcome the trade-off of accuracy and latency between CA and IMM?",
        "HOTA in simulated traffic with the simulated VirConv detector, not on KITTI; CPU time of"
        " filters alone (filterpy and plain numpy, where the paper's Python would be, and compiled)"
        " and of the whole compiled tracker.",
        _jobs_of_tradeoff,
        tradeoff,
    ),
    Item(
        "fig-objects",
        "Figure: latency as a function of the number of objects",
        "how does the latency of CA, IMM and MD grow with the number of objects?",
        "Closed-form objects, as many in every frame; tiers from filterpy to compiled.",
        _jobs_by_objects,
        by_objects,
    ),
    Item(
        "table-runtime",
        "Table: processing time per frame, five detectors",
        "how much time per frame does MD add to the baseline?",
        "The paper's five detectors as simulated ones in simulated traffic, and recorded KITTI"
        " detections where they are there.",
        _jobs_of_runtime,
        runtime,
    ),
)
