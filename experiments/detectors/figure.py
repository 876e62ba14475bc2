"""Recorded and simulated detections in one picture: recall, errors, tails, bursts, clutter."""

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.detectors.compare import LEVELS
from experiments.detectors.dependence import pairs
from experiments.detectors.false_boxes import recurrence
from experiments.detectors.sightings import Sightings
from mdkf.tables import FloatArray

STEP = 10.0
"""Width of a bin of distance [m]."""
FEWEST = 30
"""Values that a point of a curve needs."""
CORRELATED = (1, 2, 3, 5, 8, 12, 20, 30, 45)
RECURRING = (1, 2, 3, 5, 8, 12, 20)
"""In frames."""
SIDES = (("recorded", "o-", 1.0), ("simulated", "s--", 0.75))
COLOURS = ("#1b6ca8", "#d1662b", "#3c8d4f")


def figure(title: str, real: Sightings, simulated: Sightings) -> Figure:
    """Solid lines are recorded, dashed ones simulated."""
    whole = Figure(figsize=(13.5, 7.2), layout="constrained")
    whole.suptitle(f"{title}: recorded (solid) and simulated (dashed) detections of the same cars")
    axes = whole.subplots(2, 4).ravel()
    both = list(zip((real, simulated), SIDES, strict=True))
    _recall(axes[0], both)
    for place, error in ((1, "radial"), (2, "lateral")):
        _median_error(axes[place], both, error)
    _tails(axes[3], both)
    _correlation(axes[4], both)
    _density(axes[5], "score of cars", [seen.cars["score"].drop_nans() for seen, _ in both])
    _density(axes[6], "distance of false boxes [m]", [seen.clutter["distance"] for seen, _ in both])
    _recurrence(axes[7], both)
    for panel in axes:
        panel.grid(alpha=0.25)
        panel.spines[["top", "right"]].set_visible(False)
    return whole


Both = list[tuple[Sightings, tuple[str, str, float]]]


def _binned(cars: pl.DataFrame, value: pl.Expr) -> pl.DataFrame:
    """The value by distance, where there is enough of it."""
    middle = (pl.col("distance") // STEP + 0.5) * STEP
    table = cars.group_by(at=middle).agg(value=value, n=pl.len()).sort("at")
    return table.filter(pl.col("n") >= FEWEST)


def _recall(axes: Axes, both: Both) -> None:
    for level, (name, colour) in enumerate(zip(LEVELS, COLOURS, strict=True)):
        for seen, (_, style, alpha) in both:
            cars = seen.cars.filter(occlusion=level)
            table = _binned(cars, pl.col("hit").mean())
            label = name if style == SIDES[0][1] else None
            axes.plot(
                table["at"], table["value"], style, color=colour, alpha=alpha, ms=4, label=label
            )
    axes.set(xlabel="distance [m]", ylabel="share of cars detected", ylim=(0, 1.02))
    axes.legend(frameon=False, fontsize=8, loc="lower left")


def _median_error(axes: Axes, both: Both, error: str) -> None:
    for level, colour in zip((0, 2), (COLOURS[0], COLOURS[2]), strict=True):
        for seen, (_, style, alpha) in both:
            cars = seen.cars.filter(pl.col("hit"), occlusion=level)
            table = _binned(cars, pl.col(error).abs().median())
            label = LEVELS[level] if style == SIDES[0][1] else None
            axes.plot(
                table["at"], table["value"], style, color=colour, alpha=alpha, ms=4, label=label
            )
    axes.set(xlabel="distance [m]", ylabel=f"median {error} error [m]")
    axes.set_ylim(bottom=0)
    axes.legend(frameon=False, fontsize=8)


def _tails(axes: Axes, both: Both) -> None:
    """How many errors are larger than given ones."""
    for error, colour in (("radial", COLOURS[0]), ("lateral", COLOURS[1])):
        for seen, (_, style, alpha) in both:
            size = np.sort(seen.cars[error].drop_nans().abs().to_numpy())
            beyond = 1.0 - np.arange(len(size)) / len(size)
            label = error if style == SIDES[0][1] else None
            axes.plot(size, beyond, style[1:], color=colour, alpha=alpha, label=label)
    axes.set(xscale="log", yscale="log", xlim=(0.01, 2.0), ylim=(1e-4, 1.0))
    axes.set(xlabel="error [m]", ylabel="share of larger errors")
    axes.legend(frameon=False, fontsize=8)


def _correlation(axes: Axes, both: Both) -> None:
    for error, colour in (("radial", COLOURS[0]), ("lateral", COLOURS[1])):
        for seen, (_, style, alpha) in both:
            # Ranks: a few gross errors would decide the correlation of the errors themselves.
            rank = seen.cars[error].fill_nan(None).rank().to_numpy()
            values = [_correlation_at(seen.cars, rank, lag) for lag in CORRELATED]
            label = error if style == SIDES[0][1] else None
            axes.plot(
                np.array(CORRELATED) * seen.dt,
                values,
                style,
                color=colour,
                alpha=alpha,
                ms=4,
                label=label,
            )
    axes.set(xlabel="time apart [s]", ylabel="rank correlation of errors", ylim=(-0.05, 1))
    axes.legend(frameon=False, fontsize=8)


def _correlation_at(cars: pl.DataFrame, values: FloatArray, lag: int) -> float:
    before, after = pairs(cars, lag)
    known = ~(np.isnan(values[before]) | np.isnan(values[after]))
    return float(np.corrcoef(values[before[known]], values[after[known]])[0, 1])


def _density(axes: Axes, label: str, values: list[pl.Series]) -> None:
    ends = [float(end) for of in values for end in (of.min(), of.max())]  # type: ignore[arg-type]
    bins = np.linspace(min(ends), max(ends), 40)
    for given, (_, style, alpha) in zip(values, SIDES, strict=True):
        height, edges = np.histogram(given.to_numpy(), bins, density=True)
        axes.stairs(
            height, edges, linestyle=style[1:], color=COLOURS[0], alpha=alpha, linewidth=1.5
        )
    axes.set(xlabel=label, ylabel="density")


def _recurrence(axes: Axes, both: Both) -> None:
    for seen, (_, style, alpha) in both:
        time = np.array(RECURRING) * seen.dt
        axes.plot(
            time, recurrence(seen.clutter, RECURRING), style, color=COLOURS[0], alpha=alpha, ms=4
        )
    axes.set(xlabel="time later [s]", ylabel="false boxes there again", ylim=(0, None))
