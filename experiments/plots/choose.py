"""One call for every table."""

from collections.abc import Mapping
from typing import Any

from experiments.plots.above import birds_eye, path
from experiments.plots.over_time import error_over_time
from experiments.plots.picture import Picture
from experiments.scoring import Scores
from mdkf.tables import Detections, EgoPath, Trace, Tracks


def plot(
    table: Trace | EgoPath | Detections | Tracks | Mapping[str, Tracks] | Scores,
    trace: Trace | None = None,
    **options: Any,
) -> Picture:
    """What a table holds, as a picture.

    A trace, detections and tracks are seen from above (`birds_eye`), an ego path alike. Tracks, or
    several by name, with their trace, and scores, become errors over time (`error_over_time`).
    options: those of the function that draws. Raises `TypeError` for anything else, and what that
    function raises.
    """
    match table:
        case Trace():
            return birds_eye(table, **options)
        case Detections():
            return birds_eye(trace, table, **options)
        case EgoPath():
            return path(table)
        case Scores():
            return error_over_time(table.matched.trace, table.matched.tracks, **options)
        case Tracks() | Mapping() if trace is None:
            return birds_eye(tracks=table, **options)
        case Tracks() | Mapping():
            return error_over_time(trace, table, **options)
    raise TypeError(
        f"plot: {type(table).__name__}, expected a Trace, EgoPath, Detections, Tracks, Tracks by"
        " name, or Scores"
    )
