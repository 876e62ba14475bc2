"""The Monte Carlo study of motion regimes as an item: errors, paired differences of MD from its
opponents, and whether these have the sign that the project's notes give."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import polars as pl

from experiments.bins import EVERYTHING
from experiments.estimates import Estimate
from experiments.paper import regime_figure
from experiments.paper.item import Answer, Cells, Item, Picture
from experiments.studies import regimes
from experiments.studies.regimes import BY_ID, FILTERS, GAPS, HISTORIES, NOISES, READINGS
from mdkf import MotionDynamics

ID = "regimes"
SUBJECT = "md"
OPPONENTS = ("ca", "imm", "imm-zero")
"""Filters that MD is compared with, each start with its own."""
RETUNED = "-retuned"

_HEADINGS = {
    "stationary": "stands",
    "constant-velocity": "constant velocity",
    "acceleration-ended": "accel. ended",
    "stop-and-go": "stop and go",
    "braking": "brakes",
    "accelerating": "speeds up",
    "turning": "turns",
    "crawling": "crawls",
}


@dataclass(frozen=True)
class Note:
    """What the notes give for a regime: 40 frames of history, white noise of 0.1 to 0.13 m.

    ca, imm_zero, md: mean errors over the first 10 and 20 frames of the gap [m].
    difference, half: MD minus unbiased IMM over 20 frames, half of its 95 % interval [m].
    """

    ca: tuple[float, float]
    imm_zero: tuple[float, float]
    md: tuple[float, float]
    difference: float
    half: float


NOTES: Mapping[str, Note] = {
    "stationary": Note((0.18, 0.25), (0.16, 0.21), (0.12, 0.12), -0.10, 0.01),
    "stopped": Note((1.35, 3.25), (0.25, 0.43), (0.13, 0.13), -0.28, 0.02),
    "constant-velocity": Note((0.18, 0.26), (0.17, 0.22), (0.15, 0.18), -0.06, 0.01),
    "acceleration-ended": Note((0.42, 1.31), (0.32, 0.98), (0.39, 0.61), -0.90, 0.04),
    "stop-and-go": Note((1.76, 4.40), (1.01, 2.65), (1.12, 2.66), -0.52, 0.09),
    "braking": Note((1.87, 4.61), (2.03, 4.98), (1.94, 4.86), 0.62, 0.02),
    "accelerating": Note((0.76, 1.76), (1.03, 2.41), (1.04, 2.50), 1.59, 0.01),
    "turning": Note((1.19, 3.00), (1.40, 3.52), (1.39, 3.56), 1.09, 0.01),
    "crawling": Note((0.17, 0.24), (0.16, 0.20), (0.23, 0.36), 0.14, 0.01),
}
"""The project's first Monte Carlo table. It does not record its motions and noise; white
noise of 0.1 to 0.13 m fits it best."""

NOTED = "imm"
"""The opponent of the notes' differences, which are of the longest history and gap."""


def answer(rows: pl.DataFrame) -> Answer:
    """Errors by noise, history and gap, MD's differences over the longest gap, and the figure."""
    tables: list[pl.DataFrame] = []
    captions: dict[str, str] = {}
    own = rows.filter(study=regimes.STUDY)
    for noise, history, gap in product(NOISES, HISTORIES, reversed(GAPS)):
        setting = {"detector": noise.name, "occlusion": regimes.occlusion(gap, history)}
        # Most rows are of other settings: without them each estimate is found sooner.
        cells = Cells(ID, own.filter(bin=EVERYTHING, **setting))
        where = {"study": regimes.STUDY, "metric": regimes.METRIC, "bin": EVERYTHING, **setting}
        told = f"noise {noise.name}, {history} frames of history, gap of {gap} frames"
        noted = history == max(HISTORIES)
        _add_errors(cells, f"mean error: {told}", where, noted and gap == max(GAPS))
        if noted:
            captions[f"mean error: {told}"] = _notes_of_errors(GAPS.index(gap))
        if gap == max(GAPS):
            table = f"{SUBJECT} minus ..., each retuned one from {SUBJECT}{RETUNED}: {told}"
            differences = _add_differences(cells, table, where)
            told = verdict(differences) if noted else _not_full(history)
            captions[table] = f"Below zero MD is nearer to the truth. {told}"
        tables.append(cells.frame())
    pictures = [_picture(own, noise.name) for noise in NOISES]
    return Answer(pl.concat(tables), captions, pictures)


def agreement(found: Estimate, note: Note) -> str | None:
    """Whether a difference has the notes' sign: `agrees`, `disagrees`, or `not separable` where
    its interval holds zero; None where it has no interval."""
    if not found.low <= found.high:  # NaN, with one seed
        return None
    if found.low <= 0 <= found.high:
        return "not separable"
    return "agrees" if (found.value < 0) == (note.difference < 0) else "disagrees"


def verdict(differences: Mapping[str, Estimate]) -> str:
    """In how many regimes MD minus unbiased IMM has the notes' sign, and in which it has not."""
    signs = {name: agreement(found, NOTES[name]) for name, found in differences.items()}
    agreeing = sum(sign == "agrees" for sign in signs.values())
    line = f"{SUBJECT} − {NOTED} has the sign of the project's notes in {agreeing} of {len(signs)}"
    others = [
        f"{name} (notes {NOTES[name].difference:+.2f} ±{NOTES[name].half:.2f} m:"
        f" {sign or 'too few seeds'})"
        for name, sign in signs.items()
        if sign != "agrees"
    ]
    return f"{line} regimes{'; not in ' + ', '.join(others) if others else ''}."


def _add_errors(cells: Cells, table: str, where: Mapping[str, Any], readings: bool) -> None:
    for name in (*FILTERS, *READINGS) if readings else FILTERS:
        for regime in BY_ID:
            cells.add(
                (table, name, _heading(regime)),
                {**where, "scenario": regime, "filter": name},
                "m",
                source="closed form",
                better="lower",
            )


def _add_differences(cells: Cells, table: str, where: Mapping[str, Any]) -> dict[str, Estimate]:
    """Add MD's differences from each opponent; those from the notes', by regime."""
    noted = {}
    for start, opponent in product(("", RETUNED), OPPONENTS):
        for regime in BY_ID:
            found = cells.add(
                (table, f"− {opponent}{start}", _heading(regime)),
                {**where, "scenario": regime, "filter": SUBJECT + start},
                "m",
                source="closed form",
                against={"filter": opponent + start},
            )
            if (start, opponent) == ("", NOTED):
                noted[regime] = found
    return noted


def _not_full(history: int) -> str:
    window = MotionDynamics().window
    if history > window:
        return ""
    return f"{history} frames do not fill MD's window of {window} differences: it is still CA."


def _notes_of_errors(place: int) -> str:
    """The notes' errors over a gap, in the order of the columns."""
    by_filter = {"ca": "ca", "imm-zero": "imm_zero", "md": "md"}
    told = [
        f"{name} {' '.join(f'{getattr(NOTES[regime], of)[place]:.2f}' for regime in BY_ID)}"
        for name, of in by_filter.items()
    ]
    return (
        "The project's notes, whose motions and noise (white, 0.1 to 0.13 m) are not recorded,"
        f" have, column by column: {'; '.join(told)}."
    )


def _heading(regime: str) -> str:
    return _HEADINGS.get(regime, regime)


def _picture(rows: pl.DataFrame, noise: str) -> Picture:
    data = regime_figure.data(rows, noise)
    return Picture(
        f"{ID}-{noise.replace(' ', '-')}",
        f"Mean position error in the gap, noise {noise}, {max(HISTORIES)} frames of history; bands:"
        " 95 % interval of the mean over seeds (Student); panels have scales of their own.",
        lambda: regime_figure.figure(data),
        data,
    )


def motions() -> str:
    """What each regime's motion is, in words."""
    return "; ".join(f"{name}: {regime.parameters}" for name, regime in BY_ID.items())


ITEMS = (
    Item(
        ID,
        "the claim that MD-KF consistently outperforms; Occlusion Analysis",
        "in which motion regimes does MD drift less in a gap than CA and IMM, with nothing else"
        " in play?",
        "Not in the paper: closed-form motions around a gap, white noise, association given."
        f" {motions()}. Readings of what the paper leaves open (md-...) in the longest history and"
        " gap alone. Differences are paired by seed; intervals are over seeds.",
        regimes.jobs,
        answer,
    ),
)
