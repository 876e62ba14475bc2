"""How far a track is from its object before, in and after each gap.

The track followed is the one nearest to the object in the last frame before the gap. Its error is
measured as long as it lives, wherever it goes; that another detection captured it in the gap, that
it was deleted there or never regained its object is told apart from drift.
"""

from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from experiments.gaps import Gaps
from experiments.population import MATCH_DISTANCE
from mdkf.tables import REGIMES, Trace, Tracks

WINDOW = 10
"""Frames before and after a gap that are measured: one second at 10 Hz."""

SCHEMA = {
    "object_id": pl.Int64,
    "gap_start": pl.Int64,
    "gap_stop": pl.Int64,
    "regime": pl.String,
    "turning": pl.Boolean,
    "track_id": pl.Int64,
    "frame": pl.Int64,
    "offset": pl.Int64,
    "phase": pl.String,
    "error": pl.Float64,
    "captured": pl.Boolean,
    "deleted": pl.Boolean,
    "recovered": pl.Boolean,
}
"""Columns of `gap_errors`: regime and turning are the truth's at the gap's first frame, offset
counts frames from it, error is in metres and null where the followed track is gone. An empty gap
that has no first frame, as the trace ends, is of the last one before it."""


def gap_errors(trace: Trace, tracks: Tracks, gaps: Gaps) -> pl.DataFrame:
    """One row for each gap and frame, from `WINDOW` frames before it to `WINDOW` after it, neither
    of them in another gap of the object. Where the object does not reappear (late gaps) nothing
    comes after.

    A gap whose object no track follows has track_id -1 and no errors. `captured`: in the gap the
    track took a detection, which cannot be its object's. `deleted`: it ended before the gap did.
    `recovered`: at the end of the window it is with its object, and has been detected since. Both
    are null where the tracks do not tell which frames they coasted.
    """
    every = (_one_gap(trace, tracks, gaps, k) for k in range(len(gaps)))
    parts = [part for part in every if part is not None]
    if not parts:
        return pl.DataFrame(schema=SCHEMA)
    columns = {name: np.concatenate([part[name] for part in parts]) for name in SCHEMA}
    errors = pl.DataFrame(columns, schema=SCHEMA).with_columns(pl.col("error").fill_nan(None))
    if tracks.knows_coasting:
        return errors
    unknown = pl.lit(None, dtype=pl.Boolean)
    return errors.with_columns(captured=unknown, recovered=unknown)


def _one_gap(trace: Trace, tracks: Tracks, gaps: Gaps, k: int) -> dict[str, NDArray[Any]] | None:
    """Columns of one gap; None if the trace does not have the object as the gap begins."""
    object_id, start, stop = (int(a[k]) for a in (gaps.object_id, gaps.start, gaps.stop))
    rows = trace.rows_of(object_id)
    others = gaps.object_id == object_id
    begin = max(start - WINDOW, gaps.stop[others & (gaps.start < start)].max(initial=0))
    end = stop + WINDOW if gaps.reappear else stop
    end = min(end, gaps.start[others & (gaps.start > start)].min(initial=end))
    rows = rows[(trace.frame[rows] >= begin) & (trace.frame[rows] < end)]
    frame = trace.frame[rows]
    if start - 1 not in frame or (start not in frame and start < stop):
        return None
    at_start = rows[min(np.searchsorted(frame, start), len(rows) - 1)]
    followed = _followed(trace, tracks, rows[np.searchsorted(frame, start - 1)])
    error = np.full(len(rows), np.nan)
    captured = deleted = recovered = False
    if followed >= 0:
        own = tracks.rows_of(followed)
        place = np.searchsorted(tracks.frame[own], frame)
        alive = place < len(own)
        alive[alive] = tracks.frame[own[place[alive]]] == frame[alive]
        at = own[place[alive]]
        error[alive] = np.hypot(
            tracks.x[at] - trace.x[rows[alive]], tracks.y[at] - trace.y[rows[alive]]
        )
        detected = np.zeros(len(rows), dtype=np.bool_)
        detected[alive] = ~tracks.coasted[at]
        in_gap = (frame >= start) & (frame < stop)
        captured, deleted = bool(detected[in_gap].any()), not alive[in_gap].all()
        after = frame >= stop
        recovered = bool(detected[after].any() and error[-1] < MATCH_DISTANCE)
    n = len(rows)
    phase = np.where(frame < start, "before", np.where(frame < stop, "gap", "after"))
    return {
        "object_id": np.full(n, object_id),
        "gap_start": np.full(n, start),
        "gap_stop": np.full(n, stop),
        "regime": np.full(n, REGIMES[trace.regime[at_start]]),
        "turning": np.full(n, trace.turning[at_start]),
        "track_id": np.full(n, followed),
        "frame": frame,
        "offset": frame - start,
        "phase": phase,
        "error": error,
        "captured": np.full(n, captured),
        "deleted": np.full(n, deleted),
        "recovered": np.full(n, recovered),
    }


def _followed(trace: Trace, tracks: Tracks, row: int) -> int:
    """The track nearest to the object of a truth row in its frame, -1 if none is within 2 m."""
    there = tracks.frame_rows(int(trace.frame[row]))
    distance = np.hypot(tracks.x[there] - trace.x[row], tracks.y[there] - trace.y[row])
    if not len(distance) or distance.min() >= MATCH_DISTANCE:
        return -1
    return int(tracks.track_id[there][np.argmin(distance)])
