"""What was found into tables: for files, for the terminal, for the page."""

import math
from collections.abc import Mapping
from typing import Any

import polars as pl
from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from experiments.search.check import CONFIRMED, Check
from experiments.search.optimise import Trial, Values
from experiments.search.run import Found
from experiments.statistics import mean_interval, told
from scenarios import ParameterSpec

DEFAULTS = "defaults"
"""Name of the control."""

PARAMETER, MEAN = "parameter_", "metric_"
"""What the columns of parameters and of filters begin with: both have names of their own."""


def trial_rows(found: Found) -> pl.DataFrame:
    """A row for each trial: number, chosen_by, a column for each parameter, value (the goal's, mean
    over the search's seeds; null where most have none), n (seeds with a value), refused, failed,
    and the metric's mean of each filter."""
    rows = [
        {
            **{"trial": one.number, "chosen_by": one.chosen_by},
            **_columns(one.point),
            "value": told(one.value),
            **_counts(one.values),
        }
        for one in found.trials
    ]
    return pl.DataFrame(rows, infer_schema_length=None)


def check_rows(found: Found) -> pl.DataFrame:
    """A row for each candidate, and one for the control: name, trial, a column for each parameter,
    searched (the goal's value in the search), effect with its 95 % interval low, high on n fresh
    seeds, p, p_holm, verdict, refused, failed, and the metric's mean of each filter."""
    if found.checks is None:
        return pl.DataFrame()
    rows = [
        {
            **{"name": one.name, "trial": one.trial.number},
            **_columns(one.trial.point),
            "searched": one.trial.value,
            **{"effect": told(one.effect.mean), "low": told(one.effect.low)},
            **{"high": told(one.effect.high), "n": one.effect.n},
            **{"p": one.p, "p_holm": one.p_holm, "verdict": one.verdict},
            **_missing(one.values),
        }
        for one in found.checks.candidates
    ]
    control = found.checks.control
    # Without an opponent the effects are differences from the control: it has none of its own.
    own = mean_interval(control.goal if found.plan.goal.against else [])
    parameters = found.plan.space.defaults.parameters
    rows.append(
        {
            **{"name": DEFAULTS, "trial": None},
            **_columns({axis.name: parameters[axis.name] for axis in found.plan.space.axes}),
            **{"searched": None, "effect": told(own.mean), "low": told(own.low)},
            **{"high": told(own.high), "n": control.n, "p": None, "p_holm": None},
            **{"verdict": None, **_missing(control)},
        }
    )
    return pl.DataFrame(rows, infer_schema_length=None)


def world_rows(found: Found) -> pl.DataFrame:
    """The fresh seeds: name, seed, the goal's value, and the metric of each filter."""
    if found.checks is None:
        return pl.DataFrame()
    every = [(one.name, one.values) for one in found.checks.candidates]
    rows = [
        {
            **{"name": name, "seed": seed, "value": told(float(values.goal[k]))},
            **{f"{MEAN}{own}": told(float(v[k])) for own, v in values.by_filter.items()},
        }
        for name, values in [*every, (DEFAULTS, found.checks.control)]
        for k, seed in enumerate(found.plan.fresh_seeds)
    ]
    return pl.DataFrame(rows, infer_schema_length=None)


def headline(found: Found) -> str:
    """What was found, in one sentence; that it is nothing comes first."""
    goal, name = found.plan.goal, found.plan.space.defaults.name
    ended = "interrupted" if found.interrupted else "unfinished"
    if found.checks is None:
        return (
            f"Nothing confirmed: {ended} after {len(found.trials)} of {found.plan.trials} trials,"
            " before anything was checked on fresh seeds"
        )
    what = f"{goal.filter} {_does(goal.metric, goal.against)} in {name}"
    count, stood = len(found.checks.candidates), len(found.checks.confirmed)
    if not count:
        return f"Nothing found: in none of {len(found.trials)} trials {what}"
    if not stood:
        return (
            f"Nothing found: where {what} in the search, it did not do so on fresh seeds (0 of"
            f" {count} confirmed)"
        )
    return f"{what}: {stood} of {count} worst cases confirmed on fresh seeds"


def told_missing(found: Found) -> list[str]:
    """Worlds that are not there, and trials without a value, a line for each."""
    lines = []
    if found.refused:
        lines.append(f"{found.refused} seeds refused: no valid world there")
    if found.failed:
        lines.append(f"{found.failed} worlds failed in the simulator, the first: {found.reason}")
    without = sum(math.isnan(one.value) for one in found.trials)
    if without:
        metric = found.plan.goal.metric
        lines.append(f"{without} trials have no value of {metric} in most of their worlds")
    if found.failure:
        lines.append(f"{found.failure}; the same command goes on from here")
    return lines


def check_table(found: Found) -> Table:
    """The candidates and the control, or, where nothing was checked, the candidates alone."""
    goal = found.plan.goal
    table = Table(title=effect_told(found), title_justify="left", box=SIMPLE_HEAD, padding=(0, 1))
    table.add_column("", no_wrap=True)
    for axis in found.plan.space.axes:
        table.add_column(escape(heading(axis)), justify="right")
    for name in ("searched", "fresh seeds, 95 %", *goal.filters, "seeds", "p (Holm)"):
        table.add_column(escape(name), justify="right", no_wrap=name.startswith("fresh"))
    table.add_column("verdict")
    for row in cells(found):
        style = "bold" if row["confirmed"] else ""
        table.add_row(*map(escape, (row["name"], *row["cells"])), style=style)
    return table


def cells(found: Found) -> list[dict[str, Any]]:
    """name, confirmed and formatted cells of each line of `check_table`."""
    axes = found.plan.space.axes
    if found.checks is None:
        return [
            _line(f"trial {one.number}", _point(one, axes), f"{one.value:+.3g}", one.values)
            for one in found.proposed
        ]
    lines = [
        {**_line(one.name, _point(one.trial, axes), *_checked(one)), "confirmed": _stood(one)}
        for one in found.checks.candidates
    ]
    rows = check_rows(found).to_dicts()
    control = rows[-1]
    point = [f"{control[PARAMETER + axis.name]:g}" for axis in axes]
    effect = effect_text(control["effect"], control["low"], control["high"])
    return [*lines, _line(DEFAULTS, point, "", found.checks.control, effect)]


def heading(axis: ParameterSpec) -> str:
    """A parameter with its unit."""
    return f"{axis.name} [{axis.unit}]"


def effect_told(found: Found) -> str:
    """What the numbers of the table are."""
    goal = found.plan.goal
    more = "" if goal.against else ", and how much more than at the defaults on fresh seeds"
    return f"{goal.label}{more}"


def effect_text(effect: float | None, low: float | None, high: float | None) -> str:
    """An effect with its interval; – is no value."""
    if effect is None:
        return "–"
    return f"{effect:+.3g}" + ("" if low is None else f" [{low:+.3g}, {high:+.3g}]")


def _does(metric: str, against: str | None) -> str:
    if against is not None:
        return f"loses to {against} by {metric}"
    return {
        "lost": "loses more tracks than at the defaults",
        "idsw": "switches identities more often than at the defaults",
    }.get(metric, f"has {metric} further off than at the defaults")


def _stood(one: Check) -> bool:
    return one.verdict == CONFIRMED


def _point(trial: Trial, axes: tuple[ParameterSpec, ...]) -> list[str]:
    return [f"{trial.point[axis.name]:g}" for axis in axes]


def _checked(one: Check) -> tuple[str, Values, str, str, str]:
    effect = effect_text(told(one.effect.mean), told(one.effect.low), told(one.effect.high))
    return f"{one.trial.value:+.3g}", one.values, effect, f"{one.p_holm:.2g}", one.verdict


def _line(
    name: str,
    point: list[str],
    searched: str,
    values: Values,
    effect: str = "",
    p: str = "",
    verdict: str = "",
) -> dict[str, Any]:
    means = ["–" if math.isnan(mean) else f"{mean:.3g}" for mean in values.means().values()]
    own = [*point, searched, effect, *means, str(values.n), p, verdict]
    return {"name": name, "confirmed": False, "cells": own}


def _columns(point: Mapping[str, float]) -> dict[str, float]:
    return {f"{PARAMETER}{name}": float(value) for name, value in point.items()}


def _counts(values: Values) -> dict[str, Any]:
    return {"n": values.n, **_missing(values)}


def _missing(values: Values) -> dict[str, Any]:
    means = {f"{MEAN}{name}": told(mean) for name, mean in values.means().items()}
    return {"refused": values.refused, "failed": values.failed, **means}
