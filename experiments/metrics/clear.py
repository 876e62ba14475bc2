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
from numpy.typing import NDArray

from experiments.metrics.assignment import match_frame
from experiments.metrics.boxes import Ints, Pairs
from experiments.metrics.matching import Sequence, ratio

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


@dataclass(frozen=True, eq=False)
class ClearMatches:
    """What CLEAR matches, row by row and object by object.

    Attributes:
        track_row: (n_truth_rows,) the track row matched to every truth row, -1 for none.
        switched: (n_truth_rows,) whether the match is an identity switch.
        n_matched, n_starts: (n_objects,) matched rows, and their uninterrupted stretches.
        similarity_sum: sum of the matches' similarities.
    """

    track_row: Ints
    switched: NDArray[np.bool_]
    n_matched: Ints
    n_starts: Ints
    similarity_sum: float


def clear(sequence: Sequence, threshold: float = 0.5) -> ClearScores:
    """CLEAR scores of one sequence; a match needs a similarity of at least `threshold`."""
    return clear_of(sequence, clear_matches(sequence, threshold))


def clear_matches(sequence: Sequence, threshold: float = 0.5) -> ClearMatches:
    """The matches that `clear(sequence, threshold)` counts."""
    cut = threshold - _EPSILON
    pairs = sequence.pairs if cut > 0.0 else sequence.every_pair
    # TrackEval passes over frames without truth or without tracks: they interrupt nothing.
    both = (np.diff(sequence.truth_start) > 0) & (np.diff(sequence.track_start) > 0)
    return ClearMatches(
        *_follow(
            np.flatnonzero(both),
            sequence.truth_start,
            sequence.truth,
            sequence.track_start,
            sequence.track,
            pairs,
            cut,
            sequence.n_objects,
        )
    )


def clear_of(sequence: Sequence, matches: ClearMatches) -> ClearScores:
    """CLEAR scores of a sequence that is matched already."""
    fraction = matches.n_matched / np.diff(sequence.object_start)
    tp = int(matches.n_matched.sum())
    mt = int(np.sum(fraction > _MOSTLY_TRACKED))
    pt = int(np.sum(fraction >= _PARTLY_TRACKED)) - mt
    return _scores(
        idsw=int(matches.switched.sum()),
        tp=tp,
        fn=len(sequence.truth) - tp,
        fp=len(sequence.track) - tp,
        mt=mt,
        pt=pt,
        ml=sequence.n_objects - mt - pt,
        frag=int(np.maximum(matches.n_starts - 1, 0).sum()),
        similarity_sum=matches.similarity_sum,
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


@njit(cache=True)
def _follow(
    frames: Ints,
    truth_start: Ints,
    truth: Ints,
    track_start: Ints,
    track: Ints,
    pairs: Pairs,
    cut: float,
    n_objects: int,
) -> tuple[Ints, NDArray[np.bool_], Ints, Ints, float]:
    """Match frame by frame, at similarities of at least `cut`; returns what `ClearMatches` has."""
    matched = np.full(len(truth), -1)
    score = np.zeros(len(pairs.row))
    n_matched, n_starts = np.zeros(n_objects, np.int64), np.zeros(n_objects, np.int64)
    last_track, last_step = np.full(n_objects, -1), np.full(n_objects, -2)
    track_row, switched = np.full(len(truth), -1), np.zeros(len(truth), np.bool_)
    total = 0.0
    for step in range(len(frames)):
        frame = frames[step]
        for row in range(truth_start[frame], truth_start[frame + 1]):
            obj = truth[row]
            expected = last_track[obj] if last_step[obj] == step - 1 else -1
            for k in range(pairs.start[row], pairs.start[row + 1]):
                if pairs.similarity[k] >= cut:
                    continued = track[pairs.row[k]] == expected
                    score[k] = _CONTINUATION * continued + pairs.similarity[k]
        match_frame(frame, truth_start, track_start, pairs, score, matched)
        in_frame = 0.0
        for row in range(truth_start[frame], truth_start[frame + 1]):
            pair = matched[row]
            if pair < 0 or score[pair] <= _EPSILON:
                continue
            obj, index = truth[row], track[pairs.row[pair]]
            n_matched[obj] += 1
            track_row[row] = pairs.row[pair]
            switched[row] = last_track[obj] >= 0 and last_track[obj] != index
            n_starts[obj] += last_step[obj] != step - 1
            last_track[obj], last_step[obj] = index, step
            in_frame += pairs.similarity[pair]
        total += in_frame
    return track_row, switched, n_matched, n_starts, total
