"""The Monte Carlo table of motion regimes on a terminal of 120 columns."""

from collections.abc import Mapping
from typing import Any

import polars as pl
from rich.box import SIMPLE_HEAD
from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from experiments.paper.motions import REGIMES
from experiments.paper.regimes import GAPS, NOTED, RETUNED, SUBJECT, Results

OPPONENTS = ("ca", "imm", "imm-zero")
"""Filters whose paired differences from MD are shown, with both starts; the rest are in the
rows."""

_HEADINGS = {
    "stationary": "stands",
    "stopped": "stopped",
    "constant-velocity": "constant\nvelocity",
    "acceleration-ended": "accel.\nended",
    "stop-and-go": "stop\nand go",
    "braking": "brakes",
    "accelerating": "speeds\nup",
    "turning": "turns",
    "crawling": "crawls",
}
_BETTER, _WORSE, _OPEN = "green", "red", "dim"
"""Colours of MD's differences; the last where the interval holds zero."""


def tables(results: Results) -> list[RenderableType]:
    """Errors and differences for each noise and history, then the notes beside them."""
    shown: list[RenderableType] = [_motions(results.rows)]
    for (noise, history), own in results.rows.group_by("noise", "history", maintain_order=True):
        setting = _setting(str(noise), history)
        shown.append(_errors(own, setting))
        paired = results.differences.filter(noise=noise, history=history, gap=max(GAPS))
        paired = paired.filter(pl.col("against").str.replace(f"{RETUNED}$", "").is_in(OPPONENTS))
        if not paired.is_empty():
            shown.append(_differences(paired, setting))
    noted = results.differences.filter(**NOTED)
    if not noted.is_empty():
        shown += [_notes(noted), *_signs(noted)]
    return shown


def _setting(noise: str, history: Any) -> str:
    return f"{_noise(noise)}, {history} frames of history"


def _noise(name: Any) -> str:
    return f"noise {name} m" if name[0].isdigit() else f"noise {name}"


def _table(title: str, *headings: str) -> Table:
    table = Table(title=escape(title), title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for place, heading in enumerate(headings):
        table.add_column(heading, justify="right" if place else "left", no_wrap=not place)
    return table


def _motions(rows: pl.DataFrame) -> Table:
    table = _table("Closed-form motions around a gap", "regime", "motion")
    table.columns[1].justify = "left"
    shown = set(rows["regime"])
    for regime in REGIMES:
        if regime.id in shown:
            table.add_row(regime.id, escape(regime.parameters))
    return table


def _errors(rows: pl.DataFrame, setting: str) -> Table:
    """Filters by regimes; cells hold the errors over the shorter and the longer gap."""
    widest = (rows["high"] - rows["error"]).max()
    certain = f"; half 95 % intervals up to {widest:.2f} m" if isinstance(widest, float) else ""
    seeds = rows["seeds"][0]
    table = _table(
        f"{setting}: mean position error [m] over {' / '.join(map(str, GAPS))} frames of the gap,"
        f" {seeds} seed{'s' * (seeds != 1)}{certain}; best in bold",
        "filter",
        *(_HEADINGS[regime] for regime in rows["regime"].unique(maintain_order=True)),
    )
    best = pl.col("error").min().over("regime", "gap")
    marked = rows.with_columns(best=pl.col("error") == best)
    for (name,), own in marked.group_by("filter", maintain_order=True):
        cells = []
        for _, cell in own.group_by("regime", maintain_order=True):
            texts = [
                f"[bold]{row['error']:.2f}[/bold]" if row["best"] else f"{row['error']:.2f}"
                for row in cell.sort("gap").to_dicts()
            ]
            cells.append("/".join(texts))
        table.add_row(str(name), *cells)
    return table


def _differences(paired: pl.DataFrame, setting: str) -> Table:
    """Regimes by opponents."""
    pairs = paired.select("filter", "against").unique(maintain_order=True).rows()
    table = _table(
        f"{setting}: {SUBJECT} minus ... over {max(GAPS)} frames [m], paired by seed, ± half of the"
        " 95 % interval; above zero (red) MD is worse",
        "regime",
        *(f"− {against}" for _, against in pairs),
    )
    for (regime,), own in paired.group_by("regime", maintain_order=True):
        by_pair = {(row["filter"], row["against"]): row for row in own.to_dicts()}
        table.add_row(str(regime), *(_difference(by_pair[pair]) for pair in pairs))
    return table


def _difference(row: Mapping[str, Any]) -> str:
    if row["difference"] == row["low"] == row["high"] == 0:
        return f"[{_OPEN}]identical[/{_OPEN}]"
    if row["low"] is None:
        return f"{row['difference']:+.2f}"
    colour = _OPEN if row["low"] <= 0 <= row["high"] else _WORSE if row["low"] > 0 else _BETTER
    return f"[{colour}]{row['difference']:+.2f} ±{row['high'] - row['difference']:.2f}[/{colour}]"


def _notes(noted: pl.DataFrame) -> Table:
    """The differences that the notes give beside those found here."""
    noises = noted["noise"].unique(maintain_order=True).to_list()
    headings = [part for noise in noises for part in (_noise(noise), "sign")]
    table = _table(
        f"{SUBJECT} minus {NOTED['against']} over {NOTED['gap']} frames [m] and its sign, after"
        f" {NOTED['history']} frames of history; notes: the project's first table, its motions"
        " and noise not recorded",
        "regime",
        "notes",
        *headings,
    )
    for (regime,), own in noted.group_by("regime", maintain_order=True):
        cells = [f"{own['notes'][0]:+.2f}"]
        for row in own.to_dicts():
            cells += [_difference(row), row["sign"] or "too few seeds"]
        table.add_row(str(regime), *cells)
    return table


def _signs(noted: pl.DataFrame) -> list[str]:
    """In how many regimes the sign is the notes', and in which it is not; a line for each
    noise."""
    lines = []
    for (noise,), own in noted.group_by("noise", maintain_order=True):
        agreeing = own.filter(sign="agrees").height
        line = f"{_noise(noise)}: the notes' sign in {agreeing} of {own.height} regimes"
        others = [
            f"{row['regime']} ({row['difference']:+.2f}, notes {row['notes']:+.2f}:"
            f" {row['sign'] or 'too few seeds'})"
            for row in own.to_dicts()
            if row["sign"] != "agrees"
        ]
        lines.append("; not in ".join([line, ", ".join(others)]) if others else line)
    return lines
