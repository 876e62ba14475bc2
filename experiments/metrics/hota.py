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
from scipy.optimize import linear_sum_assignment

from experiments.metrics.boxes import Floats, Ints
from experiments.metrics.matching import Sequence, TruthRows

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
    rows = sequence.truth_rows
    truth_sum, track_sum, matched, n_rivals = _similarity_sums(
        sequence.truth_start, sequence.track_start, sequence.similarity
    )
    _repeat_sums_as_numpy(sequence, np.flatnonzero(n_rivals > 2), truth_sum, track_sum)
    cost = _assignment_costs(
        rows, sequence.track, sequence.track_count, sequence.similarity, truth_sum, track_sum
    )
    _assign(sequence, np.flatnonzero(n_rivals > 1), cost, matched)
    hits = np.flatnonzero(matched >= 0)
    match_track = np.full(len(matched), -1)
    match_track[hits] = sequence.track[matched[hits]]
    match_similarity = np.zeros(len(matched))
    entry = rows.first_entry + matched - rows.first_track
    match_similarity[hits] = sequence.similarity[entry[hits]]
    # A row counts at the thresholds ALPHAS[:level].
    level = np.zeros(len(matched), np.int64)
    level[hits] = np.searchsorted(ALPHAS - _EPSILON, match_similarity[hits], side="right")
    tp, similarity_sum = _localisation(sequence.truth_start, level, match_similarity)
    association = _association(rows, match_track, level, sequence.track_count)
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


def _repeat_sums_as_numpy(
    sequence: Sequence, frames: Ints, truth_sum: Floats, track_sum: Floats
) -> None:
    """Replace the sums of `frames` by numpy's, whose order of rounding decides TrackEval's ties."""
    for k in frames.tolist():
        matrix = sequence.frame_similarity(k)
        truth_sum[sequence.truth_start[k] : sequence.truth_start[k + 1]] = matrix.sum(1)
        track_sum[sequence.track_start[k] : sequence.track_start[k + 1]] = matrix.sum(0)


def _assign(sequence: Sequence, frames: Ints, cost: Floats, matched: Ints) -> None:
    """Write the track rows of the cheapest assignment of each of `frames` into `matched`."""
    truth_start, track_start = sequence.truth_start.tolist(), sequence.track_start.tolist()
    start = sequence.similarity_start.tolist()
    for k in frames.tolist():
        first, last = truth_start[k], truth_start[k + 1]
        row, column = linear_sum_assignment(cost[start[k] : start[k + 1]].reshape(last - first, -1))
        matched[first:last] = -1
        matched[first + row] = track_start[k] + column


@njit(cache=True)
def _similarity_sums(
    truth_start: Ints, track_start: Ints, similarity: Floats
) -> tuple[Floats, Floats, Ints, Ints]:
    """What each frame's matrix says by itself.

    Returns the sums of its rows (n_truth_rows,) and columns (n_track_rows,), the last track row
    that is similar to each truth row (n_truth_rows,) (-1: none), and the largest number of positive
    similarities in any of its rows and columns (n_frames,). Where that is 1 there is nothing to
    choose: the one similar track is the match. Where it is 2 the sums are still exact in any order.
    """
    n_frames = len(truth_start) - 1
    truth_sum, track_sum = np.zeros(truth_start[-1]), np.zeros(track_start[-1])
    similar = np.full(truth_start[-1], -1)
    n_rivals = np.zeros(n_frames, np.int64)
    n_in_column = np.zeros(track_start[-1], np.int64)
    entry = 0
    for frame in range(n_frames):
        for i in range(truth_start[frame], truth_start[frame + 1]):
            n_in_row = 0
            for j in range(track_start[frame], track_start[frame + 1]):
                value = similarity[entry]
                entry += 1
                if value > 0.0:
                    truth_sum[i] += value
                    track_sum[j] += value
                    similar[i] = j
                    n_in_row += 1
                    n_in_column[j] += 1
                    n_rivals[frame] = max(n_rivals[frame], n_in_row, n_in_column[j])
    return truth_sum, track_sum, similar, n_rivals


@njit(cache=True)
def _assignment_costs(
    rows: TruthRows,
    track: Ints,
    track_count: Ints,
    similarity: Floats,
    truth_sum: Floats,
    track_sum: Floats,
) -> Floats:
    """Minus similarity times global alignment, in the layout of `similarity`.

    Object by object: an object's alignment needs the overlaps of that object only, so one array of
    n_tracks is enough.
    """
    cost = np.zeros(len(similarity))
    overlap = np.zeros(len(track_count))
    for obj in range(len(rows.object_start) - 1):
        own = rows.by_object[rows.object_start[obj] : rows.object_start[obj + 1]]
        for row in own:
            for j in range(rows.n_tracks[row]):
                value = similarity[rows.first_entry[row] + j]
                if value > 0.0:
                    union = track_sum[rows.first_track[row] + j] + truth_sum[row] - value
                    if union > _EPSILON:
                        overlap[track[rows.first_track[row] + j]] += value / union
        for row in own:
            for j in range(rows.n_tracks[row]):
                value = similarity[rows.first_entry[row] + j]
                if value > 0.0:
                    index = track[rows.first_track[row] + j]
                    alignment = overlap[index] / (len(own) + track_count[index] - overlap[index])
                    cost[rows.first_entry[row] + j] = -(alignment * value)
        for row in own:
            overlap[track[rows.first_track[row] : rows.first_track[row] + rows.n_tracks[row]]] = 0.0
    return cost


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
def _association(rows: TruthRows, match_track: Ints, level: Ints, track_count: Ints) -> Floats:
    """(3, 19) sums of association accuracy, recall and precision over the matches."""
    sums = np.zeros((3, _N_ALPHAS))
    count = np.zeros((len(track_count), _N_ALPHAS), np.int64)
    for obj in range(len(rows.object_start) - 1):
        own = rows.by_object[rows.object_start[obj] : rows.object_start[obj + 1]]
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
