"""A `Sequence` into the Identity scores: how much of the truth one track per object explains.

    IDF1 = IDTP / (IDTP + IDFN / 2 + IDFP / 2)

with the one-to-one assignment of objects to tracks, over the whole sequence, that has most matches.
Ristani et al., Performance Measures and a Data Set for Multi-Target, Multi-Camera Tracking, ECCV
workshops 2016.
"""

from __future__ import annotations

from collections.abc import Sequence as ListLike
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.sparse import csr_array
from scipy.sparse.csgraph import min_weight_full_bipartite_matching

from experiments.metrics.boxes import Ints, Pairs
from experiments.metrics.matching import Sequence, ratio


@dataclass(frozen=True)
class IdentityScores:
    """Identity scores of one or more sequences.

    Without truth idr, without tracks idp, and without both idf1 are NaN (TrackEval: 0).

    Attributes:
        idf1, idp, idr: F1, precision and recall of identities.
        idtp: number of rows where an object and the track assigned to it match.
        idfn, idfp: number of all other truth rows, and of all other track rows.
    """

    idf1: float
    idp: float
    idr: float
    idtp: int
    idfn: int
    idfp: int


def identity(sequence: Sequence, threshold: float = 0.5) -> IdentityScores:
    """Identity scores of one sequence; a match is a similarity of at least `threshold`."""
    pairs = sequence.pairs if threshold > 0.0 else sequence.every_pair
    obj, track, count = _common_rows(
        sequence.object_start,
        sequence.object_rows,
        sequence.track,
        sequence.n_tracks,
        pairs,
        threshold,
    )
    idtp = _most_matches(obj, track, count, sequence.n_objects, sequence.n_tracks)
    return _scores(idtp, len(sequence.truth) - idtp, len(sequence.track) - idtp)


def combine_identity(scores: ListLike[IdentityScores]) -> IdentityScores:
    """Scores of several sequences taken together, as TrackEval's `combine_sequences`: counts add.

    Nothing to combine gives counts of 0 and no values.
    """
    return _scores(
        sum(part.idtp for part in scores),
        sum(part.idfn for part in scores),
        sum(part.idfp for part in scores),
    )


def _scores(idtp: int, idfn: int, idfp: int) -> IdentityScores:
    return IdentityScores(
        idf1=ratio(idtp, idtp + 0.5 * idfp + 0.5 * idfn),
        idp=ratio(idtp, idtp + idfp),
        idr=ratio(idtp, idtp + idfn),
        idtp=idtp,
        idfn=idfn,
        idfp=idfp,
    )


def _most_matches(obj: Ints, track: Ints, count: Ints, n_objects: int, n_tracks: int) -> int:
    """Largest sum of `count` over a one-to-one choice of the (obj, track) pairs.

    TrackEval assigns in a dense (n_objects + n_tracks)^2 matrix of false negatives and positives.
    Its total cost is all rows minus twice this sum, so every optimal assignment has the same counts
    and ties need no care; here only pairs that match at all take memory. The solver wants every
    object assigned: each gets a column of its own, which stands for no track.
    """
    if not len(count):
        return 0
    everyone = np.arange(n_objects)
    weight = np.concatenate((count + 1.0, np.ones(n_objects)))
    row = np.concatenate((obj, everyone))
    column = np.concatenate((track, n_tracks + everyone))
    graph = csr_array((weight, (row, column)), shape=(n_objects, n_tracks + n_objects))
    chosen_row, chosen_column = min_weight_full_bipartite_matching(graph, maximize=True)
    return int(graph[chosen_row, chosen_column].sum()) - n_objects


@njit(cache=True)
def _common_rows(
    object_start: Ints,
    object_rows: Ints,
    track: Ints,
    n_tracks: int,
    pairs: Pairs,
    threshold: float,
) -> tuple[Ints, Ints, Ints]:
    """The (object, track) pairs that match anywhere and the number of frames in which they do."""
    objects, tracks, counts = [np.int64(0)], [np.int64(0)], [np.int64(0)]
    count = np.zeros(n_tracks, np.int64)
    for obj in range(len(object_start) - 1):
        own = object_rows[object_start[obj] : object_start[obj + 1]]
        for row in own:
            for k in range(pairs.start[row], pairs.start[row + 1]):
                if pairs.similarity[k] >= threshold:
                    count[track[pairs.row[k]]] += 1
        for row in own:
            for k in range(pairs.start[row], pairs.start[row + 1]):
                index = track[pairs.row[k]]
                if count[index] > 0:
                    objects.append(np.int64(obj))
                    tracks.append(index)
                    counts.append(count[index])
                    count[index] = 0
    # The leading zeros only tell numba the lists' type.
    return np.array(objects)[1:], np.array(tracks)[1:], np.array(counts)[1:]
