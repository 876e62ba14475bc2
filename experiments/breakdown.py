"""Truth and tracks into a table of scores by bin: phase, regime, range, level (`experiments.bins`).

Tracks and truth are matched once, all of them; a bin's score is then that of its own rows: its
truth, the tracks on that, and those of the tracks on nothing that belong to the bin. A track on
truth of another bin is ignored, as in Waymo's breakdown. So what bins that share no row count adds
up to the whole.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import polars as pl

from experiments.bins import EVERYTHING, Bin, bins, everything
from experiments.matched import Matched, sequence_of
from experiments.metrics import HotaScores, combine_hota, hota
from experiments.metrics.matching import ratio
from experiments.pairing import UNASSIGNED
from experiments.states import Value
from mdkf.tables import BoolArray

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
"""Columns of `breakdown`. group: as asked for, or all. value: null is "no value". low, high and
verdict are those of `experiments.states.Value`, null for scores that know no consistency. n: what
is behind the value, truth rows (hota to idsw), frames with an object or a track (gospa), or
estimates (states)."""


def breakdown(whole: Matched, groups: Sequence[str]) -> pl.DataFrame:
    """One row for each bin and score: everything first, then the bins of each group, empty ones
    too; a group that is named again is there once.

    groups: of phase, regime, range and level, or products of them, as range,level. Scores: hota,
    assa, mota, miss_rate [%], idsw, and those of `GospaScores.values` and `StateErrors.values`. By
    phase and regime there is no hota, assa, mota or gospa_false, as a track on nothing has no
    phase, and gospa is that of objects alone; in natural occlusions, where no track is asked for,
    there are state errors only.

    Raises `ValueError` for an unknown group, and for a product that names one twice.
    """
    trace, tracks = whole.trace, whole.tracks
    found = [(EVERYTHING, everything(trace, tracks))]
    for group in dict.fromkeys(groups):
        found += [(group, one) for one in bins(trace, tracks, whole.gaps, group)]
    false = whole.false()
    rows = [
        {
            "group": group,
            "bin": one.name,
            "score": score,
            "value": value.value,
            "low": value.low,
            "high": value.high,
            "n": value.n,
            "verdict": value.verdict,
        }
        for group, one in found
        for score, value in _scores(whole, one, false).items()
    ]
    return pl.DataFrame(rows, schema=SCHEMA).with_columns(pl.col(pl.Float64).fill_nan(None))


def _scores(whole: Matched, one: Bin, false: BoolArray) -> Mapping[str, Value]:
    """What of the whole is the bin's; `false` are the tracks' rows that CLEAR leaves on nothing."""
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
    wrong = missed + switched + int((false & one.false).sum())
    overall = _hota(whole, counted, one.false)
    followed = {
        "hota": Value(100 * overall.hota_mean, n),
        "assa": Value(100 * overall.assa_mean, n),
        "mota": Value(100 * (1 - ratio(wrong, n)), n),
    }
    gospa = whole.gospa.of(own, one.false[kept.tracks]).values()
    return {**followed, **by_object, **gospa, **states}


def _hota(whole: Matched, counted: BoolArray, false: BoolArray) -> HotaScores:
    """HOTA of the counted truth, the tracks on it, and, of those on nothing, some; no values
    without such truth."""
    kept = whole.kept
    if not counted.any():
        return combine_hota([])
    on_nothing = kept.object_row == UNASSIGNED
    own = kept.tracks & np.where(on_nothing, false, counted[kept.object_row])
    if np.array_equal(counted, kept.truth) and np.array_equal(own, kept.tracks):
        return hota(whole.sequence)
    return hota(sequence_of(whole.trace, whole.tracks, counted, own, whole.similarity))
