"""What was found into pictures: the goal over each parameter, and the gap in which most is lost."""

import math
from dataclasses import dataclass

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments import figures
from experiments.search.check import Check
from experiments.search.run import Found
from experiments.search.tables import heading
from experiments.world import Followed, follow
from experiments.worlds.figure import world_figure
from mdkf import DETECTORS, estimator
from scenarios import ParameterSpec
from sim_bridge import detect, simulate

COLUMNS = 3
"""Panels beside each other."""

_CONFIRMED, _UNCONFIRMED, _CONTROL = "#c62828", "#8a94a0", "#5d6878"
_TRIAL = "#1f5fd0"


def marginal_figure(found: Found) -> Figure:
    """The goal's value of each trial over each of its parameters, the candidates numbered."""
    axes = found.plan.space.axes
    columns = min(len(axes), COLUMNS)
    rows = math.ceil(len(axes) / columns)
    width = 7.0 if columns == 1 else 4.4 * columns
    figure = Figure(figsize=(width, 3.4 * rows + 0.5), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False, sharey=True).ravel()
    for panel, axis in zip(panels, axes, strict=False):
        _draw_marginal(panel, found, axis)
    for panel in panels[len(axes) :]:
        panel.set_axis_off()
    for panel in panels[::columns]:
        panel.set_ylabel(f"{found.plan.goal.label},\nmean of {found.plan.seeds} seeds", fontsize=9)
    handles, labels = panels[0].get_legend_handles_labels()
    shown = dict(zip(labels, handles, strict=True))
    figure.legend(
        shown.values(),
        shown.keys(),
        loc="outside lower center",
        ncols=len(shown),
        frameon=False,
        fontsize=9,
    )
    return figure


def _draw_marginal(panel: Axes, found: Found, axis: ParameterSpec) -> None:
    panel.axhline(0, color="black", linewidth=0.8)
    default = found.plan.space.defaults.parameters[axis.name]
    if axis.minimum <= default <= axis.maximum:
        panel.axvline(default, color=_CONTROL, linestyle=":", label="default", zorder=1)
    for chosen_by, face in (("design", "white"), ("optimiser", _TRIAL)):
        own = [one for one in found.trials if one.chosen_by == chosen_by]
        panel.plot(
            [one.point[axis.name] for one in own],
            [one.value for one in own],
            *("o",),
            color=_TRIAL,
            markerfacecolor=face,
            markersize=4.5,
            label=f"trials of the {chosen_by}",
            zorder=2,
        )
    nothing = [one.point[axis.name] for one in found.trials if math.isnan(one.value)]
    if nothing:
        panel.plot(
            nothing,
            [0.02] * len(nothing),
            *("|",),
            color=_UNCONFIRMED,
            transform=panel.get_xaxis_transform(),
            label="trials without a value",
        )
    checked = found.checks.candidates if found.checks else ()
    stood = found.checks.confirmed if found.checks else ()
    for one in checked:
        colour = _CONFIRMED if one in stood else _UNCONFIRMED
        place = one.trial.point[axis.name]
        panel.errorbar(
            place,
            one.effect.mean,
            [[one.effect.mean - one.effect.low], [one.effect.high - one.effect.mean]],
            fmt="D",
            color=colour,
            markersize=6,
            capsize=3,
            label=f"fresh seeds: {'confirmed' if one in stood else 'not confirmed'}",
            zorder=4,
        )
        panel.annotate(
            one.name.removeprefix("worst-"),
            (place, one.effect.mean),
            textcoords="offset points",
            xytext=(7, 5),
            color=colour,
            fontsize=10,
            fontweight="bold",
        )
    panel.set_xlabel(heading(axis))
    margin = 0.03 * (axis.maximum - axis.minimum)
    panel.set_xlim(axis.minimum - margin, axis.maximum + margin)
    panel.grid(alpha=0.25)
    panel.spines[["top", "right"]].set_visible(False)


@dataclass(frozen=True)
class WorstPicture:
    """A figure and what it shows."""

    figure: Figure
    caption: str


def worst_picture(found: Found, one: Check) -> WorstPicture:
    """The fresh seed in which a worst case is worst, and in it the gap in which most is lost; the
    whole world where there is no gap."""
    plan = found.plan
    seed = plan.fresh_seeds[int(np.nanargmax(one.values.goal))]
    scenario = plan.space.at(one.trial.point)
    trace = simulate(scenario, seed)
    occluded = plan.occlusion.apply(seen := detect(trace, plan.detector, seed), trace)
    rules = (DETECTORS[plan.settings], plan.occlusion, plan.gap_truth)
    followed = {
        name: follow(trace, occluded, estimator(name), *rules) for name in plan.goal.filters
    }
    where = f"{scenario.name}, seed {seed}: of {plan.check_seeds} fresh seeds the worst"
    gap = _worst_gap(followed, plan.goal.metric, plan.goal.filter, plan.goal.against)
    if gap is None:
        return WorstPicture(world_figure(scenario, trace), f"{where}; the whole world from above.")
    errors = _errors(followed).filter(object_id=gap[0], gap_start=gap[1])
    tracks = {name: one.tracks for name, one in followed.items()}
    figure = figures.gap_figure(trace, seen, occluded, tracks, errors, gap)
    return WorstPicture(
        figure,
        f"{where}, and in it the gap in which {plan.goal.filter} is furthest"
        f" {'off' if plan.goal.against is None else f'behind {plan.goal.against}'} (object"
        f" {gap[0]}). Left: truth, detections, and each filter's path through the gap. Right: its"
        " error.",
    )


def _errors(followed: dict[str, Followed]) -> pl.DataFrame:
    """`gap_errors` of every filter, with a column `filter`."""
    return pl.concat(
        [one.errors.with_columns(filter=pl.lit(name)) for name, one in followed.items()]
    )


def _worst_gap(
    followed: dict[str, Followed], metric: str, filter: str, against: str | None
) -> tuple[int, int, int] | None:
    """The gap (object, start, stop) with the largest mean error of the filter, less the opponent's.

    The error is the drift, or, for all other metrics, the followed track's. First those that every
    filter's track goes through uncaptured: of them alone a picture shows a filter, not a mistake of
    association. None without a gap in which there is something to compare.
    """
    errors = _errors(followed).filter(phase="gap")
    of_gap = ("object_id", "gap_start", "gap_stop")
    value = "drift" if metric == "drift" else "error"
    free = ((pl.col("track_id") >= 0) & ~pl.col("captured")).all().over(*of_gap)
    by_gap = (
        errors.with_columns(free=free)
        .group_by(*of_gap, "filter")
        .agg(pl.col(value).mean().alias("value"), pl.col("free").first())
    )
    lost = by_gap.filter(filter=filter).drop_nulls("value")
    if against is not None and against != filter:
        other = by_gap.filter(filter=against).drop_nulls("value").select(*of_gap, other="value")
        lost = lost.join(other, on=of_gap).with_columns(pl.col("value") - pl.col("other"))
    worst = lost.sort("free", "value", *of_gap, descending=[True, True, False, False, False])
    if worst.is_empty():
        return None
    object_id, start, stop = worst.select(*of_gap).row(0)
    return int(object_id), int(start), int(stop)
