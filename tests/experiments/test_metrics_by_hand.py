"""Scores of sequences small enough to score by hand; the derivation stands in each docstring."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.metrics import (
    HotaScores,
    Sequence,
    clear,
    combine_clear,
    combine_hota,
    combine_identity,
    hota,
    identity,
    sequence_from_rows,
)

N_FRAMES = 10
APART = 100.0  # [m] between objects: no track is near two of them

Row = tuple[int, int, float]
"""(frame, id, x [m])"""


def sequence(truth: list[Row], tracks: list[Row], n_frames: int = N_FRAMES) -> Sequence:
    def columns(rows: list[Row]) -> tuple[list[int], list[int], np.ndarray]:
        xy = np.array([(x, 0.0) for _, _, x in rows]).reshape(-1, 2)
        return [frame for frame, _, _ in rows], [identity for _, identity, _ in rows], xy

    return sequence_from_rows(*columns(truth), *columns(tracks), n_frames)


def still(identity: int, x: float, frames: range = range(N_FRAMES)) -> list[Row]:
    return [(frame, identity, x) for frame in frames]


def test_an_identity_swap_halfway() -> None:
    """Two objects, two exact tracks that change places after 5 of 10 frames.

    Every row matches: DetA 1. Each match shares 5 frames with its pair, whose object and track have
    5 others each: 5 / (5 + 5 + 5) = 1/3, so HOTA = sqrt(1/3); recall and precision 5/10. Both
    objects switch once: MOTA = (20 - 0 - 2) / 20 = 0.9. One track per object explains 5 + 5 of
    20 rows: IDF1 = 10 / (10 + 5 + 5) = 1/2.
    """
    swapped = sequence(
        still(1, 0.0) + still(2, APART),
        still(1, 0.0, range(5))
        + still(2, APART, range(5))
        + still(1, APART, range(5, 10))
        + still(2, 0.0, range(5, 10)),
    )
    scores = hota(swapped)
    assert scores.deta_mean == 1.0
    assert scores.assa_mean == pytest.approx(1 / 3, abs=1e-15)
    assert scores.hota_mean == pytest.approx(3**-0.5, abs=1e-15)
    assert (scores.assre_mean, scores.asspr_mean) == (0.5, 0.5)
    frames = clear(swapped)
    assert (frames.idsw, frames.mota, frames.mt, frames.frag) == (2, 0.9, 2, 0)
    ids = identity(swapped)
    assert (ids.idtp, ids.idfn, ids.idfp, ids.idf1) == (10, 10, 10, 0.5)


def test_a_half_covered_object() -> None:
    """One object, an exact track in 5 of its 10 frames.

    TP 5, FN 5, FP 0: DetA = 1/2, MOTA = 1/2. Each match: 5 / (5 + 5 + 0) = 1/2, so HOTA = 1/2.
    IDF1 = 5 / (5 + 5/2) = 2/3. Matched in half its rows the object is partly tracked.
    """
    half = sequence(still(1, 0.0), still(9, 0.0, range(5)))
    scores = hota(half)
    assert scores.hota_mean == pytest.approx(0.5, abs=1e-15)
    assert (scores.detre_mean, scores.detpr_mean) == (0.5, 1.0)
    assert (scores.assre_mean, scores.asspr_mean) == (0.5, 1.0)
    frames = clear(half)
    assert (frames.mota, frames.recall, frames.precision) == (0.5, 0.5, 1.0)
    assert (frames.mt, frames.pt, frames.ml) == (0, 1, 0)
    ids = identity(half)
    assert ids.idf1 == pytest.approx(2 / 3, abs=1e-15)
    assert (ids.idp, ids.idr) == (1.0, 0.5)


def test_a_constant_offset_costs_the_strict_thresholds() -> None:
    """A track 0.5 m beside its object: similarity 1 - 0.5/2 = 0.75.

    It matches at the 15 thresholds up to 0.75 with HOTA 1 and at the other 4 not at all: 15/19.
    There LocA has no value, and neither has its mean.
    """
    beside = sequence(still(1, 0.0), still(1, 0.5))
    scores = hota(beside)
    np.testing.assert_array_equal(scores.tp, [N_FRAMES] * 15 + [0] * 4)
    np.testing.assert_array_equal(scores.hota, [1.0] * 15 + [0.0] * 4)
    assert scores.hota_mean == pytest.approx(15 / 19, abs=1e-15)
    np.testing.assert_array_equal(scores.loca, [0.75] * 15 + [np.nan] * 4)
    assert np.isnan(scores.loca_mean)
    assert clear(beside).motp == 0.75


def test_an_interruption_is_a_fragment_and_not_a_switch() -> None:
    """Track 1 misses frames 3 to 5 of its object and resumes: one fragment, no switch.

    TP 10 + 7, FN 3: MOTA = 17/20; matched in 7 of 10 rows, object 1 is partly tracked.
    """
    rows = still(1, 0.0) + still(2, APART)
    tracks = still(1, 0.0, range(3)) + still(1, 0.0, range(6, 10)) + still(2, APART)
    scores = clear(sequence(rows, tracks))
    assert (scores.frag, scores.idsw, scores.mota) == (1, 0, 0.85)
    assert (scores.mt, scores.pt, scores.ml) == (1, 1, 0)


def test_a_frame_without_any_track_interrupts_nothing() -> None:
    """As above without object 2: frames 3 to 5 have no tracks at all and TrackEval skips them."""
    tracks = still(1, 0.0, range(3)) + still(1, 0.0, range(6, 10))
    assert clear(sequence(still(1, 0.0), tracks)).frag == 0


def test_a_match_is_continued_although_another_track_is_closer() -> None:
    """Track 1 at 0.4 m holds the object against track 2, exact from frame 5 on: no switch.

    10 matches of similarity 0.8; track 2's 5 rows are superfluous: MOTA = (10 - 5) / 10.
    """
    scores = clear(sequence(still(1, 0.0), still(1, 0.4) + still(2, 0.0, range(5, 10))))
    assert (scores.idsw, scores.fp, scores.mota) == (0, 5, 0.5)
    assert scores.motp == pytest.approx(0.8, abs=1e-15)


NO_TRUTH = sequence([], still(1, 0.0))
NO_TRACKS = sequence(still(1, 0.0), [])
NOTHING = sequence([], [])


def values(scores: HotaScores) -> list[float]:
    return [scores.hota_mean, scores.deta_mean, scores.detre_mean, scores.detpr_mean]


@pytest.mark.parametrize(
    ("empty", "detection"),
    [(NO_TRUTH, [0, 0, np.nan, 0]), (NO_TRACKS, [0, 0, 0, np.nan]), (NOTHING, [np.nan] * 4)],
    ids=["no truth", "no tracks", "nothing"],
)
def test_an_average_over_nothing_has_no_value(empty: Sequence, detection: list[float]) -> None:
    """0 says "all wrong", NaN "nothing to judge": 10 false alarms are wrong, recall of 0 rows not.

    Nothing matches in any of them, so association and localisation have no value.
    """
    scores = hota(empty)
    np.testing.assert_array_equal(values(scores), detection)
    for average in (scores.assa, scores.assre, scores.asspr, scores.loca):
        assert np.isnan(average).all()


def test_clear_and_identity_without_truth_or_tracks() -> None:
    """Misses of 10 rows: MOTA (0 - 0 - 0) / 10 = 0. False alarms without truth: no MOTA at all."""
    missed, alarms, nothing = clear(NO_TRACKS), clear(NO_TRUTH), clear(NOTHING)
    assert (missed.mota, missed.recall, missed.fn, missed.ml) == (0.0, 0.0, 10, 1)
    assert np.isnan([missed.precision, missed.motp]).all()
    assert (alarms.precision, alarms.fp, alarms.ml) == (0.0, 10, 0)
    assert np.isnan([alarms.mota, alarms.recall, alarms.motp]).all()
    assert np.isnan([nothing.mota, nothing.recall, nothing.precision, nothing.motp]).all()
    assert (identity(NO_TRACKS).idf1, identity(NO_TRACKS).idr) == (0.0, 0.0)
    assert np.isnan(identity(NO_TRACKS).idp)
    assert (identity(NO_TRUTH).idf1, identity(NO_TRUTH).idp) == (0.0, 0.0)
    assert np.isnan(identity(NO_TRUTH).idr)
    assert np.isnan(identity(NOTHING).idf1)


def test_combining_nothing_has_no_value() -> None:
    """No sequences: counts of 0, and nothing to average."""
    assert np.isnan(combine_hota([]).hota).all()
    assert not combine_hota([]).tp.any()
    assert np.isnan(combine_clear([]).mota)
    assert np.isnan(combine_identity([]).idf1)


def test_combining_one_changes_nothing() -> None:
    """A sequence alone is its own combination."""
    one = sequence(still(1, 0.0) + still(2, APART), still(1, 0.5) + still(2, APART, range(3)))
    alone, combined = hota(one), combine_hota([hota(one)])
    for name in ("hota", "deta", "assa", "detre", "detpr", "assre", "asspr", "loca", "tp"):
        np.testing.assert_allclose(getattr(combined, name), getattr(alone, name), atol=1e-15)
    assert combine_clear([clear(one)]) == clear(one)
    assert combine_identity([identity(one)]) == identity(one)
