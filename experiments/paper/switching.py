"""The items on switches of regime: errors by true regime, how filters' signals follow the truth,
and gaps that begin around a switch. The paper does not ask; it could not, without the truth."""

from collections.abc import Iterator, Sequence
from functools import partial

import polars as pl

from experiments.paper import switching_figures
from experiments.paper.item import Answer, Cells, Item, Picture
from experiments.paper.scores import minus
from experiments.studies import switches
from experiments.studies import switching as switching_worlds
from experiments.studies.switches import SWITCHES, Switch
from experiments.studies.switching import ENDS, KINDS, PHASES, TASKS, TOLD
from experiments.studies.worlds import ORDER_2, ORDER_3
from mdkf.tables import REGIMES
from sim_bridge.regimes import CONSTANT_VELOCITY

MOTIONS = (*(name.replace("_", " ") for name in REGIMES[:-1]), "turning")
PAIRS = (
    *(("md", "imm"), ("md", "imm-zero"), ("md-posterior", "imm"), ("md-posterior", "imm-zero")),
    *(("md3", "imm3"), ("md3", "imm3-zero")),
)
"""Whose errors are compared, by seed."""
STARTS = (-20, -10, 0, 10, 20, 30)
"""First frames of the gaps that are told in numbers, counted from the switch."""


def error_answer(rows: pl.DataFrame) -> Answer:
    """Errors by true motion, in each phase, and in gaps by what happens in them."""
    own = rows.filter(study=switching_worlds.STUDY)
    cells = Cells("switching-error", own)
    for phase in PHASES:
        columns = [(motion, f"{motion}, {phase}") for motion in MOTIONS]
        _add_errors(cells, f"{phase}, by true motion", columns)
    for before in ENDS:
        columns = [(f"to {after}", f"gap from {before} to {after}") for after in ENDS]
        _add_errors(cells, f"gap that begins at {before}, by what it leads to", columns)
    return Answer(cells.frame())


def response_answer(rows: pl.DataFrame) -> Answer:
    """How well signals tell what is true, which regimes filters mistake for which, and how long
    they take to respond."""
    traffic = rows.filter(study=switching_worlds.STUDY)
    switched = rows.filter(study=switches.STUDY)
    cells = Cells("switching-response", pl.concat([traffic, switched]))
    _add_areas(cells, traffic)
    _add_confusion(cells)
    _add_delays(cells, switched)
    curves = switching_figures.course(switched)
    picture = Picture(
        "switching-response",
        "Signals around a switch: their means, and how they stand out from control tracks; bands:"
        " 95 % over batches of tracks.",
        partial(switching_figures.responses, curves),
        curves,
    )
    return Answer(cells.frame(), RESPONSE_CAPTIONS, [picture] if len(curves) else [])


def gap_answer(rows: pl.DataFrame) -> Answer:
    """Drift in gaps by when they begin."""
    own = rows.filter(study=switches.STUDY)
    cells = Cells("switching-gap", own)
    for switch in SWITCHES:
        for name in (*switches.FILTERS, *switches.RETUNED):
            for start in STARTS:
                where = {"study": switches.STUDY, "scenario": switch.id, "filter": name}
                cells.add(
                    (_gap_table(switch), name, f"{start * switches.DT:+.0f} s"),
                    {**where, "bin": f"start {start:+d}", "metric": "drift"},
                    "m",
                    source="closed form",
                    better="lower",
                )
    length = f"{switches.GAP * switches.DT:g} s"
    captions = {
        _gap_table(SWITCHES[-1]): f"Mean error over gaps of {length}, by when they begin after the"
        " switch. Retuned starts, and two readings of MD, are not drawn."
    }
    drifts = switching_figures.drifts(own)
    pictures = [
        Picture(
            f"switching-gap-order-{order}",
            f"Mean error over a gap of {length} by when it begins, filters of motion order {order};"
            " bands: 95 % over batches of tracks.",
            partial(switching_figures.gaps, drifts, names),
            drifts.filter(pl.col("filter").is_in(names)),
        )
        for order, names in ((2, (*ORDER_2, "md-posterior")), (3, ORDER_3))
    ]
    return Answer(cells.frame(), captions, pictures if len(drifts) else [])


def _add_errors(cells: Cells, table: str, columns: Sequence[tuple[str, str]]) -> None:
    """Errors of all filters in some bins, each with its heading, and MD's differences."""
    where = {"study": switching_worlds.STUDY, "metric": "error"}
    for name in switching_worlds.FILTERS:
        for heading, one in columns:
            asked = {**where, "filter": name, "bin": one}
            cells.add((table, name, heading), asked, "m", better="lower")
    for name, opponent in PAIRS:
        for heading, one in columns:
            asked = {**where, "filter": name, "bin": one}
            place = (table, minus(name, opponent), heading)
            cells.add(place, asked, "m", against={"filter": opponent})


def _add_areas(cells: Cells, traffic: pl.DataFrame) -> None:
    """Areas under the curve, of every signal and task, and by how much weights and probabilities
    do better than what any filter has."""
    columns = [
        (f"{task}{heading}", task, period)
        for period, heading in (("all", ""), ("recent", ", just begun"))
        for task in TASKS
    ]
    told = list(_signals(traffic, f" {next(iter(TASKS))}"))
    for name, signal in told:
        for column, task, period in columns:
            own = _area(name, signal, task, period)
            place = (AREA, f"{name}: {signal}", column)
            cells.add(place, own, "", decimals=3, better="higher")
    for name, signal in told:
        for column, task, period in columns if signal not in PLAIN else ():
            plain = _area("ca", PLAIN[task == "manoeuvre"], task, period)
            own = _area(name, signal, task, period)
            place = (GAIN, f"{name}: {signal}", column)
            cells.add(place, own, "", decimals=3, against=plain)


def _area(name: str, signal: str, task: str, period: str) -> dict[str, str]:
    """Where the area under a signal's curve is."""
    where = {"study": switching_worlds.STUDY, "filter": name}
    return {**where, "bin": period, "metric": f"{signal} {task}"}


def _add_confusion(cells: Cells) -> None:
    """What filters take objects for, by what is true."""
    for kind in KINDS:
        for name in switching_worlds.FILTERS:
            for told in TOLD:
                where = {"study": switching_worlds.STUDY, "filter": name, "metric": "confusion"}
                place = (_confusion_table(kind), name, told)
                cells.add(place, {**where, "bin": f"{kind} as {told}"}, "%", decimals=1)


def _add_delays(cells: Cells, switched: pl.DataFrame) -> None:
    """How often every signal responds, and how late, where at least half of the batches do."""
    responding = []
    told = list(_signals(switched, " delay"))
    for switch in SWITCHES:
        for name, signal in told:
            where = {"study": switches.STUDY, "scenario": switch.id, "filter": name}
            place = (f"{name}: {signal}", switch.id)
            own = {**where, "metric": f"{signal} responds"}
            share = cells.add((SHARE, *place), own, "%", source="closed form", decimals=0)
            if share.value >= 50.0:
                responding.append((place, {**where, "metric": f"{signal} delay"}))
    for place, own in responding:
        cells.add((DELAY, *place), own, "s", source="closed form")


def _confusion_table(kind: str) -> str:
    return f"true {kind}, taken for"


def _gap_table(switch: Switch) -> str:
    return f"{switch.title}; the gap begins at"


def _signals(rows: pl.DataFrame, ending: str) -> Iterator[tuple[str, str]]:
    """Filters and their signals, of the metrics with an ending."""
    named = rows.filter(pl.col("metric").str.ends_with(ending))
    pairs = named.select("filter", "metric").unique(maintain_order=True)
    for name, metric in pairs.iter_rows():
        yield name, metric.removesuffix(ending)


AREA = "area under the curve"
PLAIN = ("speed", "acceleration")
"""Signals of any filter: of motion, and of manoeuvres."""
GAIN = "area under the curve, less that of CA's speed, for manoeuvres of its acceleration"
DELAY = "delay from the switch to the response"
SHARE = "batches of tracks with a response"
RESPONSE_CAPTIONS = {
    AREA: "The probability that a signal is larger in a frame of the first kind than in one of the"
    " second: 0.5 is chance. Moving against standing; driving (at"
    f" {switching_worlds.CRAWL:g} m/s or more) against standing; manoeuvre (accelerating, braking"
    " or turning) against constant velocity, both driving. Just begun: both within"
    f" {switching_worlds.RECENT * switches.DT:g} s of a true change. w: the larger weight of both"
    " axes; not cv: IMM's probability of all but constant velocity; speed, acceleration: norms of"
    " the estimates.",
    _confusion_table(KINDS[-1]): "A filter takes an object to stand where MD's w_v is below 1 on"
    f" both axes, or its estimated speed below {switching_worlds.CRAWL:g} m/s (all others); else"
    " for manoeuvring where MD's w_a is 1 on an axis, IMM's constant velocity has less than half"
    f" of the probability, or the estimated acceleration is {CONSTANT_VELOCITY:g} m/s2 or more"
    " (CA, CJ).",
    SHARE: f"Batches of {switches.BATCH} tracks. A signal responds where the probability that it"
    " exceeds that of a control track, which is always in the quieter regime, steps from chance to"
    " certain, or back (least squares),"
    f" within {switches.RESPONSE.stop * switches.DT:g} s of the switch and for"
    f" {switches.HELD * switches.DT:g} s at least.",
    DELAY: "Mean over the batches with a response, where they are half of all or more.",
}

PLACE = "not in the paper: switches of regime"

ITEMS = (
    Item(
        "switching-error",
        PLACE,
        "how far is each filter off, by the true motion, in view, in gaps and after them?",
        "Simulated traffic and detector; each object's own detections, no association.",
        switching_worlds.jobs,
        error_answer,
    ),
    Item(
        "switching-response",
        PLACE,
        "do MD's weights and IMM's probabilities follow true switches, and how soon?",
        "Simulated traffic for what is told apart, closed form for delays; no association.",
        lambda scale: [*switching_worlds.jobs(scale), *switches.jobs(scale)],
        response_answer,
    ),
    Item(
        "switching-gap",
        PLACE,
        "how far do filters drift in a gap that begins before, at and after a switch?",
        "Closed-form motions, white noise of the detector's variances; no association.",
        switches.jobs,
        gap_answer,
    ),
)
