"""The paper's pictures of single scenes, each with the errors behind it over many seeds."""

from collections.abc import Sequence

import polars as pl

from experiments.estimates import Where
from experiments.natural import SHORTEST
from experiments.paper.item import Answer, Cells, Item, Picture, Source
from experiments.paper.scene_figures import (
    EVERY_SCENE,
    boxes_figure,
    curves,
    curves_figure,
    drawn,
    gap_figure,
    paths_figure,
)
from experiments.paper.scores import minus
from experiments.studies import scenes
from experiments.studies.natural import HORIZON, LEFT, MOVING, STEADY, WARMUP
from experiments.studies.worlds import FILTERS, ORDER_2, ORDER_3

BUS, STOP, VAN, AWAY = "passing_bus", "bus_stop", "passing_van", "off_scene"
QUEUE = "stop_and_go"
SCENES = (STOP, VAN, QUEUE, "green_wave", AWAY)
"""Where moving cars are hidden."""

FRAMES = (1, 4, 10, 20)
"""Frames of a gap that stand in a table; the paper shows up to the fourth."""
PAPER_STANDING = {("md", 4): 0.07}
"""Error by filter and frame [m]."""
PAPER_MOVING = {"md": (0.48, 0.36), "imm": (0.61, 0.45)}
"""Mean and standard deviation of the errors of one car [m]."""

ORDERS = (("order 2", "md", ORDER_2), ("order 3", "md3", ORDER_3))
ALONE, TRACKED, RETUNED = "alone", "in the tracker", "retuned start"
ERRORS = ((ALONE, "drift", ""), (TRACKED, "error", ""), (RETUNED, "drift", "-retuned"))
"""Column, score and what is added to the filter's name."""

Score = tuple[str, str, str, str]
"""Column, score, what is added to the filter's name, unit."""

_GAP = (
    f"Gap: the frames between two detections of a car that was detected {WARMUP} times before, in"
    f" most of which, and at least {SHORTEST}, less than 15 % of it is visible. The first {HORIZON}"
    " are measured. Nothing is removed."
)
_SPREAD = "sd: of the errors in all frames of a seed (the paper's ±, which it calls variance)."
_FOLLOWED = (
    "The track that follows the car as the gap begins, as long as it lives; kept: gaps in which it"
    " lived and took no other detection."
)
_STEADY = (
    f"steady: the car was detected in each of the {STEADY} frames before its gap, as many as MD's"
    " window is formed of (one fewer at order 2). Otherwise MD's weights are 1 as the gap begins;"
    " -keep keeps the window through misses."
)
_PAIRED = "Paired by seed; below zero MD is nearer to the truth."


def _where(population: str, metric: str, name: str, scenario: str | None = None) -> Where:
    """The rows of a score, of one scenario or of all."""
    where = {"study": scenes.STUDY, "bin": population, "metric": metric, "filter": name}
    return where if scenario is None else {**where, "scenario": scenario}


def _less(
    cells: Cells,
    table: str,
    population: str,
    scores: Sequence[Score],
    scenario: str | None = None,
    source: Source = "synthetic",
) -> None:
    """MD less each other filter of its order."""
    for _, subject, order in ORDERS:
        for name in order:
            for column, metric, start, unit in scores if name != subject else ():
                cells.add(
                    (table, minus(subject, name), column),
                    _where(population, metric, subject + start, scenario),
                    unit,
                    source=source,
                    against={"filter": name + start},
                    decimals=3,
                )


def _by_steadiness(
    cells: Cells,
    table: str,
    population: str,
    scenario: str | None = None,
) -> None:
    """Drift by what came before the gap, also of MD that keeps its window."""
    for name in (*FILTERS, *scenes.KEPT):
        for column in ("steady", "unsteady"):
            where = _where(f"{population}, {column}", "drift", name, scenario)
            cells.add((table, name, column), where, "m", decimals=3, better="lower")


def _stationary(rows: pl.DataFrame) -> Answer:
    """Errors of every filter, frame by frame."""
    cells, captions = Cells("fig-stationary", rows), {}
    sources: tuple[tuple[str, Source], ...] = ((BUS, "closed form"), (STOP, "synthetic"))
    for scenario, source in sources:
        for how, metric, _ in ERRORS[:2]:
            table = f"{scenario}, {how}"
            captions[table] = f"{_SPREAD} {_GAP}" if how == ALONE else _FOLLOWED
            for name in FILTERS:
                columns = [(f"frame {nth}", f"standing, frame {nth}", metric) for nth in FRAMES]
                columns += [("mean", "standing", metric), ("sd", "standing", f"{metric} sd")]
                published = PAPER_STANDING if how == ALONE else {}
                for (column, population, score), nth in zip(
                    columns, (*FRAMES, None, None), strict=True
                ):
                    cells.add(
                        (table, name, column),
                        _where(population, score, name, scenario),
                        "m",
                        source=source,
                        decimals=3,
                        better="lower",
                        paper=published.get((name, nth or 0)),
                    )
                if how == ALONE:
                    where = _where("standing", metric, f"{name}-retuned", scenario)
                    cells.add((table, name, RETUNED), where, "m", source=source, decimals=3)
                else:
                    where = _where("standing", "kept", name, scenario)
                    cells.add((table, name, "kept"), where, "%", source=source, decimals=1)
        table = f"{scenario}, MD less the others"
        captions[table] = _PAIRED
        _less(cells, table, "standing", [(*one, "m") for one in ERRORS], scenario, source)
    table = f"{STOP}, alone, by what came before"
    captions[table] = _STEADY
    _by_steadiness(cells, table, "standing", STOP)
    panels = [(scenario, metric) for scenario in (BUS, STOP) for metric in ("drift", "error")]
    data = curves(rows, panels, "standing")
    ((_, frame), published_drift), *_ = PAPER_STANDING.items()
    picture = Picture(
        "fig-stationary",
        "Error of stationary cars by frame since they were last detected. Frame n is of the cars"
        " that are hidden for n frames or more; bands: 95 % over seeds.",
        lambda: curves_figure(data, panels, (frame, published_drift)),
        data,
    )
    return Answer(cells.frame(), captions, [picture])


def _occlusion(rows: pl.DataFrame) -> Answer:
    """Errors of moving cars in their gaps."""
    cells = Cells("fig-occlusion", rows)
    table, by_scene, less = "all scenes", "alone, mean by scene", "all scenes, MD less the others"
    for name in FILTERS:
        mean, spread = PAPER_MOVING.get(name, (None, None))
        for column, metric, start, paper in (
            ("mean", "drift", "", mean),
            ("sd", "drift sd", "", spread),
            ("mean in the tracker", "error", "", None),
            ("its sd", "error sd", "", None),
            (RETUNED, "drift", "-retuned", None),
        ):
            where = _where("moving", metric, name + start)
            cells.add((table, name, column), where, "m", better="lower", paper=paper)
        cells.add((table, name, "kept"), _where("moving", "kept", name), "%", decimals=1)
        for scenario in SCENES:
            where = _where("moving", "drift", name, scenario)
            cells.add((by_scene, name, scenario), where, "m", better="lower")
    _less(cells, less, "moving", [(*one, "m") for one in ERRORS])
    before = "all scenes, alone, by what came before"
    _by_steadiness(cells, before, "moving")
    captions = {
        before: _STEADY,
        table: f"{_SPREAD} {_FOLLOWED} {_GAP} Moving: {MOVING:g} m/s or more as it begins.",
        less: _PAIRED,
    }
    panels = [(EVERY_SCENE, metric) for metric in ("drift", "error")]
    path, data = drawn(rows, STOP, "path"), curves(rows, panels, "moving")
    pictures = [
        Picture(
            "fig-occlusion",
            f"A moving car of {STOP} in its gap, and the errors of its tracks; the axes of the"
            f" path differ in scale. Of the first seed the gap that lasts the nearest to {HORIZON}"
            " frames, whatever the filters do.",
            lambda: gap_figure(path, ORDER_2),
            path,
        ),
        Picture(
            "fig-occlusion-mean",
            "Error of moving cars of all scenes by frame since they were last detected. Frame n is"
            " of those hidden for n frames or more; bands: 95 %, over scenes and seeds.",
            lambda: curves_figure(data, panels),
            data,
        ),
    ]
    return Answer(cells.frame(), captions, pictures)


def _trajectory(rows: pl.DataFrame) -> Answer:
    """Errors along hidden paths, both orders."""
    cells, captions = Cells("fig-trajectory", rows), {}
    for order, subject, names in ORDERS:
        table = f"{QUEUE}, {order}"
        captions[table] = (
            f"{_SPREAD} {subject} is nearer: share of frames, alone; half where both are as near."
        )
        for name in names:
            for column, metric in (
                ("mean", "drift"),
                ("sd", "drift sd"),
                ("mean in the tracker", "error"),
                ("its sd", "error sd"),
            ):
                where = _where("moving", metric, name, QUEUE)
                cells.add((table, name, column), where, "m", better="lower")
            where = _where("moving", "nearer", name, QUEUE)
            cells.add((table, name, f"{subject} is nearer"), where, "%", decimals=1)
    path = drawn(rows, QUEUE, "path")
    picture = Picture(
        "fig-trajectory",
        f"Paths of the tracks of a moving car of {QUEUE} in its gap: of the first seed the gap that"
        f" lasts the nearest to {HORIZON} frames. Dotted: from the state nearest to the truth of"
        " each frame to the truth. A jump: the track took another's detection. The axes differ in"
        " scale.",
        lambda: paths_figure(path, [(order, names) for order, _, names in ORDERS]),
        path,
    )
    return Answer(cells.frame(), captions, [picture])


def _offscene(rows: pl.DataFrame) -> Answer:
    """Boxes as an occlusion ends, and a second after a car has left."""
    cells, captions = Cells("fig-offscene", rows), {}
    for number, population, scenario, told in (
        (1, "parked", VAN, f"Last frame before a parked car is seen again, or the {HORIZON}th."),
        (2, "leaving", AWAY, f"{LEFT} frames after the last detection of a car."),
    ):
        table = f"scenario {number}, {scenario}"
        captions[table] = f"{told} overlap: from above, 0 without a track. {_FOLLOWED}"
        for name in FILTERS:
            for column, metric, unit, better in (
                ("overlap", "end iou", "", "higher"),
                ("distance", "end distance", "m", "lower"),
                ("alone", "end drift", "m", "lower"),
                ("kept", "kept", "%", None),
            ):
                cells.add(
                    (table, name, column),
                    _where(population, metric, name, scenario),
                    unit,
                    decimals=1 if unit == "%" else 3,
                    better=better,  # type: ignore[arg-type]
                )
        less = f"{table}, MD less the others"
        captions[less] = "Paired by seed; MD is better above zero by overlap, below by distance."
        scores = [("overlap", "end iou", "", ""), ("distance", "end distance", "", "m")]
        _less(cells, less, population, [*scores, (ALONE, "end drift", "", "m")], scenario)
    boxes = pl.concat([drawn(rows, VAN, "parked"), drawn(rows, AWAY, "leaving")])
    picture = Picture(
        "fig-offscene",
        f"Boxes from above: parked cars of {VAN} in the last frame before they are seen again, and"
        f" cars of {AWAY} {LEFT} frames after they were last detected; of the first seed. A filter"
        " whose track is gone, or farther away than the panel shows, has no box.",
        lambda: boxes_figure(boxes, [(order, names) for order, _, names in ORDERS]),
        boxes,
    )
    return Answer(cells.frame(), captions, [picture])


_WORLD = (
    "The paper shows one recorded occlusion, judged by labels; here all natural occlusions of many"
    " seeds, with exact truth and the simulated PointRCNN detector."
)

ITEMS = (
    Item(
        "fig-stationary",
        "Figure: a stationary car occluded by a bus",
        "how far does each filter drift from a stationary car that a bus hides?",
        _WORLD,
        lambda scale: scenes.jobs(scale, (BUS, STOP)),
        _stationary,
    ),
    Item(
        "fig-occlusion",
        "Figure: trajectory and error of an occluded car",
        "is MD nearer than IMM to a moving car through its occlusion?",
        _WORLD,
        lambda scale: scenes.jobs(scale, SCENES),
        _occlusion,
    ),
    Item(
        "fig-trajectory",
        "Figure: trajectories of an occluded car, both motion models",
        "with acceleration and with jerk, whose states are nearer to the hidden path?",
        _WORLD,
        lambda scale: scenes.jobs(scale, (QUEUE,)),
        _trajectory,
    ),
    Item(
        "fig-offscene",
        "Figure: cars behind a van, and cars that leave the field of view",
        "how well do the boxes fit as an occlusion ends, and a second after a car has left?",
        f"{_WORLD} Cars leave the view of the paper's sensor; here they turn off behind walls,"
        " where the truth is known all the same.",
        lambda scale: scenes.jobs(scale, (VAN, AWAY)),
        _offscene,
    ),
)
