"""The results of a run into one self-contained HTML page: tables, and pictures of gaps."""

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from markupsafe import Markup

from experiments import figures
from experiments.page import svg, write_page
from experiments.playback import playback
from experiments.run import SUBJECT, Plan, Results, kept_folder
from experiments.statistics import Interval, mean_interval
from experiments.terminal import COLUMNS, DIFFERENCES, best, format_value, paired_rows
from mdkf import DETECTORS, ESTIMATORS
from mdkf.tables import REGIMES, Detections, Trace, Tracks
from sim_bridge import DT, read_table

NAME = "report.html"
STATES = (
    # column, heading, decimals, whether smaller is better; None: it should be 2
    ("position_error", "position [m]", 3, True),
    ("velocity_error", "velocity [m/s]", 3, True),
    ("heading_error", "heading [rad]", 3, True),
    ("backwards", "backwards %", 1, True),
    ("gospa", "GOSPA [m]", 2, True),
    ("gospa_localisation", "located [m]", 2, True),
    ("gospa_missed", "missed [m]", 2, True),
    ("gospa_false", "false [m]", 2, True),
    ("nees", "NEES", 2, None),
    ("nis", "NIS", 2, None),
)
"""What the table of states shows."""

BINNED = (
    # score, group, heading, decimals
    ("position_error", "phase", "Position error [m] by phase", 2),
    ("nees", "phase", "NEES by phase", 2),
    ("mota", "range,level", "MOTA % by range and level", 1),
    ("miss_rate", "range,level", "Missed % by range and level", 1),
)
"""Scores by bin that the report shows."""


def write_report(plan: Plan, results: Results, out: Path, command: str) -> Path:
    """Write `report.html` into `out` and return its path; needs no network to be read."""
    drawn = drawn_filters(plan.filters)
    natural = plan.occlusion.kind == "natural"
    length = plan.occlusion.length
    mean_figure = figures.mean_drift_figure(results.errors, drawn, length, DT, natural)
    path = out / NAME
    write_page(
        "report.html.j2",
        path,
        plan=plan,
        command=command,
        seeds=", ".join(
            f"{row['seeds']} seeds of {row['scenario']}"
            for row in results.table.unique("scenario", maintain_order=True).to_dicts()
        ),
        filters={name: repr(ESTIMATORS[name]) for name in plan.filters},
        settings=repr(DETECTORS[plan.settings]),
        refused=results.refused,
        interrupted=results.interrupted,
        failure=results.failure,
        headings=[heading for _, heading, _, _ in COLUMNS],
        groups=_result_groups(results.table, COLUMNS),
        state_headings=[heading for _, heading, _, _ in STATES],
        states=_result_groups(results.table, STATES),
        binned=[_binned(results.breakdown, drawn, *shown) for shown in BINNED],
        differences=paired_rows(results.differences),
        difference_headings=DIFFERENCES,
        regimes=_regime_rows(results.errors, drawn),
        subject=SUBJECT,
        opponents=[name for name in drawn if name != SUBJECT] if SUBJECT in drawn else [],
        drawn=drawn,
        mean_figure=svg(mean_figure) if mean_figure else None,
        gaps=_gap_pictures(plan, results, out, drawn),
    )
    return path


def drawn_filters(filters: tuple[str, ...]) -> list[str]:
    """The filters in the pictures: those with RobMOT's start, or all if there are none."""
    return [name for name in filters if not name.endswith("-retuned")] or list(filters)


def _result_groups(
    table: pl.DataFrame, columns: tuple[tuple[str, str, int, bool | None], ...]
) -> list[dict[str, Any]]:
    """Scenarios with their rows of formatted cells; the best of each column is marked."""
    groups = []
    for (scenario,), group in table.group_by("scenario", maintain_order=True):
        rows = group.to_dicts()
        leaders = {
            column: None if smaller is None else best(rows, column, smaller)
            for column, _, _, smaller in columns
        }
        lines = [
            {
                "filter": row["filter"],
                "cells": [
                    {
                        "text": format_value(row, column, decimals),
                        "best": row[column] is not None and row[column] == leaders[column],
                    }
                    for column, _, decimals, _ in columns
                ],
            }
            for row in rows
        ]
        seeds = rows[0]["seeds"]
        gaps = round(rows[0]["followed"] * seeds)
        groups.append({"scenario": scenario, "seeds": seeds, "gaps": gaps, "lines": lines})
    return groups


def _binned(
    breakdown: pl.DataFrame, filters: list[str], score: str, group: str, heading: str, decimals: int
) -> dict[str, Any]:
    """One score by scenario, bin and filter: means over the seeds in which the bin has a value."""
    rows = breakdown.filter(pl.col("filter").is_in(filters), group=group, score=score)
    means = {
        key: mean_interval(own["value"].cast(pl.Float64).fill_null(float("nan")))
        for key, own in rows.group_by("scenario", "bin", "filter", maintain_order=True)
    }
    groups = []
    for scenario in rows["scenario"].unique(maintain_order=True):
        names = rows.filter(scenario=scenario)["bin"].unique(maintain_order=True)
        lines = [
            {"bin": name, "cells": [_told(means[scenario, name, f], decimals) for f in filters]}
            for name in names
        ]
        groups.append({"scenario": scenario, "lines": lines})
    return {"id": f"{score}-{group.replace(',', '-')}", "heading": heading, "groups": groups}


def _told(interval: Interval, decimals: int) -> str:
    """A mean with half of its interval; – is no value."""
    if not interval.n:
        return "–"
    text = f"{interval.mean:.{decimals}f}"
    half = interval.high - interval.mean
    return f"{text} ±{half:.{decimals}f}" if interval.n > 1 else text


def _regime_rows(errors: pl.DataFrame, filters: list[str]) -> list[dict[str, Any]]:
    """Mean drift by the object's true regime when the gap begins."""
    in_gap = errors.filter(pl.col("phase") == "gap")
    rows = []
    for regime in REGIMES:
        own = in_gap.filter(regime=regime)
        if own.is_empty():
            continue
        gap = ("scenario", "seed", "object_id", "gap_start")
        gaps = own.filter(filter=filters[0]).select(gap).n_unique()
        cells = [_regime_cell(own.filter(filter=name)) for name in filters]
        least = min(cell["value"] for cell in cells)
        for name, cell in zip(filters, cells, strict=True):
            cell["best"] = cell["value"] == least
            opposed = SUBJECT in filters and name != SUBJECT
            cell["paired"] = _paired(own, name) if opposed else None
        rows.append({"regime": regime.replace("_", " "), "gaps": gaps, "cells": cells})
    return rows


def _paired(errors: pl.DataFrame, opponent: str) -> str:
    """Difference of the seeds' mean drifts, subject minus opponent, with its interval."""
    by_seed = errors.group_by("seed", "filter").agg(pl.col("drift").mean())
    pairs = by_seed.pivot("filter", index="seed", values="drift")
    interval = mean_interval(pairs[SUBJECT] - pairs[opponent])
    shown = f"{interval.mean:+.2f}"
    return f"{shown} [{interval.low:+.2f}, {interval.high:+.2f}]" if interval.n > 1 else shown


def _regime_cell(errors: pl.DataFrame) -> dict[str, Any]:
    """One filter's drift in one regime: mean over seeds, and median over all frames."""
    by_seed = errors.group_by("seed").agg(pl.col("drift").mean())["drift"].drop_nulls()
    interval = mean_interval(by_seed)
    half = interval.high - interval.mean
    return {
        "value": interval.mean,
        "mean": f"{interval.mean:.2f}" + (f" ±{half:.2f}" if interval.n > 1 else ""),
        "median": f"{np.median(errors['drift'].drop_nulls()):.2f}",
    }


def _gap_pictures(
    plan: Plan, results: Results, out: Path, filters: list[str]
) -> list[dict[str, Any]]:
    """For the first good seed of each scenario the gaps nearest to the sensor, of a standing and
    of a moving object (or of a labelled one, of which nobody knows), captured tracks left out. The
    choice looks at no filter's error."""
    pictures = []
    for scenario in plan.scenarios:
        seed = results.kept.get(scenario.name)
        folder = kept_folder(out, scenario.name, -1 if seed is None else seed)
        if not folder.is_dir():
            continue
        own = results.errors.filter(scenario=scenario.name, seed=seed)
        trace = read_table(folder / "trace.parquet", Trace)
        detections = read_table(folder / "detections.parquet", Detections)
        seen = plan.occlusion.apply(detections, trace)
        tracks = {name: read_table(folder / f"tracks-{name}.parquet", Tracks) for name in filters}
        distance = trace.sensor_distance()
        regime = pl.col("regime")
        standing, unknown = regime == "stationary", regime == "unknown"
        kinds = {"standing": standing, "moving": ~standing & ~unknown, "labelled": unknown}
        for label, of_kind in kinds.items():
            gap = nearest_gap(trace, distance, own.filter(of_kind))
            if gap is None:
                continue
            errors = own.filter(object_id=gap[0], gap_start=gap[1])
            figure = figures.gap_figure(trace, detections, seen, tracks, errors, gap)
            title = f"{scenario.name}, seed {seed}: a {label} object in its gap"
            player = playback(trace, seen, tracks, focus=gap[0], gap=gap[1:], title=title)
            pictures.append(
                {
                    "scenario": scenario.name,
                    "label": label,
                    "object_id": gap[0],
                    "seed": seed,
                    "svg": svg(figure),
                    "playback": Markup(player),
                }
            )
    return pictures


def nearest_gap(trace: Trace, distance: Any, errors: pl.DataFrame) -> tuple[int, int, int] | None:
    """The gap (object, start, stop) whose object is nearest to the sensor as it begins, of those
    that every filter's track goes through uncaptured."""
    free = ((pl.col("track_id") >= 0) & ~pl.col("captured")).all().over("object_id", "gap_start")
    there = pl.col("gap_stop") > pl.col("gap_start")
    gaps = errors.filter(free, there).select("object_id", "gap_start", "gap_stop").unique()
    found = []
    for object_id, start, stop in gaps.sort("object_id", "gap_start").iter_rows():
        rows = trace.rows_of(object_id)
        row = rows[trace.frame[rows] == start]
        found.append((float(distance[row[0]]), object_id, start, stop))
    return min(found)[1:] if found else None
