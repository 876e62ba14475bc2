"""What a table holds, in a few facts: as text, and as HTML for notebooks.

The HTML is self-contained and takes its colours from the page, light or dark. Provenance is from
files of any origin: all text is escaped. A million rows take less than 100 ms.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from mdkf.columns import FloatArray, IntArray

if TYPE_CHECKING:
    from mdkf.table import Table

FIRST_ROWS = 5
"""Rows that are shown in a notebook."""

ORIGIN = ("scenario", "seed", "source", "detector", "occlusion", "estimator")
"""What is told of the provenance, in the order in which it came about."""
_LONGEST = 100
"""Characters of a text from the provenance."""
_LINE = "border-bottom:1px solid rgba(128,128,128,0.35)"
_CELL = "padding:0.1em 0.8em 0.1em 0;vertical-align:top;background:none"


class Summarised:
    """Summaries of a table: `repr` in one line, `describe` in a dozen, HTML in a notebook."""

    def __repr__(self: Any) -> str:
        ids = "" if self.ID is None else f", {len(np.unique(getattr(self, self.ID)))} {self.ID}s"
        seconds = self.n_frames * self.dt
        return (
            f"{type(self).__name__}({len(self)} rows, {self.n_frames} frames, {seconds:g} s{ids})"
        )

    def describe(self: Any) -> str:
        """Where the rows come from and what they hold, one fact a line."""
        return as_text(_title(self), facts(self))

    def _repr_html_(self: Any) -> str:
        """What notebooks show: the facts and the first rows."""
        header, rows = _first_rows(self)
        return as_html(_title(self), facts(self), header, rows)


def facts(table: "Table") -> dict[str, str]:
    """What a table holds, by name: origin, times, and what its columns tell."""
    told = {key: _origin(key, table.provenance[key]) for key in ORIGIN if key in table.provenance}
    told["frames"] = f"{table.n_frames:,} of {table.dt:g} s: {table.n_frames * table.dt:g} s"
    return told | (_OF[type(table).__name__](table) if len(table) else {})


def as_text(title: str, told: Mapping[str, str]) -> str:
    """A title and facts, one a line."""
    width = max(map(len, told), default=0)
    return "\n".join([title, *(f"  {name:<{width}}  {value}" for name, value in told.items())])


def as_html(
    title: str,
    told: Mapping[str, str],
    header: Sequence[str] = (),
    rows: Sequence[Sequence[str]] = (),
) -> str:
    """A title, facts and rows under a header, as a piece of HTML; all texts are plain ones."""
    listed = "".join(
        f'<tr style="background:none"><th style="{_CELL};text-align:left">{escape(name)}</th>'
        f'<td style="{_CELL};text-align:left;white-space:normal">{escape(value)}</td></tr>'
        for name, value in told.items()
    )
    parts = [f"<strong>{escape(title)}</strong>", f'<table style="color:inherit">{listed}</table>']
    if rows:
        names = "".join(
            f'<th style="{_CELL};{_LINE};text-align:right">{escape(name)}</th>' for name in header
        )
        lines = "".join(
            '<tr style="background:none">'
            + "".join(f'<td style="{_CELL};text-align:right">{escape(v)}</td>' for v in row)
            + "</tr>"
            for row in rows
        )
        table = f"<thead><tr>{names}</tr></thead><tbody>{lines}</tbody>"
        parts.append(
            f'<div style="overflow-x:auto"><table style="color:inherit">{table}</table></div>'
        )
    return f"<div>{''.join(parts)}</div>"


def _title(table: "Table") -> str:
    return f"{type(table).__name__}: {len(table):,} rows"


def _origin(key: str, value: object) -> str:
    text = str(value)
    if key == "occlusion":
        try:
            told = json.loads(text)
            text = f"{told['protocol']}, {len(told['gaps'])} gaps"
        except (ValueError, TypeError, KeyError, RecursionError):
            pass  # Whoever needs the gaps says what is wrong with them.
    return text if len(text) <= _LONGEST else text[: _LONGEST - 1] + "…"


def _first_rows(table: "Table") -> tuple[list[str], list[list[str]]]:
    columns = {name: array[:FIRST_ROWS].tolist() for name, array in table.columns().items()}
    for name, names in table.CODED.items():
        columns[name] = [names[code] for code in columns[name]]
    return list(columns), [[_value(v) for v in row] for row in zip(*columns.values(), strict=True)]


def _value(value: object) -> str:
    if isinstance(value, float):
        return "–" if np.isnan(value) else f"{round(value, 2) + 0.0:.2f}"
    return {True: "yes", False: "no"}[value] if isinstance(value, bool) else str(value)


def _of_trace(table: Any) -> dict[str, str]:
    place, size = _compact(table.object_id)
    kind_of = np.full(size, 255, dtype=np.uint8)
    kind_of[place] = table.kind
    objects = np.bincount(kind_of[kind_of < 255], minlength=len(table.CODED["kind"]))
    kinds = zip(table.CODED["kind"], objects.tolist(), strict=True)
    regimes = np.bincount(table.regime, minlength=len(table.CODED["regime"])) / len(table)
    shares = zip(table.CODED["regime"], regimes.tolist(), strict=True)
    full, hidden = float((table.visible == 1.0).mean()), float((table.visible == 0.0).mean())
    return {
        "objects": f"{objects.sum():,}: " + ", ".join(f"{n} {kind}" for kind, n in kinds if n),
        "regimes": ", ".join(f"{x:.0%} {name.replace('_', ' ')}" for name, x in shares if x)
        + f"; {table.turning.mean():.0%} turning",
        "from sensor": _spread(table.sensor_distance(), "m"),
        "visible": f"{full:.0%} in full, {1 - full - hidden:.0%} in part, {hidden:.0%} not at all",
    }


def _of_detections(table: Any) -> dict[str, str]:
    clutter = table.source < 0
    seen = len(_lengths(table.source[~clutter]))
    without = int((np.diff(table.frame_start) == 0).sum())
    return {
        "boxes": f"{len(table) / table.n_frames:.1f} a frame, {without:,} frames without any",
        "objects": f"{seen:,}",
        "clutter": f"{clutter.sum():,} boxes ({clutter.mean():.1%})",
        "score": _spread(table.score),
    }


def _of_tracks(table: Any) -> dict[str, str]:
    frames = _lengths(table.track_id)
    return {
        "tracks": f"{len(frames):,} of {_spread(frames, 'frames')}",
        "coasted": f"{table.coasted.mean():.1%} of the rows",
        "diagnostics": ", ".join(map(str, table.diagnostics)) or "none",
    }


def _of_ego_path(table: Any) -> dict[str, str]:
    steps = np.hypot(np.diff(table.x), np.diff(table.y))
    fastest = steps.max(initial=0.0) / table.dt
    return {"path": f"{steps.sum():.1f} m, at up to {fastest:.1f} m/s"}


_OF: Mapping[str, Callable[[Any], dict[str, str]]] = {
    "Trace": _of_trace,
    "Detections": _of_detections,
    "Tracks": _of_tracks,
    "EgoPath": _of_ego_path,
}


def _lengths(ids: IntArray) -> IntArray:
    """How many rows each identifier has that occurs."""
    counts: IntArray = np.bincount(_compact(ids)[0])
    return counts[counts > 0]


def _compact(ids: IntArray) -> tuple[IntArray, int]:
    """Identifiers as places in 0..size-1. Sorting is slow; where they are small already, there is
    nothing to do."""
    if len(ids) and ids.min() >= 0 and ids.max() < 4 * len(ids) + 1000:
        return ids, int(ids.max()) + 1
    own, place = np.unique(ids, return_inverse=True)
    return place, len(own)


def _spread(values: FloatArray | IntArray, unit: str = "") -> str:
    """Least, median and largest value."""
    low, middle, high = (f"{f(values):.4g}" for f in (np.min, np.median, np.max))
    return f"{low} to {high} {unit}".rstrip() + f", median {middle}"
