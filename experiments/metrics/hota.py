"""A `Sequence` into HOTA: detection, association and localisation at 19 similarity thresholds.

    DetA = |TP| / (|TP| + |FN| + |FP|)
    AssA = 1/|TP| sum_{c in TP} |TPA(c)| / (|TPA(c)| + |FNA(c)| + |FPA(c)|)
    HOTA = sqrt(DetA AssA)

Luiten et al., HOTA: A Higher Order Metric for Evaluating Multi-object Tracking, IJCV 129 (2021).
The matching is TrackEval's: one assignment per frame for all thresholds, of the similarity weighted
by how well object and track are aligned over the whole sequence.
"""

from __future__ import annotations

from collections.abc import Sequence as ListLike
from dataclasses import dataclass

import numpy as np
from numba import njit

from experiments.metrics.assignment import match_frame
from experiments.metrics.boxes import Floats, Ints, Pairs
from experiments.metrics.matching import Sequence

ALPHAS: Floats = np.arange(0.05, 0.99, 0.05)
"""(19,) similarity thresholds 0.05, 0.10, ..., 0.95, rounded as TrackEval's."""
ALPHAS.flags.writeable = False

_N_ALPHAS = len(ALPHAS)
_EPSILON = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False)
class HotaScores:
    """HOTA of one or more sequences; every array is (19,), one value per threshold in `ALPHAS`.

    Where nothing matched (tp 0) the association scores and loca are averages over nothing: NaN
    (TrackEval: 0, and 1 for loca); hota is 0 by the errors alone. Without truth detre, without
    tracks detpr, and without both deta and hota are NaN as well (TrackEval: 0). A mean over the
    thresholds is NaN if one has no value: it equals TrackEval's or is missing, and never compares
    different thresholds for different trackers.

    Attributes:
        hota, deta, assa: the score and its detection and association parts.
        detre, detpr: recall and precision of detection.
        assre, asspr: recall and precision of association.
        loca: mean similarity of the matches.
        tp, fn, fp: number of matches, of missed truth rows, of superfluous track rows.
    """

    hota: Floats
    deta: Floats
    assa: Floats
    detre: Floats
    detpr: Floats
    assre: Floats
    asspr: Floats
    loca: Floats
    tp: Ints
    fn: Ints
    fp: Ints

    @property
    def hota_mean(self) -> float:
        """Mean of `hota` over the thresholds: the number called HOTA."""
        return float(np.mean(self.hota))

    @property
    def deta_mean(self) -> float:
        """Mean of `deta` over the thresholds."""
        return float(np.mean(self.deta))

    @property
    def assa_mean(self) -> float:
        """Mean of `assa` over the thresholds; NaN if one has no match."""
        return float(np.mean(self.assa))

    @property
    def detre_mean(self) -> float:
        """Mean of `detre` over the thresholds."""
        return float(np.mean(self.detre))

    @property
    def detpr_mean(self) -> float:
        """Mean of `detpr` over the thresholds."""
        return float(np.mean(self.detpr))

    @property
    def assre_mean(self) -> float:
        """Mean of `assre` over the thresholds; NaN if nothing matched at one of them."""
        return float(np.mean(self.assre))

    @property
    def asspr_mean(self) -> float:
        """Mean of `asspr` over the thresholds; NaN if nothing matched at one of them."""
        return float(np.mean(self.asspr))

    @property
    def loca_mean(self) -> float:
        """Mean of `loca` over the thresholds; NaN if nothing matched at one of them."""
        return float(np.mean(self.loca))


def hota(sequence: Sequence) -> HotaScores:
    """HOTA of one sequence, with TrackEval's matching."""
    pairs = sequence.pairs
    score = _alignment_scores(
        sequence.object_start,
        sequence.object_rows,
        sequence.track,
        sequence.track_count,
        pairs,
        *similarity_sums(sequence.truth_start, sequence.track_start, pairs),
    )
    matched = _match(sequence.truth_start, sequence.track_start, pairs, score)
    hits = np.flatnonzero(matched >= 0)
    match_track = np.full(len(matched), -1)
    match_track[hits] = sequence.track[pairs.row[matched[hits]]]
    match_similarity = np.zeros(len(matched))
    match_similarity[hits] = pairs.similarity[matched[hits]]
    # A row counts at the thresholds ALPHAS[:level].
    level = np.zeros(len(matched), np.int64)
    level[hits] = np.searchsorted(ALPHAS - _EPSILON, match_similarity[hits], side="right")
    tp, similarity_sum = _localisation(sequence.truth_start, level, match_similarity)
    association = _association(
        sequence.object_start, sequence.object_rows, match_track, level, sequence.track_count
    )
    return _scores(
        tp, len(sequence.truth) - tp, len(sequence.track) - tp, association, similarity_sum
    )


def combine_hota(scores: ListLike[HotaScores]) -> HotaScores:
    """HOTA of several sequences taken together, as TrackEval's `combine_sequences`.

    Counts add; association scores and loca are averaged by matches. Nothing gives no values.
    """
    counts = np.zeros((3, _N_ALPHAS), np.int64)
    association = np.zeros((3, _N_ALPHAS))
    similarity_sum = np.zeros(_N_ALPHAS)
    for part in scores:
        counts += np.stack((part.tp, part.fn, part.fp))
        averages = np.stack((part.assa, part.assre, part.asspr, part.loca))
        sums = np.where(part.tp > 0, averages * part.tp, 0.0)
        association += sums[:3]
        similarity_sum += sums[3]
    return _scores(counts[0], counts[1], counts[2], association, similarity_sum)


def _scores(
    tp: Ints, fn: Ints, fp: Ints, association: Floats, similarity_sum: Floats
) -> HotaScores:
    """Scores from counts and sums over the matches; `association` is (3, 19): A, Re, Pr."""
    deta = _ratios(tp, tp + fn + fp)
    assa, assre, asspr = (_ratios(total, tp) for total in association)
    return HotaScores(
        hota=np.sqrt(deta * np.where(tp > 0, assa, 0.0)),
        deta=deta,
        assa=assa,
        detre=_ratios(tp, tp + fn),
        detpr=_ratios(tp, tp + fp),
        assre=assre,
        asspr=asspr,
        loca=_ratios(similarity_sum, tp),
        tp=tp,
        fn=fn,
        fp=fp,
    )


def _ratios(numerator: Floats | Ints, denominator: Ints) -> Floats:
    values = np.full(_N_ALPHAS, np.nan)
    np.divide(numerator, denominator, out=values, where=denominator > 0)
    return values


@njit(cache=True)
def similarity_sums(truth_start: Ints, track_start: Ints, pairs: Pairs) -> tuple[Floats, Floats]:
    """Sums of each frame's matrix: of its rows (n_truth_rows,) and of its columns (n_track_rows,).

    Added in numpy's order: between interchangeable tracks only rounding decides which is matched.
    """
    truth_sum, track_sum = np.zeros(truth_start[-1]), np.zeros(track_start[-1])
    for frame in range(len(truth_start) - 1):
        first, last = truth_start[frame], truth_start[frame + 1]
        first_track, n_tracks = track_start[frame], track_start[frame + 1] - track_start[frame]
        for i in range(first, last):
            begin, end = pairs.start[i], pairs.start[i + 1]
            for k in range(begin, end):
                truth_sum[i] += pairs.similarity[k]
                # Columns are added up row by row ...
                track_sum[pairs.row[k]] += pairs.similarity[k]
            if end - begin > 2:  # of two numbers the order does not matter
                column = pairs.row[begin:end] - first_track
                truth_sum[i] = _sum_as_numpy(column, pairs.similarity[begin:end], n_tracks)
        if n_tracks == 1:
            # ... but for one column alone, which lies in memory like a row.
            row = np.flatnonzero(np.diff(pairs.start[first : last + 1]))
            value = pairs.similarity[pairs.start[first] : pairs.start[last]]
            track_sum[first_track] = _sum_as_numpy(row, value, last - first)
    return truth_sum, track_sum


@njit(cache=True)
def _sum_as_numpy(place: Ints, value: Floats, n: int) -> float:
    """The sum of an array of n numbers rounded as numpy's: pairwise, in blocks of at most 128.

    place: rising indices of the numbers that are not 0; value: those numbers.
    """
    if len(value) == 0:
        return 0.0
    if n > 128:
        half = n // 2 - n // 2 % 8
        split = np.searchsorted(place, half)
        head = _sum_as_numpy(place[:split], value[:split], half)
        return float(head + _sum_as_numpy(place[split:] - half, value[split:], n - half))
    # Eight partial sums of every eighth number, then what eight does not divide.
    part = np.zeros(8)
    in_parts = n - n % 8 if n >= 8 else 0
    k = 0
    while k < len(place) and place[k] < in_parts:
        part[place[k] % 8] += value[k]
        k += 1
    total = (part[0] + part[1] + (part[2] + part[3])) + (part[4] + part[5] + (part[6] + part[7]))
    for rest in value[k:]:
        total += rest
    return float(total)


@njit(cache=True)
def _alignment_scores(
    object_start: Ints,
    object_rows: Ints,
    track: Ints,
    track_count: Ints,
    pairs: Pairs,
    truth_sum: Floats,
    track_sum: Floats,
) -> Floats:
    """(n_pairs,) similarity times global alignment.

    Object by object: an object's alignment needs the overlaps of that object only, so one array of
    n_tracks is enough.
    """
    score = np.zeros(len(pairs.row))
    overlap = np.zeros(len(track_count))
    for obj in range(len(object_start) - 1):
        own = object_rows[object_start[obj] : object_start[obj + 1]]
        for row in own:
            for k in range(pairs.start[row], pairs.start[row + 1]):
                value = pairs.similarity[k]
                union = track_sum[pairs.row[k]] + truth_sum[row] - value
                if union > _EPSILON:
                    overlap[track[pairs.row[k]]] += value / union
        for row in own:
            for k in range(pairs.start[row], pairs.start[row + 1]):
                index = track[pairs.row[k]]
                alignment = overlap[index] / (len(own) + track_count[index] - overlap[index])
                score[k] = alignment * pairs.similarity[k]
        for row in own:
            for k in range(pairs.start[row], pairs.start[row + 1]):
                overlap[track[pairs.row[k]]] = 0.0
    return score


@njit(cache=True)
def _match(truth_start: Ints, track_start: Ints, pairs: Pairs, score: Floats) -> Ints:
    """(n_truth_rows,) the pair that each truth row is matched in, -1 for none."""
    matched = np.full(truth_start[-1], -1)
    for frame in range(len(truth_start) - 1):
        match_frame(frame, truth_start, track_start, pairs, score, matched)
    return matched


@njit(cache=True)
def _localisation(truth_start: Ints, level: Ints, similarity: Floats) -> tuple[Ints, Floats]:
    """Number of matches and sum of their similarities at each threshold."""
    tp = np.zeros(_N_ALPHAS, np.int64)
    total = np.zeros(_N_ALPHAS)
    for frame in range(len(truth_start) - 1):
        in_frame = np.zeros(_N_ALPHAS)
        for row in range(truth_start[frame], truth_start[frame + 1]):
            for a in range(level[row]):
                tp[a] += 1
                in_frame[a] += similarity[row]
        total += in_frame
    return tp, total


@njit(cache=True)
def _association(
    object_start: Ints, object_rows: Ints, match_track: Ints, level: Ints, track_count: Ints
) -> Floats:
    """(3, 19) sums of association accuracy, recall and precision over the matches."""
    sums = np.zeros((3, _N_ALPHAS))
    count = np.zeros((len(track_count), _N_ALPHAS), np.int64)
    for obj in range(len(object_start) - 1):
        own = object_rows[object_start[obj] : object_start[obj + 1]]
        for row in own:
            for a in range(level[row]):
                count[match_track[row], a] += 1
        for row in own:
            index = match_track[row]
            for a in range(level[row]):
                n = count[index, a]
                # Cleared at the pair's first row, so that each pair is counted once.
                count[index, a] = 0
                if n > 0:
                    sums[0, a] += n * (n / (len(own) + track_count[index] - n))
                    sums[1, a] += n * (n / len(own))
                    sums[2, a] += n * (n / track_count[index])
    return sums
