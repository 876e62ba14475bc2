"""Results as tables on a terminal."""

import math
from collections.abc import Iterable, Mapping
from typing import Any

import polars as pl
from rich.box import SIMPLE_HEAD
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table

from experiments.bins import EVERYTHING
from experiments.population import MATCH_DISTANCE
from experiments.scoring import Scores
from experiments.states import Value
from experiments.states.gospa import CUTOFF, POWER
from scenarios import KittiScenario, Scenario
from scenarios.kitti import VARIABLE, kitti_root

COLUMNS = (
    # column, heading, decimals, whether smaller is better
    ("hota", "HOTA %", 1, False),
    ("mota", "MOTA %", 1, False),
    ("idf1", "IDF1 %", 1, False),
    ("idsw", "IDSW", 1, True),
    ("error_before", "before [m]", 2, True),
    ("error_gap", "gap [m]", 2, True),
    ("error_after", "after [m]", 2, True),
    ("drift", "drift [m]", 2, True),
    ("captured", "capt. %", 0, True),
    ("deleted", "del. %", 0, True),
    ("lost", "lost %", 0, True),
    ("ms_per_frame", "ms/frame", 3, True),
)
"""What a table of results shows."""


FULL_WIDTH = 168
"""Characters that a table with intervals needs."""

BREAKDOWN_WIDTH = 130
"""Characters that a breakdown with GOSPA's parts needs."""


def format_value(row: Mapping[str, Any], column: str, decimals: int, intervals: bool = True) -> str:
    """A mean, with half the width of its 95 % interval where there is one."""
    value = row[column]
    if value is None:
        return "–"
    text = f"{value:.{decimals}f}"
    high = row.get(f"{column}_high")
    return text if high is None or not intervals else f"{text} ±{high - value:.{decimals}f}"


def best(rows: Iterable[Mapping[str, Any]], column: str, smaller: bool) -> float | None:
    """The best value of a column, None if there is none."""
    values = [row[column] for row in rows if row[column] is not None]
    return (min if smaller else max)(values) if values else None


def results_table(results: pl.DataFrame, intervals: bool = True) -> Table:
    """Scores by scenario and filter, best in bold."""
    title = "Means over seeds" + " ± half of the 95 % interval" * intervals
    title += "; errors before, in and after the gap"
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("filter", no_wrap=True)
    for _, heading, _, _ in COLUMNS:
        table.add_column(escape(heading), justify="right", no_wrap=intervals)
    for (scenario,), group in results.group_by("scenario", maintain_order=True):
        rows = group.to_dicts()
        leaders = {column: best(rows, column, smaller) for column, _, _, smaller in COLUMNS}
        seeds = rows[0]["seeds"]
        table.add_row(f"[italic]{escape(str(scenario))}, {seeds} seed{'s' * (seeds != 1)}[/italic]")
        for row in rows:
            cells = []
            for column, _, decimals, _ in COLUMNS:
                text = format_value(row, column, decimals, intervals)
                leading = row[column] is not None and row[column] == leaders[column]
                cells.append(f"[bold]{text}[/bold]" if leading else text)
            table.add_row(row["filter"], *cells)
    return table


def difference_table(differences: pl.DataFrame, wide: bool = True) -> Table:
    """Paired differences of the drift and of HOTA."""
    title = "Differences paired over seeds, with 95 % intervals: is the first filter better?"
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD)
    table.add_column("scenario", no_wrap=wide)
    table.add_column("filters", no_wrap=wide)
    for metric in DIFFERENCES.values():
        table.add_column(escape(metric), justify="right", no_wrap=wide)
        table.add_column("", no_wrap=wide)
    for row in paired_rows(differences):
        cells = [cell for metric in DIFFERENCES for cell in (row[metric], row[f"{metric}_verdict"])]
        table.add_row(*map(escape, (row["scenario"], row["filters"], *cells)))
    return table


DIFFERENCES = {"drift": "drift [m]", "hota": "HOTA [points]"}
"""Metrics whose paired differences are shown."""

SMALLER_IS_BETTER = {column: smaller for column, _, _, smaller in COLUMNS}


def paired_rows(differences: pl.DataFrame) -> list[dict[str, str]]:
    """One row for each scenario and pair of filters: differences with intervals and verdicts."""
    rows: dict[tuple[str, str], dict[str, str]] = {}
    for row in differences.filter(pl.col("metric").is_in(list(DIFFERENCES))).to_dicts():
        pair = f"{row['filter']} − {row['against']}"
        own = rows.setdefault(
            (row["scenario"], pair), {"scenario": row["scenario"], "filters": pair}
        )
        own[row["metric"]] = "–" if row["difference"] is None else f"{row['difference']:+.3f}"
        if row["low"] is not None:
            own[row["metric"]] += f" [{row['low']:+.3f}, {row['high']:+.3f}]"
        own[f"{row['metric']}_verdict"] = verdict(row)
    return list(rows.values())


def verdict(row: Mapping[str, Any]) -> str:
    """What a paired difference says of its first filter."""
    if row["low"] is None:
        return "too few seeds"
    if row["low"] <= 0 <= row["high"]:
        return "not separable"
    return "better" if (row["high"] < 0) == SMALLER_IS_BETTER[row["metric"]] else "worse"


def scenario_table(catalogue: Iterable[Scenario]) -> Table:
    """The catalogue, a line each."""
    catalogue = tuple(catalogue)
    recorded = any(isinstance(scenario, KittiScenario) for scenario in catalogue)
    hint = f"no recordings in {kitti_root()}: set {VARIABLE} to list KITTI's sequences"
    table = Table(caption=None if recorded else escape(hint), caption_justify="left")
    for heading in ("scenario", "source", "length", "what happens"):
        table.add_column(heading)
    for scenario in catalogue:
        cells = (scenario.name, scenario.source, f"{scenario.duration:g} s", scenario.purpose)
        table.add_row(*map(escape, cells))
    return table


def parameter_table(scenario: Scenario) -> Table:
    """A scenario's parameters with units and bounds."""
    table = Table(title=escape(f"{scenario.name}: {scenario.purpose}"), title_justify="left")
    for heading in ("parameter", "value", "unit", "bounds", "meaning"):
        table.add_column(heading)
    for spec in scenario.parameter_specs:
        bounds = f"{spec.minimum:g} .. {spec.maximum:g}"
        value = f"{scenario.parameters[spec.name]:g}"
        table.add_row(*map(escape, (spec.name, value, spec.unit, bounds, spec.description)))
    return table


def score_table(scores: Scores) -> Group:
    """The scores of one sequence, with units and, where there are any, samples and verdicts."""
    summary = scores.summary()
    samples = {**scores.gospa.values(), **scores.states.values()}
    shown: list[RenderableType] = []
    for title, units in SECTIONS:
        table = Table(show_header=False, box=None)
        table.add_column(min_width=NAME_WIDTH)
        table.add_column(min_width=NUMBER_WIDTH, justify="right")
        table.add_column(min_width=UNIT_WIDTH, style="dim")
        table.add_column(style="dim")
        for name, unit in units.items():
            value, sampled = summary[name], samples.get(name)
            number = "–" if math.isnan(value) else f"{value:.4g}"
            table.add_row(name, number, unit, "" if sampled is None else _told_samples(sampled))
        shown += [f"[italic]{title}[/italic]", table]
    return Group(*shown)


NAME_WIDTH, NUMBER_WIDTH, UNIT_WIDTH = 18, 7, 3
"""Characters that align the tables of one sequence's scores."""


def _told_samples(sampled: Value) -> str:
    """How many samples a value has, and what its interval says."""
    if sampled.verdict is None:
        return f"n {sampled.n}"
    return f"n {sampled.n}: {sampled.verdict} ({sampled.low:.2f} to {sampled.high:.2f}) *"


SECTIONS: tuple[tuple[str, dict[str, str]], ...] = (
    (
        "tracking: HOTA, CLEAR, Identity",
        {
            **dict.fromkeys(("hota", "deta", "assa", "mota", "motp", "idf1", "miss_rate"), "%"),
            **dict.fromkeys(("idsw", "fp", "fn"), ""),
        },
    ),
    (
        f"GOSPA: c {CUTOFF:g} m, p {POWER:g}; n frames",
        dict.fromkeys(("gospa", "gospa_localisation", "gospa_missed", "gospa_false"), "m"),
    ),
    (
        f"state: tracks within {MATCH_DISTANCE:g} m of their object; n estimates",
        {
            **dict.fromkeys(("position_error", "position_rmse"), "m"),
            **dict.fromkeys(("velocity_error", "velocity_rmse"), "m/s"),
            **{"heading_error": "rad", "backwards": "%", "nees": "", "nis": ""},
        },
    ),
    (
        "around gaps: followed tracks, wherever they go",
        {
            **dict.fromkeys(("error_before", "error_gap", "error_after", "gap_median"), "m"),
            **dict.fromkeys(("captured", "deleted", "lost"), "%"),
            **dict.fromkeys(("gaps", "followed"), ""),
        },
    ),
)
"""The summary's names in the order in which they are shown, with their units."""

BINNED = (
    # score, heading, unit, decimals, whether it takes a wide terminal
    ("hota", "HOTA", "%", 1, False),
    ("mota", "MOTA", "%", 1, False),
    ("miss_rate", "miss", "%", 1, False),
    ("idsw", "IDSW", "", 0, True),
    ("gospa", "GOSPA", "m", 2, False),
    ("gospa_localisation", "located", "m", 2, True),
    ("gospa_missed", "missed", "m", 2, True),
    ("gospa_false", "false", "m", 2, True),
    ("position_error", "pos.", "m", 2, False),
    ("velocity_error", "vel.", "m/s", 2, False),
    ("heading_error", "head.", "rad", 2, True),
    ("backwards", "back", "%", 1, False),
    ("nees", "NEES", "*", 2, False),
    ("nis", "NIS", "*", 2, False),
)
"""What a breakdown shows."""

SIGNS = {"optimistic": "↑", "consistent": " ", "pessimistic": "↓"}

CORRELATED = (
    "* Expected: 2. ↑ optimistic: errors are larger than the covariances tell, ↓ pessimistic:"
    " smaller, by the 95 % interval of a consistent filter with as many independent samples. Those"
    " along a track are not independent: near its edge the interval decides nothing."
)
"""What to know of NEES and NIS."""


def breakdown_table(rows: pl.DataFrame, group: str, wide: bool = True) -> Table:
    """Scores of all and of a group's bins; – is no value, and what no bin has is left out."""
    title = f"By {group}: scores, mean errors, consistency"
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column(escape(group) if wide else "", no_wrap=True)
    table.add_column("truth\nrows", justify="right")
    binned = set(rows.filter(group=group)["score"])
    shown = [column for column in BINNED if column[0] in binned and (wide or not column[-1])]
    for _, heading, unit, _, _ in shown:
        table.add_column(f"{heading}\n{unit}", justify="right")
    of_group = rows.filter(pl.col("group").is_in([EVERYTHING, group]))
    for (name,), own in of_group.group_by("bin", maintain_order=True):
        found = {row["score"]: row for row in own.to_dicts()}
        cells = [_told_bin(found.get(score), decimals) for score, _, _, decimals, _ in shown]
        label = str(name) if wide else str(name).replace(", ", ",\n")
        table.add_row(escape(label), str(found.get("miss_rate", {"n": ""})["n"]), *cells)
    return table


def _told_bin(row: Mapping[str, Any] | None, decimals: int) -> str:
    """A value with its verdict's sign; nothing where the bin is not asked for the score."""
    if row is None:
        return ""
    if row["value"] is None:
        return "–"
    return f"{row['value']:.{decimals}f}{SIGNS.get(row['verdict'], '')}"
