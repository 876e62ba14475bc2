"""A `Sequence` into the CLEAR scores: misses, false alarms and identity switches, frame by frame.

    MOTA = (|TP| - |FP| - |IDSW|) / (|TP| + |FN|)

Bernardin and Stiefelhagen, Evaluating Multiple Object Tracking Performance: The CLEAR MOT Metrics,
EURASIP J. Image and Video Processing (2008); mostly tracked, partly tracked and mostly lost after
Li, Huang and Nevatia, CVPR 2009. The matching is TrackEval's: first continue the last frame's
matches, then maximise similarity.
"""

from __future__ import annotations

from collections.abc import Sequence as ListLike
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.optimize import linear_sum_assignment

from experiments.metrics.boxes import Floats, Ints
from experiments.metrics.matching import Sequence, TruthRows, ratio

_CONTINUATION = 1000.0
"""Reward of continuing a match, in units of similarity: more than any frame's similarities sum to
in practice, and TrackEval's."""

_MOSTLY_TRACKED = 0.8
_PARTLY_TRACKED = 0.2
"""Fractions of an object's rows that are matched: above, and from which on."""

_COUNTS = ("idsw", "tp", "fn", "fp", "mt", "pt", "ml", "frag")

_EPSILON = float(np.finfo(np.float64).eps)


@dataclass(frozen=True)
class ClearScores:
    """CLEAR scores of one or more sequences.

    Without truth mota and recall, without tracks precision, and without matches motp are NaN
    (TrackEval: 0).

    Attributes:
        mota: 1 minus misses, false alarms and switches per truth row; may be negative.
        motp: mean similarity of the matches.
        recall, precision: matches per truth row, and per track row.
        idsw: number of matches to another track than the object's last match.
        tp, fn, fp: number of matches, of missed truth rows, of superfluous track rows.
        mt, pt, ml: number of objects mostly tracked (matched in more than 80 % of their rows),
            partly tracked (at least 20 %), and mostly lost.
        frag: number of times an object's coverage resumes after an interruption.
        similarity_sum: sum of the matches' similarities, for combining sequences.
    """

    mota: float
    motp: float
    recall: float
    precision: float
    idsw: int
    tp: int
    fn: int
    fp: int
    mt: int
    pt: int
    ml: int
    frag: int
    similarity_sum: float


def clear(sequence: Sequence, threshold: float = 0.5) -> ClearScores:
    """CLEAR scores of one sequence; a match needs a similarity of at least `threshold`."""
    # TrackEval passes over frames without truth or without tracks: they interrupt nothing.
    frames = np.flatnonzero(np.diff(sequence.similarity_start))
    matched = _match_frames(sequence, frames, threshold - _EPSILON)
    n_matched, n_starts, idsw, similarity_sum = _histories(
        frames,
        sequence.truth_start,
        sequence.truth,
        sequence.track,
        sequence.truth_rows,
        sequence.similarity,
        matched,
        sequence.n_objects,
    )
    fraction = n_matched / np.diff(sequence.truth_rows.object_start)
    tp = int(n_matched.sum())
    mt = int(np.sum(fraction > _MOSTLY_TRACKED))
    pt = int(np.sum(fraction >= _PARTLY_TRACKED)) - mt
    return _scores(
        idsw=int(idsw),
        tp=tp,
        fn=len(sequence.truth) - tp,
        fp=len(sequence.track) - tp,
        mt=mt,
        pt=pt,
        ml=sequence.n_objects - mt - pt,
        frag=int(np.maximum(n_starts - 1, 0).sum()),
        similarity_sum=similarity_sum,
    )


def combine_clear(scores: ListLike[ClearScores]) -> ClearScores:
    """Scores of several sequences together, as TrackEval's `combine_sequences`: counts add."""
    counts = {name: sum(getattr(part, name) for part in scores) for name in _COUNTS}
    return _scores(similarity_sum=sum((part.similarity_sum for part in scores), 0.0), **counts)


def _scores(
    idsw: int,
    tp: int,
    fn: int,
    fp: int,
    mt: int,
    pt: int,
    ml: int,
    frag: int,
    similarity_sum: float,
) -> ClearScores:
    return ClearScores(
        mota=ratio(tp - fp - idsw, tp + fn),
        motp=ratio(similarity_sum, tp),
        recall=ratio(tp, tp + fn),
        precision=ratio(tp, tp + fp),
        idsw=idsw,
        tp=tp,
        fn=fn,
        fp=fp,
        mt=mt,
        pt=pt,
        ml=ml,
        frag=frag,
        similarity_sum=similarity_sum,
    )


def _match_frames(sequence: Sequence, frames: Ints, cut: float) -> Ints:
    """(n_truth_rows,) the track row matched to every truth row, -1 for none."""
    matched = np.full(len(sequence.truth), -1)
    last_track = np.full(sequence.n_objects, -1)
    last_step = np.full(sequence.n_objects, -2)
    truth_start = sequence.truth_start[frames].tolist()
    track_start = sequence.track_start[frames].tolist()
    step = 0
    while True:
        step, cost = _match_until_rivals(
            step,
            frames,
            sequence.truth_start,
            sequence.truth,
            sequence.track_start,
            sequence.track,
            sequence.similarity_start,
            sequence.similarity,
            cut,
            matched,
            last_track,
            last_step,
        )
        if step == len(frames):
            return matched
        row, column = linear_sum_assignment(cost)
        _accept(
            step,
            truth_start[step],
            track_start[step],
            row,
            column,
            cost,
            sequence.truth,
            sequence.track,
            matched,
            last_track,
            last_step,
        )
        step += 1


@njit(cache=True)
def _accept(
    step: int,
    first: int,
    first_track: int,
    row: Ints,
    column: Ints,
    cost: Floats,
    truth: Ints,
    track: Ints,
    matched: Ints,
    last_track: Ints,
    last_step: Ints,
) -> None:
    """Write the rewarded ones of a frame's pairs (row, column) into the last three arrays."""
    for pair in range(len(row)):
        i, j = row[pair], column[pair]
        if cost[i, j] < -_EPSILON:
            matched[first + i] = first_track + j
            last_track[truth[first + i]] = track[first_track + j]
            last_step[truth[first + i]] = step


@njit(cache=True)
def _match_until_rivals(
    step: int,
    frames: Ints,
    truth_start: Ints,
    truth: Ints,
    track_start: Ints,
    track: Ints,
    similarity_start: Ints,
    similarity: Floats,
    cut: float,
    matched: Ints,
    last_track: Ints,
    last_step: Ints,
) -> tuple[int, Floats]:
    """Match frames from `frames[step]` on, up to the first where tracks or objects are rivals.

    Without rivals there is nothing to choose. Returns the step that needs an assignment and its
    (objects, tracks) costs: minus the similarity and minus the reward of continuing a match.
    """
    while step < len(frames):
        frame = frames[step]
        first, last = truth_start[frame], truth_start[frame + 1]
        first_track, n_tracks = track_start[frame], track_start[frame + 1] - track_start[frame]
        cost = np.zeros((last - first, n_tracks))
        row, column, n_pairs = np.empty(last - first, np.int64), np.empty(last - first, np.int64), 0
        n_in_column = np.zeros(n_tracks, np.int64)
        n_rivals = 0
        entry = similarity_start[frame]
        for i in range(last - first):
            n_in_row = 0
            obj = truth[first + i]
            expected = last_track[obj] if last_step[obj] == step - 1 else -1
            for j in range(n_tracks):
                value = similarity[entry]
                entry += 1
                if value >= cut:
                    if track[first_track + j] == expected:
                        value += _CONTINUATION
                    cost[i, j] = -value
                    if n_in_row == 0:
                        row[n_pairs], column[n_pairs] = i, j
                        n_pairs += 1
                    n_in_row += 1
                    n_in_column[j] += 1
                    n_rivals = max(n_rivals, n_in_row, n_in_column[j])
        if n_rivals > 1:
            return step, cost
        row, column = row[:n_pairs], column[:n_pairs]
        _accept(
            step,
            first,
            first_track,
            row,
            column,
            cost,
            truth,
            track,
            matched,
            last_track,
            last_step,
        )
        step += 1
    return step, np.zeros((0, 0))


@njit(cache=True)
def _histories(
    frames: Ints,
    truth_start: Ints,
    truth: Ints,
    track: Ints,
    rows: TruthRows,
    similarity: Floats,
    matched: Ints,
    n_objects: int,
) -> tuple[Ints, Ints, int, float]:
    """Per object its matched rows and uninterrupted stretches; then switches and similarities."""
    n_matched = np.zeros(n_objects, np.int64)
    n_starts = np.zeros(n_objects, np.int64)
    last_track = np.full(n_objects, -1)
    last_step = np.full(n_objects, -2)
    idsw = 0
    total = 0.0
    for step in range(len(frames)):
        in_frame = 0.0
        for row in range(truth_start[frames[step]], truth_start[frames[step] + 1]):
            if matched[row] < 0:
                continue
            obj, index = truth[row], track[matched[row]]
            n_matched[obj] += 1
            idsw += last_track[obj] >= 0 and last_track[obj] != index
            n_starts[obj] += last_step[obj] != step - 1
            last_track[obj] = index
            last_step[obj] = step
            in_frame += similarity[rows.first_entry[row] + matched[row] - rows.first_track[row]]
        total += in_frame
    return n_matched, n_starts, idsw, total
