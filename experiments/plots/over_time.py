"""Tracks over time: how far they are from the truth, and what their filters believe."""

from collections.abc import Mapping, Sequence
from itertools import cycle, pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from experiments.figures import colours, line_style
from experiments.gaps import Gaps
from experiments.matched import check_origin
from experiments.occlusion import recorded_gaps
from experiments.pairing import UNASSIGNED
from experiments.phases import gap_errors
from experiments.playback.scene import inner_diagnostics
from experiments.plots.picture import Picture, by_name, origin, picture, plain
from experiments.plots.scenery import REGIME_COLOURS
from experiments.population import SCORED_VISIBLE, population
from mdkf.tables import KINDS, REGIMES, BoolArray, FloatArray, IntArray, TableError, Trace, Tracks

AROUND = 1.0
"""Shown before an object is tracked first, and after it is tracked last [s]."""
_COLOURS = ("#1f5fd0", "#e07b00", "#00838f", "#c2185b", "#546e7a")
"""Of weights and probabilities, in their order."""
_GAP: dict[str, Any] = {"color": "#888888", "alpha": 0.22, "linewidth": 0}
_NEVER = 2**40
"""A frame after all others."""
_HIDDEN: dict[str, Any] = {"facecolor": "none", "edgecolor": "#d0d0d0", "hatch": "////"}


def error_over_time(
    trace: Trace, tracks: Tracks | Mapping[str, Tracks], object_id: int | None = None
) -> Picture:
    """The position error of each filter [m] over time [s], above the true motion regimes.

    tracks: one table, or several by name, of the same gaps. object_id: the object; None: in every
    frame the mean over the objects that count (`experiments.population`) and have a track.

    An object is shown from 1 s before any filter tracks it until 1 s after. Its error is that of
    the track on it, up to 2 m away; around a gap that of the track that followed it into the gap,
    wherever that went (`experiments.phases`).

    Raises `TableError` for tracks that do not belong to the trace or differ in their gaps, and
    `ValueError` without tracks and for an object that is not there.
    """
    filters = by_name(tracks)
    if not filters:
        raise ValueError("error_over_time: no tracks")
    gaps = _same_gaps(trace, filters)
    errors = {name: row_errors(trace, table, gaps) for name, table in filters.items()}
    figure = picture(10, 5)
    above, below = figure.subplots(
        2, 1, sharex=True, height_ratios=(5, 2 * (object_id is None) + 1)
    )
    if object_id is None:
        rows = np.flatnonzero(population(trace, next(iter(filters.values())), gaps, "keep").truth)
        subject = "mean over all objects that count"
        _draw_means(above, trace, rows, errors)
        _draw_counts(below, trace, rows, gaps)
    else:
        rows = _tracked(trace, _rows_of(trace, object_id), errors)
        subject = f"{KINDS[trace.kind[rows[0]]]} {object_id}"
        for name, colour in colours(list(filters)).items():
            time, error = _by_frame(trace, rows, errors[name][rows])
            above.plot(time, error, line_style(name), color=colour, label=plain(name))
        _shade_object(above, trace, rows, gaps.covers(trace.object_id[rows], trace.frame[rows]))
        _regime_strip(below, trace, rows)
    above.set_ylim(bottom=0)
    above.set_ylabel("position error [m]")
    above.set_title(f"{origin(trace)}: {subject}", fontsize=11)
    _finish(above, below)
    return figure


def weights_over_time(
    tracks: Tracks, track_id: int | None = None, trace: Trace | None = None
) -> Picture:
    """The weights or mode probabilities of one track over time [s], grey where it coasts.

    track_id: the track; None: the one of most frames. trace: if given, the true regimes of the
    object that the track is on most often stand below, where it is on it.

    Raises `TableError` for tracks that do not belong to the trace, `ValueError` for a track that is
    not there, and for filters that have neither weights nor probabilities.
    """
    names = inner_diagnostics(tracks)
    if not names:
        told = plain(", ".join(tracks.diagnostics) or "none")
        raise ValueError(f"weights_over_time: no weights or probabilities, diagnostics: {told}")
    ids, counts = np.unique(tracks.track_id, return_counts=True)
    if not len(ids):
        raise ValueError("weights_over_time: no tracks")
    chosen = int(ids[np.argmax(counts)]) if track_id is None else track_id
    rows = tracks.rows_of(chosen)
    if not len(rows):
        raise ValueError(f"weights_over_time: no track {track_id}, expected one of {_some(ids)}")
    regimes = None if trace is None else _rows_under(trace, tracks, rows)
    figure = picture(10, 4 if regimes is None else 5)
    heights = (1,) if regimes is None else (5, 1)
    panels = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)
    above, below = panels[0, 0], panels[-1, 0]
    quantity = {name: _without_axis(name, names) for name in names}
    colour = dict(zip(dict.fromkeys(quantity.values()), cycle(_COLOURS), strict=False))
    for name in names:
        time, value = _by_frame(tracks, rows, tracks.diagnostics[name][rows])
        style = "--" if quantity[name] != name and name.endswith("y") else "-"
        above.plot(time, value, style, color=colour[quantity[name]], label=plain(name))
    values = np.concatenate([tracks.diagnostics[name] for name in names])
    if not ((values < 0) | (values > 1)).any():
        above.set_ylim(-0.03, 1.03)
    _shade(above, tracks, rows, tracks.coasted[rows], "coasting", _GAP)
    if trace is not None and regimes is not None:
        _regime_strip(below, trace, regimes)
    kinds = {name.partition("_")[0] for name in names}
    above.set_ylabel(f"{plain(kinds.pop())} [–]" if len(kinds) == 1 else "value [–]")
    (name,) = by_name(tracks)
    longest = f", the longest of {len(ids)}" if track_id is None else ""
    above.set_title(f"{origin(tracks)}, {plain(name)}: track {chosen}{longest}", fontsize=11)
    _finish(above, below)
    return figure


def row_errors(trace: Trace, tracks: Tracks, gaps: Gaps) -> FloatArray:
    """The position error [m] of every row of the truth (n_truth_rows,), NaN where no track is."""
    errors = np.full(len(trace), np.nan)
    row = population(trace, tracks, gaps, "keep").object_row
    own = np.flatnonzero(row != UNASSIGNED)
    at = row[own]
    errors[at] = np.hypot(tracks.x[own] - trace.x[at], tracks.y[own] - trace.y[at])
    for (object_id,), one in gap_errors(trace, tracks, gaps).group_by("object_id"):
        rows = trace.rows_of(int(str(object_id)))
        place = rows[np.searchsorted(trace.frame[rows], one["frame"].to_numpy())]
        errors[place] = one["error"].fill_null(np.nan).to_numpy()
    return errors


def _same_gaps(trace: Trace, filters: Mapping[str, Tracks]) -> Gaps:
    """The gaps of all the tracks, which can come from the trace."""
    for table in filters.values():
        check_origin(trace, table)
    every = [recorded_gaps(table) for table in filters.values()]
    if any(gaps.rows() != every[0].rows() for gaps in every):
        raise TableError("error_over_time: the tracks come from different gaps, expected the same")
    return every[0]


def _rows_of(trace: Trace, object_id: int) -> IntArray:
    rows = trace.rows_of(object_id)
    if not len(rows):
        known = _some(trace.ids())
        raise ValueError(f"error_over_time: no object {object_id}, expected one of {known}")
    return rows


def _tracked(trace: Trace, rows: IntArray, errors: Mapping[str, FloatArray]) -> IntArray:
    """The object's rows around those in which any filter tracks it; all if none ever does."""
    found = rows[np.any([np.isfinite(every[rows]) for every in errors.values()], axis=0)]
    if not len(found):
        return rows
    around = round(AROUND / trace.dt)
    first, last = trace.frame[found[0]] - around, trace.frame[found[-1]] + around
    shown: IntArray = rows[(trace.frame[rows] >= first) & (trace.frame[rows] <= last)]
    return shown


def _rows_under(trace: Trace, tracks: Tracks, rows: IntArray) -> IntArray | None:
    """The truth rows, where the track is, of the object that it is on most often; None: of none."""
    check_origin(trace, tracks)
    under = population(trace, tracks, recorded_gaps(tracks), "keep").object_row[rows]
    owners = trace.object_id[under[under != UNASSIGNED]]
    if not len(owners):
        return None
    ids, counts = np.unique(owners, return_counts=True)
    own = trace.rows_of(int(ids[np.argmax(counts)]))
    alive: IntArray = own[np.isin(trace.frame[own], tracks.frame[rows])]
    return alive


def _without_axis(name: str, names: Sequence[str]) -> str:
    """What a diagnostic is of, without the axis where there is one for x and one for y."""
    both = {f"{name[:-1]}x", f"{name[:-1]}y"}
    return name[:-1] if name in both and both <= set(names) else name


def _some(ids: IntArray) -> str:
    told = ", ".join(map(str, ids[:10].tolist()))
    return f"{told}, …" if len(ids) > 10 else told or "none"


def _by_frame(
    table: Trace | Tracks, rows: IntArray, values: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Times [s] and values from the rows' first frame to their last, NaN where there is no row."""
    frames = np.arange(table.frame[rows[0]], table.frame[rows[-1]] + 1)
    every = np.full(len(frames), np.nan)
    every[table.frame[rows] - frames[0]] = values
    return frames * table.dt, every


def _draw_means(axes: Axes, trace: Trace, rows: IntArray, errors: Mapping[str, FloatArray]) -> None:
    frame, time = trace.frame[rows], np.arange(trace.n_frames) * trace.dt
    for name, colour in colours(list(errors)).items():
        own = errors[name][rows]
        there = np.isfinite(own)
        count = np.bincount(frame[there], minlength=trace.n_frames)
        total = np.bincount(frame[there], own[there], minlength=trace.n_frames)
        mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
        axes.plot(time, mean, line_style(name), color=colour, label=plain(name), linewidth=1.3)


def _draw_counts(axes: Axes, trace: Trace, rows: IntArray, gaps: Gaps) -> None:
    """How many objects there are in each frame, by regime, and how many are in a gap."""
    frame, time = trace.frame[rows], np.arange(trace.n_frames) * trace.dt
    present = np.unique(trace.regime[rows]).tolist()
    counts = [
        np.bincount(frame[trace.regime[rows] == code], minlength=trace.n_frames) for code in present
    ]
    names = [REGIMES[code] for code in present]
    if counts:
        axes.stackplot(
            time,
            np.array(counts, dtype=np.float64),
            colors=[REGIME_COLOURS[name] for name in names],
            labels=[name.replace("_", " ") for name in names],
            alpha=0.65,
            linewidth=0,
            step="mid",
        )
    if len(gaps):
        hidden = gaps.covers(trace.object_id[rows], frame)
        inside = np.bincount(frame[hidden], minlength=trace.n_frames)
        axes.plot(time, inside, color="black", linewidth=1.3, label="in a gap")
    axes.set_ylim(bottom=0)
    axes.set_ylabel("objects")
    axes.yaxis.set_major_locator(MaxNLocator(nbins=4, integer=True))


def _regime_strip(axes: Axes, trace: Trace, rows: IntArray) -> None:
    """The true regimes of an object as a strip of colours."""
    for code in np.unique(trace.regime[rows]).tolist():
        colour = REGIME_COLOURS[REGIMES[code]]
        spans = _spans(trace, rows, trace.regime[rows] == code)
        bars = [(begin, end - begin) for begin, end in spans]
        axes.broken_barh(bars, (0, 1), color=colour, label=REGIMES[code].replace("_", " "))
    axes.set(ylim=(0, 1), yticks=())
    axes.set_ylabel("true\nregime", rotation=0, ha="right", va="center")


def _shade_object(axes: Axes, trace: Trace, rows: IntArray, in_gap: BoolArray) -> None:
    _shade(axes, trace, rows, in_gap, "gap: no detections", _GAP)
    out_of_view = (trace.visible[rows] < SCORED_VISIBLE) & ~in_gap
    _shade(axes, trace, rows, out_of_view, "hidden from the sensor", _HIDDEN)


def _shade(
    axes: Axes,
    table: Trace | Tracks,
    rows: IntArray,
    where: BoolArray,
    label: str,
    style: Mapping[str, Any],
) -> None:
    for k, (begin, end) in enumerate(_spans(table, rows, where)):
        axes.axvspan(begin, end, label=label if k == 0 else None, zorder=0, **style)


def _spans(table: Trace | Tracks, rows: IntArray, where: BoolArray) -> list[tuple[float, float]]:
    """Begin and end [s] of each run of consecutive frames, half a frame around them."""
    frames = table.frame[rows][where]
    edges = np.flatnonzero(np.diff(frames, prepend=-2, append=_NEVER) > 1)
    return [
        ((frames[first] - 0.5) * table.dt, (frames[after - 1] + 0.5) * table.dt)
        for first, after in pairwise(edges.tolist())
    ]


def _finish(*panels: Axes) -> None:
    """Grid, time below, legends beside."""
    for axes in panels:
        axes.grid(alpha=0.25)
        axes.spines[["top", "right"]].set_visible(False)
        if axes.get_legend_handles_labels()[0]:
            axes.legend(frameon=False, fontsize=9, loc="center left", bbox_to_anchor=(1.0, 0.5))
    panels[-1].set_xlabel("time [s]")
