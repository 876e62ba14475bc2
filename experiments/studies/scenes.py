"""Single scenes into rows of errors: cars that traffic hides (`experiments.studies.natural`),
tracked by every filter, alone (`experiments.drift`) and in the tracker (`experiments.phases`)."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np
import polars as pl

import scenarios
from experiments.drift import drift
from experiments.gaps import Gap, Gaps
from experiments.metrics import bird_iou
from experiments.phases import gap_errors
from experiments.studies.natural import (
    HORIZON,
    leaving_gaps,
    measured,
    natural_gaps,
    populations,
    steady,
)
from experiments.studies.scale import Scale
from experiments.studies.seeds import SeedJob
from experiments.studies.worlds import FILTERS, ORDER_2, ORDER_3, RETUNED
from mdkf import DETECTORS, Detections, Trace, Tracker, Tracks, estimator
from mdkf.tables import FloatArray

STUDY = "scenes"
DETECTOR = "pointrcnn"
OCCLUSION = "natural"

FIRST_LOOK, SUMO_SHARE = 100, 4
"""Below so many seeds, one in so many of what SUMO simulates: a seed of it holds many cars, and
costs as much."""

KEPT = ("md-keep", "md3-keep")
"""MD whose window outlives a gap."""
ALONE_ONLY = (*RETUNED, *KEPT)
"""Filters that are measured alone, not in the tracker."""

DRAWN_SEED = 0
"""The seed whose cars are drawn."""
DRAWN_PARKED = 10
"""A parked car is drawn in its gap of so many frames, as the paper's, or in the nearest to it."""
BEFORE, AFTER = 10, 5
"""Frames before and after a gap that its path is drawn for."""

BOX = ("x", "y", "yaw", "length", "width")
TRUTH = "truth"
DETECTED = "detections"


@dataclass(frozen=True)
class Scene(SeedJob):
    """One seed of a scenario. Bins: `standing`, `moving`, `parked` and `leaving` cars, and what is
    drawn."""

    @property
    def labels(self) -> Mapping[str, str]:
        """The same for all."""
        return {"study": STUDY, "detector": DETECTOR, "occlusion": OCCLUSION}

    def measured(self, trace: Trace) -> Iterator[dict[str, Any]]:
        """None if no car is hidden; else by filter and bin

        drift, drift sd: mean and standard deviation of the filter's own errors in the measured
            frames of all gaps [m]; the mean also of the gaps before which MD's window was formed,
            as `moving, steady`, and of the others, as `moving, unsteady`.
        error, error sd: of the track that follows the car, as long as it lives [m]. Both means also
            by frame of the gap, counted from 1, as `moving, frame 3`.
        kept: gaps in which that track lived and took no other detection [%].
        end drift, end distance, end iou: in the last measured frame the filter's own error [m], the
            distance of the track's box [m], and its overlap from above, 0 without a track.
        nearer: frames in which MD of the same order is nearer to the truth than the filter alone
            (where both are equally near, half) [%].
        x, y, yaw, length, width: what is drawn [m, rad], in the seed that is drawn.

        Of the filters `ALONE_ONLY` there is the drift, but not frame by frame.
        """
        return _measured(trace, self.detected(DETECTOR), self.seed == DRAWN_SEED)


def jobs(scale: Scale, names: Sequence[str]) -> list[Scene]:
    """Seeds of some scenarios: the scale's, for a first look a share of them with SUMO."""
    few = scale.scenes if scale.scenes >= FIRST_LOOK else ceil(scale.scenes / SUMO_SHARE)
    counts = {
        name: scale.scenes if scenarios.load(name).source == "closed-form" else few
        for name in names
    }
    return [Scene(name, seed) for name in names for seed in range(counts[name])]


def _measured(trace: Trace, detections: Detections, drawn: bool) -> Iterator[dict[str, Any]]:
    """filter, bin, metric, value and what is behind it."""
    natural, leaving = natural_gaps(trace, detections), leaving_gaps(trace, detections)
    bins = {**populations(trace, detections, natural), "leaving": leaving.rows()}
    gaps = Gaps.of([*measured(natural).rows(), *leaving.rows()])
    if not len(gaps):
        return
    settings = DETECTORS[DETECTOR]
    tracks = {name: Tracker(estimator(name), settings).run(detections) for name in FILTERS}
    every = []
    for name in (*FILTERS, *ALONE_ONLY):
        own = _in_gaps(gaps)
        if name in tracks:
            own = _followed(own, trace, tracks[name], gaps)
        alone = drift(trace, detections, gaps, estimator(name), settings)
        both = own.join(alone, on=["object_id", "frame"], how="left", maintain_order="left")
        every.append(both.with_columns(filter=pl.lit(name)))
    errors = pl.concat(every, how="diagonal")
    for name, own_gaps in bins.items():
        if own_gaps:
            part = errors.join(
                _starts(detections, own_gaps), on=["object_id", "gap_start"], maintain_order="left"
            )
            for one in _scores(part):
                yield {**one, "bin": name + one.get("bin", "")}
    if drawn:
        yield from _path(trace, detections, tracks, errors, bins["moving"])
        yield from _boxes(trace, tracks, errors, bins)


def _in_gaps(gaps: Gaps) -> pl.DataFrame:
    """object_id, gap_start, frame, nth (counted from 1) and whether it is the last, of each gap."""
    rows = [
        (car, start, frame, frame - start + 1, frame == stop - 1)
        for car, start, stop in gaps.rows()
        for frame in range(start, stop)
    ]
    return pl.DataFrame(rows, ["object_id", "gap_start", "frame", "nth", "last"], orient="row")


def _starts(detections: Detections, gaps: Sequence[Gap]) -> pl.DataFrame:
    """object_id, gap_start, steady."""
    rows = [(*gap[:2], steady(detections, gap)) for gap in gaps]
    return pl.DataFrame(rows, ["object_id", "gap_start", "steady"], orient="row")


def _followed(frames: pl.DataFrame, trace: Trace, tracks: Tracks, gaps: Gaps) -> pl.DataFrame:
    """With the columns of `gap_errors`, and of the track in the last frame of each gap the overlap
    from above, `iou`: 0 without a track."""
    errors = gap_errors(trace, tracks, gaps).filter(pl.col("phase") == "gap")
    own = errors.select(
        "object_id", "gap_start", "frame", "track_id", "error", "captured", "deleted"
    )
    both = frames.join(
        own, on=["object_id", "gap_start", "frame"], how="left", maintain_order="left"
    )
    iou = [
        _overlap(trace, tracks, car, track, frame) if last else None
        for car, track, frame, last in both.select(
            "object_id", "track_id", "frame", "last"
        ).iter_rows()
    ]
    return both.with_columns(pl.Series("iou", iou, pl.Float64))


def _overlap(trace: Trace, tracks: Tracks, car: int, track: int, frame: int) -> float:
    return float(bird_iou(_box(trace, car, frame), _box(tracks, track, frame)).sum())


def _box(table: Trace | Tracks, identifier: int, frame: int) -> FloatArray:
    """`BOX` of an object or a track in a frame (1, 5), or (0, 5) where it has no row."""
    own = table.rows_of(identifier)
    own = own[table.frame[own] == frame]
    return np.column_stack([getattr(table, column)[own] for column in BOX])


def _scores(errors: pl.DataFrame) -> Iterator[dict[str, Any]]:
    """The scores of one population."""
    for (name,), own in errors.group_by("filter", maintain_order=True):
        for one in _own_scores(own, in_tracker=name in FILTERS):
            yield {"filter": str(name), **one}
    yield from _nearer(errors)


def _own_scores(own: pl.DataFrame, in_tracker: bool) -> Iterator[dict[str, Any]]:
    """The scores of one population and filter."""
    yield from _spread("drift", own)
    for (before,), part in own.group_by("steady", maintain_order=True):
        yield _mean("drift", part["drift"], ", steady" if before else ", unsteady")
    if not in_tracker:
        return
    yield from _spread("error", own)
    for (nth,), part in own.group_by("nth", maintain_order=True):
        for metric in ("drift", "error"):
            yield _mean(metric, part[metric], f", frame {nth}")
    ends = own.filter("last")
    kept = (pl.col("track_id") >= 0) & ~pl.col("captured") & ~pl.col("deleted")
    yield _mean("kept", ends.select(100 * kept.cast(pl.Float64)).to_series())
    for metric, column in (("end drift", "drift"), ("end distance", "error"), ("end iou", "iou")):
        yield _mean(metric, ends[column])


def _spread(metric: str, own: pl.DataFrame) -> Iterator[dict[str, Any]]:
    yield _mean(metric, own[metric])
    values = own[metric].drop_nulls()
    yield {"metric": f"{metric} sd", "value": values.std(), "n": len(values)}


def _mean(metric: str, values: pl.Series, part: str = "") -> dict[str, Any]:
    there = values.drop_nulls()
    return {"bin": part, "metric": metric, "value": there.mean(), "n": len(there)}


def _nearer(errors: pl.DataFrame) -> Iterator[dict[str, Any]]:
    """How often MD is nearer than each other filter of its order."""
    drifts = {
        str(name): own["drift"].to_numpy()
        for (name,), own in errors.group_by("filter", maintain_order=True)
    }
    for subject, others in (("md", ORDER_2), ("md3", ORDER_3)):
        for name in others:
            if name != subject:
                sign = np.sign(drifts[name] - drifts[subject])
                share = 100 * float((1 + sign).mean()) / 2
                yield {"filter": name, "metric": "nearer", "value": share, "n": len(sign)}


def _path(
    trace: Trace,
    detections: Detections,
    tracks: Mapping[str, Tracks],
    errors: pl.DataFrame,
    moving: Sequence[Gap],
) -> Iterator[dict[str, Any]]:
    """Positions around the gap of a moving car that lasts the nearest to `HORIZON` frames, the
    earliest of equals: of the truth, the detections, and the tracks that follow the car. Bins:
    `path, frame 1` is the gap's first; its length is the metric `frames`."""
    if not moving:
        return
    car, start, stop = min(moving, key=lambda gap: (abs(gap[2] - gap[1] - HORIZON), gap[1], gap[0]))
    yield {"filter": TRUTH, "bin": "path", "metric": "frames", "value": stop - start, "n": 1}
    tables: list[tuple[str, Trace | Tracks | Detections, int]] = [
        (TRUTH, trace, car),
        (DETECTED, detections, car),
        *((name, tracks[name], _track(errors, name, car, start)) for name in FILTERS),
    ]
    for name, table, identifier in tables:
        rows = table.rows_of(identifier)
        frame = table.frame[rows]
        for row in rows[(frame >= start - BEFORE) & (frame < stop + AFTER)].tolist():
            at = {"filter": name, "bin": f"path, frame {table.frame[row] - start + 1}", "n": 1}
            yield {**at, "metric": "x", "value": table.x[row]}
            yield {**at, "metric": "y", "value": table.y[row]}


def _boxes(
    trace: Trace,
    tracks: Mapping[str, Tracks],
    errors: pl.DataFrame,
    bins: Mapping[str, Sequence[Gap]],
) -> Iterator[dict[str, Any]]:
    """Boxes in the last measured frame of some gaps, of the truth and of the tracks: of each parked
    car its gap nearest to `DRAWN_PARKED` frames, the earliest of equals (bins `parked 1`, ...), and
    of all leaving cars."""
    nearest: dict[int, Gap] = {}
    by_length = sorted(
        bins["parked"], key=lambda gap: (abs(gap[2] - gap[1] - DRAWN_PARKED), gap[1])
    )
    for gap in by_length:
        nearest.setdefault(gap[0], gap)
    for population, gaps in (("parked", nearest.values()), ("leaving", bins["leaving"])):
        for place, (car, start, stop) in enumerate(sorted(gaps), 1):
            frame = min(stop, start + HORIZON) - 1
            boxes = {TRUTH: _box(trace, car, frame)}
            for name in FILTERS:
                boxes[name] = _box(tracks[name], _track(errors, name, car, start), frame)
            for name, box in boxes.items():
                at = {"filter": name, "bin": f"{population} {place}", "n": 1}
                for row in box.tolist():
                    for metric, value in zip(BOX, row, strict=True):
                        yield {**at, "metric": metric, "value": value}


def _track(errors: pl.DataFrame, name: str, car: int, start: int) -> int:
    """The track that follows a car into its gap, -1 if none does."""
    own = errors.filter(filter=name, object_id=car, gap_start=start)
    return int(own["track_id"][0])
