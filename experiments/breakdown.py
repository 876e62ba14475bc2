"""Truth and tracks into a table of scores by bin: phase, regime, range, level (`experiments.bins`).

Tracks and truth are matched once, all of them; a bin's score is then that of its own rows: its
truth, the tracks on that, and those of the tracks on nothing that belong to the bin. A track on
truth of another bin is ignored, as in Waymo's breakdown. So what bins count adds up to the whole.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl

from experiments.assignment import UNASSIGNED
from experiments.bins import Bin, bins
from experiments.metrics import ClearMatches, clear_matches, hota
from experiments.metrics.matching import ratio
from experiments.population import GapTruth, Population, population
from experiments.score import Similarity, gospa_of, hidden_gaps, sequence_of
from experiments.states import GospaScores, StateErrors, Value, state_errors
from mdkf.tables import BoolArray, Trace, Tracks

SCHEMA = {
    "group": pl.String,
    "bin": pl.String,
    "score": pl.String,
    "value": pl.Float64,
    "low": pl.Float64,
    "high": pl.Float64,
    "n": pl.Int64,
    "verdict": pl.String,
}
"""Columns of `breakdown`. value: null is "no value". low, high and verdict are those of
`experiments.states.Value`, null for scores that know no consistency. n: what is behind the value,
truth rows (hota to idsw), frames with an object or a track (gospa), or estimates (states)."""


def breakdown(
    trace: Trace,
    tracks: Tracks,
    by: Sequence[str],
    gap_truth: GapTruth = "keep",
    similarity: Similarity = "centre",
) -> pl.DataFrame:
    """One row for each bin and score, everything first; bins in order, empty ones too.

    by: one of phase, regime, range and level, or several for their products. Scores: hota, mota,
    miss_rate [%], idsw, and those of `GospaScores.values` and `StateErrors.values`. By phase and
    regime there is no hota, mota or gospa_false, as a track on nothing has no phase, and gospa is
    that of objects alone; in natural occlusions, where no track is asked for, there are state
    errors only.

    Raises `ValueError` for an unknown group, and as `experiments.score` does.
    """
    gaps = hidden_gaps(trace, tracks)
    found = bins(trace, tracks, gaps, by)
    whole = _matched(trace, tracks, population(trace, tracks, gaps, gap_truth), similarity)
    rows = [
        {
            "group": " x ".join(by),
            "bin": one.name,
            "score": score,
            "value": value.value,
            "low": value.low,
            "high": value.high,
            "n": value.n,
            "verdict": value.verdict,
        }
        for one in found
        for score, value in _scores(whole, one).items()
    ]
    return pl.DataFrame(rows, schema=SCHEMA).with_columns(pl.col(pl.Float64).fill_nan(None))


@dataclass(frozen=True, eq=False)
class _Matched:
    """Tracks and truth, matched once. clear, gospa: the rows that count. states: of every track's
    row that is on an object, counted or not. false (n_track_rows,): the tracks' rows that count
    and that CLEAR leaves on nothing."""

    trace: Trace
    tracks: Tracks
    similarity: Similarity
    kept: Population
    clear: ClearMatches
    gospa: GospaScores
    states: StateErrors
    false: BoolArray


def _matched(trace: Trace, tracks: Tracks, kept: Population, similarity: Similarity) -> _Matched:
    truth, estimates = trace.take(kept.truth), tracks.take(kept.tracks)
    matches = clear_matches(sequence_of(truth, estimates, similarity))
    false = kept.tracks.copy()
    hits = matches.track_row[matches.track_row >= 0]
    false[np.flatnonzero(kept.tracks)[hits]] = False
    on_object = np.flatnonzero(kept.object_row != UNASSIGNED)
    states = state_errors(trace, tracks, kept.object_row[on_object], on_object)
    gospa = gospa_of(truth, estimates)
    return _Matched(trace, tracks, similarity, kept, matches, gospa, states, false)


def _scores(whole: _Matched, one: Bin) -> Mapping[str, Value]:
    """What of the whole is the bin's."""
    kept = whole.kept
    counted = one.truth & (kept.truth if one.required else ~kept.truth)
    states = whole.states.take(counted[whole.states.truth_row]).values()
    if not one.required:
        return states
    own = counted[kept.truth]
    n = int(own.sum())
    missed = int((whole.clear.track_row[own] < 0).sum())
    switched = int(whole.clear.switched[own].sum())
    by_object = {
        "miss_rate": Value(100 * ratio(missed, n), n),
        "idsw": Value(float(switched) if n else np.nan, n),
    }
    if one.false is None:
        no_track = np.zeros(len(whole.gospa.false), dtype=np.bool_)
        gospa = whole.gospa.of(own, no_track).values()
        del gospa["gospa_false"]
        return {**by_object, **gospa, **states}
    wrong = missed + switched + int((whole.false & one.false).sum())
    followed = {
        "hota": Value(_hota(whole, counted, one.false), n),
        "mota": Value(100 * (1 - ratio(wrong, n)), n),
    }
    gospa = whole.gospa.of(own, one.false[kept.tracks]).values()
    return {**followed, **by_object, **gospa, **states}


def _hota(whole: _Matched, counted: BoolArray, false: BoolArray) -> float:
    """HOTA [%] of the counted truth, the tracks on it, and, of those on nothing, some."""
    kept = whole.kept
    if not counted.any():
        return float("nan")
    on_nothing = kept.object_row == UNASSIGNED
    own = kept.tracks & np.where(on_nothing, false, counted[kept.object_row])
    truth, estimates = whole.trace.take(counted), whole.tracks.take(own)
    return 100 * hota(sequence_of(truth, estimates, whole.similarity)).hota_mean
