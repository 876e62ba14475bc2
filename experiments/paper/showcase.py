"""Three scenes to play back: a standing car that something large hides as it drives past."""

from functools import partial

import polars as pl
from matplotlib.figure import Figure

import scenarios
from experiments.paper.item import Answer, Cells, Item, Picture, Source
from experiments.playback import playback, still
from experiments.studies.showcase import FILTERS, SCENARIOS, STUDY, Scene, show


def answer(rows: pl.DataFrame) -> Answer:
    """How far each filter's track is from the car, and the scenes themselves."""
    cells = Cells("playback", rows)
    pictures = []
    for scenario in SCENARIOS:
        where = {"study": STUDY, "scenario": scenario}
        closed = scenarios.load(scenario).source == "closed-form"
        source: Source = "closed form" if closed else "synthetic"
        for name in FILTERS:
            for part, heading in (("gap", "mean while hidden"), ("end", "as it comes back")):
                place = (f"{scenario}, one car", name, heading)
                which = {**where, "filter": name, "bin": part, "metric": "error"}
                cells.add(place, which, "m", source=source, better="lower")
        own = rows.filter(*(pl.col(column) == value for column, value in where.items()))
        pictures.append(
            Picture(
                f"playback-{scenario.replace('_', '-')}",
                "A standing car is hidden by a vehicle that drives past: of the first seed that has"
                " one, the car nearest to the sensor. One scene, chosen by what happens in it, not"
                " by what the filters make of it.",
                partial(_drawn, scenario),
                own,
                partial(_page, scenario),
            )
        )
    return Answer(cells.frame(), pictures=pictures)


def _drawn(scenario: str) -> Figure:
    """The playback, standing still."""
    shown = show(scenario)
    tables = shown.trace, shown.detections, shown.tracks
    return still(*tables, focus=shown.hidden.object_id, gap=shown.hidden.gap)


def _page(scenario: str) -> str:
    shown = show(scenario)
    tables, hidden = (shown.trace, shown.detections, shown.tracks), shown.hidden
    return playback(*tables, focus=hidden.object_id, gap=hidden.gap, title=shown.title())


ITEMS = (
    Item(
        "playback",
        "Figure: a stationary car behind a passing bus",
        "what does each filter believe of a standing car that is hidden?",
        "Three scenes to play back, of exactly known motion, and natural occlusion by line of sight"
        " instead of a recording.",
        lambda scale: [Scene(scenario) for scenario in SCENARIOS],
        answer,
    ),
)
