"""A sweep's error growth into a table and a picture for each detector and set of rules."""

import re
from pathlib import Path

import polars as pl

from experiments.growth import CURVE, GROWTH, growth_curve, growth_figure
from experiments.sweeps.sweep import Sweep
from experiments.sweeps.task import parameters_of
from scenarios import Scenario
from sim_bridge import DT
from sim_bridge.parquet import write_frame

CURVES = {"detector": pl.String, "tracker": pl.String, **CURVE}
"""Columns of `curves`: those of `experiments.growth.growth_curve`, and what each is of."""


def on_curve(grown: pl.LazyFrame, sweep: Sweep) -> pl.LazyFrame:
    """What the curves are made of, of rows with the columns `experiments.sweeps.task.GROWN`: most
    rows are not on them, and most of a row tells what many have in common."""
    at_its_end = pl.col("offset") + 1 == _length(sweep)
    natural = pl.col("occlusion").is_in(_texts(sweep, "natural"))
    names = dict(zip(map(_world, sweep.scenarios), sweep.labels(), strict=True))
    # Of one scenario with different parameters each is a cluster of its own.
    scenario = pl.concat_str("scenario", "parameters")
    return grown.filter(pl.lit(_within(sweep)) | at_its_end | natural).select(
        *("detector", "tracker", "occlusion", "filter", "seed", *GROWTH),
        _length(sweep).alias("length"),
        scenario.replace_strict(names, return_dtype=pl.String).alias("scenario"),
    )


def curves(rows: pl.DataFrame, sweep: Sweep) -> pl.DataFrame:
    """The error-growth curves of a sweep, with the columns `CURVES`: over the lengths of its gaps,
    or within the gaps if they are all of one length.

    rows: those `on_curve`.
    """
    order = pl.Enum([one.name for one in sweep.filters])
    rows = rows.sort(pl.col("filter").cast(order), maintain_order=True)
    found = [pl.DataFrame(schema=CURVES)]
    for (detector, tracker), one in rows.group_by("detector", "tracker", maintain_order=True):
        curve = growth_curve(one, within=_within(sweep))
        which = [pl.lit(detector).alias("detector"), pl.lit(tracker).alias("tracker")]
        found.append(curve.select(*which, *CURVE))
    return pl.concat(found)


def _within(sweep: Sweep) -> bool:
    """Whether all gaps that are made are of one length."""
    made = {one.length for one in sweep.occlusions if one.kind not in ("none", "natural")}
    return len(made) < 2


def _length(sweep: Sweep) -> pl.Expr:
    """The length of each row's occlusion."""
    lengths = {str(one): one.length for one in sweep.occlusions}
    return pl.col("occlusion").replace_strict(lengths, default=None, return_dtype=pl.Int64)


def _texts(sweep: Sweep, kind: str) -> list[str]:
    return [str(one) for one in sweep.occlusions if one.kind == kind]


def write_growth(curve: pl.DataFrame, folder: Path) -> list[Path]:
    """Write `growth.parquet` and, for each detector and set of rules, `growth.svg` and `.png`;
    which pictures there are. Of several each has their names in its own."""
    # As in `growth_figure`: workers, which draw nothing, do not wait for matplotlib.
    from experiments.figures import write_figure

    write_frame(curve, folder / "growth.parquet")
    pictures = []
    groups = list(curve.group_by("detector", "tracker", maintain_order=True))
    for (detector, tracker), own in groups:
        figure = growth_figure(own.select(*CURVE), DT)
        if figure is None:
            continue
        of = "" if len(groups) == 1 else "-" + re.sub(r"[^\w.=]+", "-", f"{detector}-{tracker}")
        for kind in ("svg", "png"):
            path = folder / f"growth{of.rstrip('-')}.{kind}"
            write_figure(figure, path)
        pictures.append(path)
    return pictures


def _world(scenario: Scenario) -> str:
    """As `scenario` and `parameters` of its rows stand together."""
    return f"{scenario.name}{parameters_of(scenario)}"
