"""Rows of runs into what they say: means over seeds, and differences paired by seed."""

import json
from collections.abc import Hashable, Sequence

import numpy as np
import polars as pl
from scipy import stats

from experiments.statistics import CONFIDENCE
from experiments.sweeps.sweep import Sweep
from experiments.sweeps.task import DONE, METRICS, parameters_of

WORLD = ("scenario", "parameters", "detector", "tracker", "occlusion")
"""What runs that are compared have in common, beside the seed."""

COMPARED = (
    *("hota", "mota", "idf1", "idsw", "gospa", "position_error", "velocity_error"),
    *("error_before", "error_gap", "error_after", "drift", "deleted", "lost"),
)
"""Scores whose paired differences are told."""


def summarise(runs: pl.DataFrame, sweep: Sweep) -> pl.DataFrame:
    """A row for each world but its seed, and filter: `WORLD`, `label` (`Sweep.labels`), `filter`,
    `seeds`; of each score its mean, and as `_low` and `_high` its 95 % interval, by Student's t
    over the seeds; null where there is no value, or one alone.

    runs: of this sweep, with the columns `experiments.sweeps.task.RUNS`.
    """
    done = runs.filter(pl.col("status") == DONE)
    found = done.group_by(*WORLD, "filter").agg(pl.len().alias("seeds"), *_moments(METRICS))
    scores = [f"{metric}{end}" for metric in METRICS for end in ("", "_low", "_high")]
    whole = _with_intervals(found, METRICS)
    return _ordered(whole, sweep).select(*WORLD, "label", "filter", "seeds", *scores)


def differences(runs: pl.DataFrame, sweep: Sweep) -> pl.DataFrame:
    """The first filter less each other, paired by seed: `WORLD`, `label`, `filter`, `against`,
    `metric`, `difference`, its interval from `low` to `high` as in `summarise`, `seeds`."""
    subject = sweep.filters[0].name
    own = runs.filter(pl.col("status") == DONE).select(*WORLD, "seed", "filter", *COMPARED)
    first = own.filter(pl.col("filter") == subject).drop("filter")
    others = own.filter(pl.col("filter") != subject)
    both = others.join(first, on=[*WORLD, "seed"], suffix="_first")
    less = both.with_columns(
        (pl.col(f"{metric}_first") - pl.col(metric)).alias(metric) for metric in COMPARED
    )
    found = less.group_by(*WORLD, "filter").agg(*_moments(COMPARED))
    whole = _ordered(_with_intervals(found, COMPARED), sweep)
    return pl.concat(
        whole.select(
            *WORLD,
            "label",
            pl.lit(subject).alias("filter"),
            pl.col("filter").alias("against"),
            pl.lit(metric).alias("metric"),
            pl.col(metric).alias("difference"),
            pl.col(f"{metric}_low").alias("low"),
            pl.col(f"{metric}_high").alias("high"),
            pl.col(f"{metric}_n").cast(pl.Int64).alias("seeds"),
        )
        for metric in COMPARED
    )


def with_parameters(rows: pl.DataFrame) -> pl.DataFrame:
    """Rows with a column for each parameter of their scenarios, in place of `parameters`: null
    where a scenario has no such parameter. Where rows have a column NAME already, it is
    `parameter_NAME`."""
    decoded = rows.select("parameters").unique(maintain_order=True)
    values = pl.DataFrame(
        [json.loads(text) for text in decoded["parameters"]], infer_schema_length=None
    ).cast(pl.Float64)
    taken = {name: f"parameter_{name}" for name in values.columns if name in rows.columns}
    both = pl.concat([decoded, values.rename(taken)], how="horizontal")
    return rows.join(both, on="parameters", how="left", maintain_order="left").drop("parameters")


def _moments(metrics: Sequence[str]) -> list[pl.Expr]:
    """Of each score its mean, standard deviation and number of values."""
    return [
        moment
        for metric in metrics
        for moment in (
            pl.col(metric).mean(),
            pl.col(metric).std().alias(f"{metric}_std"),
            pl.col(metric).count().alias(f"{metric}_n"),
        )
    ]


def _with_intervals(found: pl.DataFrame, metrics: Sequence[str]) -> pl.DataFrame:
    """`low` and `high` of each score, of its moments."""
    ends = []
    for metric in metrics:
        n = found[f"{metric}_n"].to_numpy().astype(np.float64)
        deviation = found[f"{metric}_std"].cast(pl.Float64).fill_null(np.nan).to_numpy()
        with np.errstate(divide="ignore", invalid="ignore"):
            half = stats.t.ppf(0.5 + CONFIDENCE / 2, n - 1) * deviation / np.sqrt(n)
        width = pl.Series(half).fill_nan(None)
        ends.append((found[metric] - width).alias(f"{metric}_low"))
        ends.append((found[metric] + width).alias(f"{metric}_high"))
    return found.with_columns(ends)


def _ordered(found: pl.DataFrame, sweep: Sweep) -> pl.DataFrame:
    """Rows with their scenario's `label`, in the order in which the sweep names everything."""
    places = pl.DataFrame(
        {
            "scenario": [one.name for one in sweep.scenarios],
            "parameters": [parameters_of(one) for one in sweep.scenarios],
            "label": sweep.labels(),
        }
    ).with_row_index("_place")
    orders: dict[str, Sequence[Hashable]] = {
        "detector": sweep.detectors,
        "tracker": [str(one) for one in sweep.tracker],
        "occlusion": [str(one) for one in sweep.occlusions],
        "filter": [one.name for one in sweep.filters],
    }
    ranks = [
        pl.col(name).replace_strict(list(names), list(range(len(names)))).alias(f"_{name}")
        for name, names in orders.items()
    ]
    whole = found.join(places, on=["scenario", "parameters"]).with_columns(ranks)
    return whole.sort("_place", *(f"_{name}" for name in orders))
