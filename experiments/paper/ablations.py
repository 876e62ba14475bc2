"""MD's free choices, one at a time, in simulated traffic with gaps: which of them matter?"""

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.figures import colours
from experiments.paper.item import Answer, Better, Cells, Item, Picture
from experiments.studies.ablations import DETECTOR, OCCLUSION, STUDY, jobs
from experiments.studies.variants import DELETION, SUBJECT, Variant, variants

COLUMNS: tuple[tuple[str, str, str, str, Better], ...] = (
    # heading, metric, bin, unit, better
    ("drift", "drift", "all", "m", "lower"),
    ("drift standing", "drift", "regime stationary", "m", "lower"),
    ("HOTA", "hota", "all", "%", "higher"),
    ("lost", "lost", "all", "%", "lower"),
)
"""What the tables show of each variant: the value, and its paired difference from the default."""

CHANGE = "Δ "
DRAWN = COLUMNS[:3]
"""Whose changes the figure shows, a row of panels each."""
PANELS = 5
"""Choices beside each other in the figure."""


def answer(rows: pl.DataFrame) -> Answer:
    """A table for each choice: its values by score, and how they differ from the default's."""
    cells = Cells("ablations", rows)
    every = variants()
    for one in every:
        for heading, metric, part, unit, better in COLUMNS:
            if one.choice == DELETION and metric == "drift":
                continue  # a filter alone knows no such bound
            where = {"study": STUDY, "filter": one.name, "metric": metric, "bin": part}
            place = (one.choice, _line(one))
            cells.add((*place, heading), where, unit, better=better)
            if one.name != one.filter:
                usual = {"filter": one.filter}
                cells.add((*place, CHANGE + heading), where, unit, against=usual, decimals=3)
    frame = cells.frame()
    drawn = frame.filter(pl.col("column").is_in([CHANGE + heading for heading, *_ in DRAWN]))
    picture = Picture(
        "ablations",
        "Small multiples: how much a score changes if one choice is another than the default,"
        " paired by scenario and seed; bars are 95 % intervals, the grey line is no change.",
        lambda: figure(drawn),
        drawn,
    )
    return Answer(
        frame, {one.choice: _CAPTIONS.get(one.choice, _CAPTION) for one in every}, [picture]
    )


_CAPTION = "Δ: less the default, paired by scenario and seed. Drift: of the filter alone."
_CAPTIONS = {
    DELETION: f"{_CAPTION} The bound is on the variance along x or y, as RobMOT has it.",
    "weights": f"{_CAPTION} 1, 1 is constant acceleration; 1, 0.8 damps it always alike.",
}


def _line(one: Variant) -> str:
    """How a table names a value; the filter beside it where it is not MD's alone."""
    value = f"{one.value} (default)" if one.name == one.filter else one.value
    return value if _of_md_alone(one.choice) else f"{one.filter}, {value}"


def _of_md_alone(choice: str) -> bool:
    return {one.filter for one in variants() if one.choice == choice} == {SUBJECT}


def figure(changes: pl.DataFrame) -> Figure:
    """Changes of scores by the values of each choice, a row of panels for each score."""
    names = list(dict.fromkeys(one.choice for one in variants()))
    blocks = [names[k : k + PANELS] for k in range(0, len(names), PANELS)]
    whole = Figure(figsize=(13, 5.6 * len(blocks)), layout="constrained")
    parts = whole.subfigures(len(blocks), 1, squeeze=False)[:, 0]
    for part, block in zip(parts, blocks, strict=True):
        panels = part.subplots(len(DRAWN), PANELS, sharey="row", squeeze=False)
        for row, (heading, _, _, unit, _) in enumerate(DRAWN):
            panels[row, 0].set_ylabel(f"change of\n{heading} [{unit}]")
            for axes, name in zip(panels[row], block, strict=True):
                _draw(axes, name, changes.filter(table=name, column=CHANGE + heading))
                if row == 0:
                    axes.set_title(name, fontsize=10)
        handles, labels = panels[-1, -1].get_legend_handles_labels()
        if len(labels) > 1:
            panels[-1, -1].legend(handles, labels, fontsize=8, loc="lower left")
    return whole


def _draw(axes: Axes, choice: str, changes: pl.DataFrame) -> None:
    """One panel: values of a choice from left to right, filters beside each other."""
    own = [one for one in variants() if one.choice == choice]
    values = list(dict.fromkeys(one.value for one in own))
    filters = colours(list(dict.fromkeys(one.filter for one in own)))
    axes.axhline(0, color="#999999", linewidth=1)
    shifts = np.linspace(-0.2, 0.2, len(filters)) if len(filters) > 1 else [0.0]
    for shift, (name, colour) in zip(shifts, filters.items(), strict=True):
        lines = {_line(one): values.index(one.value) for one in own if one.filter == name}
        found = changes.filter(pl.col("line").is_in(list(lines)), pl.col("value").is_not_null())
        if found.is_empty():
            continue
        x = np.array([lines[line] for line in found["line"]]) + shift
        y, low, high = (found[column].to_numpy() for column in ("value", "low", "high"))
        bars = None if np.isnan(low.astype(float)).any() else [y - low, high - y]
        axes.errorbar(x, y, bars, fmt="o", color=colour, markersize=4, capsize=2, label=name)
    if changes.is_empty():
        axes.text(0.5, 0.5, "the same", transform=axes.transAxes, ha="center", color="#777777")
    usual = next(values.index(one.value) for one in own if one.name == one.filter)
    axes.set_xticks(range(len(values)), values, rotation=25 if len(values) > 3 else 0, fontsize=8)
    axes.get_xticklabels()[usual].set_fontweight("bold")
    axes.set_xlim(-0.5, len(values) - 0.5)
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)


ITEMS = (
    Item(
        "ablations",
        "not in the paper",
        "which of MD's free choices matter in gaps?",
        f"Simulated traffic, detector {DETECTOR}, occlusion {OCCLUSION}. The paper does not say"
        " which readings of its equations it took; the defaults are in README and the notes.",
        jobs,
        answer,
    ),
)
