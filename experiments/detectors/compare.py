"""Recorded and simulated detections of the same recorded truth, side by side."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import polars as pl
from scipy.stats import ks_2samp

from experiments.detectors.false_boxes import recurrence
from experiments.detectors.sightings import ERRORS, Sightings
from mdkf.tables import FloatArray
from sim_bridge.randomness import stream

POINTS = 0.03
"""Difference of recall that counts as the same."""
PART = 0.1
"""Relative difference of errors and clutter that counts as the same."""
RANGES = (0, 10, 20, 30, 40, 50, 60, 70)
"""[m]"""
LEVELS = ("in full view", "partly hidden", "largely hidden")
"""KITTI's levels of occlusion 0, 1, 2."""
RESAMPLES = 400
FEWEST = 30
"""Cars' frames that a row of the table needs."""

Statistic = Callable[[pl.DataFrame, FloatArray], float]
"""Of a table, each row counted so often (rows,)."""


@dataclass(frozen=True)
class Row:
    """One comparison: recorded value with its 95 % interval, simulated value, the limit within
    which they should agree, None for none, and whether they do."""

    what: str
    of: str
    real: float
    low: float
    high: float
    simulated: float
    limit: float | None
    within: bool | None


def compare(real: Sightings, simulated: Sightings) -> list[Row]:
    """All comparisons. Intervals are of cars, or of sequences for clutter, drawn anew.

    Errors are medians of their size; a false box is there again if the next frame has one within
    a metre.
    """
    rows = [*_recalls(real, simulated), *_errors(real, simulated)]
    rows += [*_events(real, simulated), *_clutter(real, simulated)]
    return rows


def distances(real: Sightings, simulated: Sightings) -> dict[str, float]:
    """Kolmogorov and Smirnov's distance of each distribution, real against simulated, that has
    values on both sides."""
    columns = {
        **{f"{name} error": (real.cars[name], simulated.cars[name]) for name in ERRORS},
        "score of cars": (real.cars["score"], simulated.cars["score"]),
        "score of false boxes": (real.clutter["score"], simulated.clutter["score"]),
        "distance of false boxes": (real.clutter["distance"], simulated.clutter["distance"]),
    }
    found = {}
    for name, both in columns.items():
        a, b = (values.drop_nans().to_numpy() for values in both)
        if len(a) and len(b):
            found[name] = float(ks_2samp(a, b).statistic)
    return found


def _parts(seen: Sightings) -> Iterator[tuple[str, pl.Expr]]:
    """What recall is asked of: cars by distance and by level of occlusion."""
    for near, far in pairwise(RANGES):
        yield f"{near}-{far} m", pl.col("distance").is_between(near, far, closed="left")
    for level, name in enumerate(LEVELS):
        yield name, pl.col("occlusion") == level


def _recalls(real: Sightings, simulated: Sightings) -> Iterator[Row]:
    def recall(cars: pl.DataFrame, times: FloatArray) -> float:
        return float(np.average(cars["hit"].to_numpy(), weights=times))

    yield _row("recall", "all", real.cars, simulated.cars, recall, POINTS, relative=False)
    for name, part in _parts(real):
        a, b = real.cars.filter(part), simulated.cars.filter(part)
        if min(len(a), len(b)) >= FEWEST:
            yield _row("recall", name, a, b, recall, POINTS, relative=False)


def _errors(real: Sightings, simulated: Sightings) -> Iterator[Row]:
    for error in ("radial", "lateral"):

        def median(cars: pl.DataFrame, times: FloatArray, error: str = error) -> float:
            size = np.abs(cars[error].to_numpy())
            order = np.argsort(size)
            total = np.cumsum(times[order])
            return float(size[order][np.searchsorted(total, total[-1] / 2.0)])

        parts = [("all", pl.lit(True)), *_parts(real)]
        for name, part in parts:
            a, b = (of.cars.filter(part & pl.col("hit")) for of in (real, simulated))
            if min(len(a), len(b)) >= FEWEST:
                what = f"{error} error [m]"
                yield _row(what, name, a, b, median, PART, relative=True)


def _events(real: Sightings, simulated: Sightings) -> Iterator[Row]:
    """What comes in bursts: misses, and boxes that look backwards."""

    def rate(cars: pl.DataFrame, times: FloatArray) -> float:
        return float(np.average(cars["event"].to_numpy(), weights=times))

    key = ["sequence", "object_id", "frame"]
    for what, column, events in (
        ("miss after miss", "hit", pl.col("hit") == 0),
        ("backwards", "flip", pl.lit(False)),
        ("backwards again", "flip", pl.col("flip") == 1),
    ):
        both = []
        for seen in (real, simulated):
            cars = seen.cars
            if what != "backwards":
                before = cars.filter(events).select(key).with_columns(pl.col("frame") + 1)
                cars = cars.join(before, on=key, how="semi")
            event = 1 - pl.col("hit").cast(pl.Float64) if column == "hit" else pl.col("flip")
            both.append(cars.with_columns(event=event).filter(pl.col("event").is_not_nan()))
        if min(map(len, both)) >= FEWEST:
            yield _row(what, "all", both[0], both[1], rate, None, relative=False)


def _clutter(real: Sightings, simulated: Sightings) -> Iterator[Row]:
    per_frame = [len(seen.clutter) / seen.n_frames for seen in (real, simulated)]
    counts = dict(real.clutter.group_by("sequence").len().iter_rows())
    boxes = np.array([counts.get(name, 0) for name in real.frames])
    frames = np.array(list(real.frames.values()))
    drawn = stream("resampled-sequences").integers(0, len(frames), (RESAMPLES, len(frames)))
    interval = _interval(boxes[drawn].sum(axis=1) / frames[drawn].sum(axis=1))
    yield _judged("false boxes", "all", per_frame[0], interval, per_frame[1], PART, True)
    if min(len(real.clutter), len(simulated.clutter)) == 0:
        return
    again = [float(recurrence(seen.clutter, [1])[0]) for seen in (real, simulated)]
    none = (float("nan"), float("nan"))
    yield _judged("there again", "all", again[0], none, again[1], None, False)


def _row(
    what: str,
    of: str,
    real: pl.DataFrame,
    simulated: pl.DataFrame,
    statistic: Statistic,
    limit: float | None,
    relative: bool,
) -> Row:
    """The statistic of both tables, with an interval of the first from cars drawn anew."""
    car = (real["sequence"] + "/" + real["object_id"].cast(pl.String)).rank("dense").to_numpy() - 1
    car = car.astype(np.int64)
    n, rng = int(car.max()) + 1, stream("resampled-cars", what, of)
    drawn = rng.multinomial(n, np.full(n, 1.0 / n), RESAMPLES).astype(np.float64)
    interval = _interval([statistic(real, times[car]) for times in drawn if times[car].any()])
    here, there = (statistic(table, np.ones(len(table))) for table in (real, simulated))
    return _judged(what, of, here, interval, there, limit, relative)


def _interval(values: Sequence[float] | FloatArray) -> tuple[float, float]:
    low, high = np.quantile(np.asarray(values), [0.025, 0.975])
    return float(low), float(high)


def _judged(
    what: str,
    of: str,
    real: float,
    interval: tuple[float, float],
    simulated: float,
    limit: float | None,
    relative: bool,
) -> Row:
    allowed = None if limit is None else limit * (real if relative else 1.0)
    within = None if allowed is None else bool(abs(simulated - real) <= allowed)
    return Row(what, of, real, *interval, simulated, allowed, within)
