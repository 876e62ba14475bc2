"""A trace into its switches: where an object's true motion changes from one state into another."""

import numpy as np

from mdkf.tables import UNKNOWN_REGIME, BoolArray, IntArray, TableError, Trace

LASTING = 10
"""Frames that a regime lasts on both sides of a switch, at least: a second at 10 Hz. Around a bound
between two regimes an object may pass through a third for a few frames."""


def regime_switches(trace: Trace) -> dict[int, IntArray]:
    """By object the first frames (n,) of its new regimes, in ascending order, where the old and the
    new one last `LASTING` frames; objects without a switch are left out.

    Raises `TableError` for a trace without regimes, as those of recordings are.
    """
    if len(trace) and (trace.regime == UNKNOWN_REGIME).all():
        name = trace.provenance.get("scenario", "trace")
        raise TableError(
            f"{name}: no switches of motion, as recorded objects have no regimes; expected the"
            " trace of a simulated world"
        )
    order, first, new = _runs(trace, trace.regime.astype(np.int64))
    lasts = np.diff(np.append(first, len(order))) >= LASTING
    switched = ~new
    switched[1:] &= lasts[1:] & lasts[:-1]
    rows = order[first[switched]]
    own, start = np.unique(trace.object_id[rows], return_index=True)
    by_object = np.split(trace.frame[rows], start[1:])
    return dict(zip(own.tolist(), by_object, strict=True)) if len(rows) else {}


def frames_since_change(trace: Trace, state: IntArray) -> IntArray:
    """Of every row, how many frames ago its object's state (n,) changed last, from 0 in the first
    frame of the new state on; before any change, more than there are frames."""
    order, first, new = _runs(trace, state)
    frame = trace.frame[order]
    lasts = np.diff(np.append(first, len(order)))
    ago = frame - np.repeat(frame[first], lasts)
    since = np.empty(len(order), dtype=np.int64)
    # Beginnings are infinitely long ago.
    since[order] = np.where(np.repeat(new, lasts), trace.n_frames + 1, ago)
    return since


def _runs(trace: Trace, state: IntArray) -> tuple[IntArray, IntArray, BoolArray]:
    """The rows by object and frame; among these the first of each run of rows of one object in one
    state; and whether the run is its object's first."""
    order = np.lexsort((trace.frame, trace.object_id))
    own, value = trace.object_id[order], state[order]
    begins = np.ones(len(order), dtype=np.bool_)
    begins[1:] = own[1:] != own[:-1]
    changes = begins.copy()
    changes[1:] |= value[1:] != value[:-1]
    first = np.flatnonzero(changes)
    return order, first, begins[first]
