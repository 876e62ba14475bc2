"""HOTA, CLEAR and Identity are TrackEval's wherever they have a value; the rest is said here.

TrackEval 1.3.0 runs unchanged on numpy 2. Where a denominator is empty it returns 0 (loca: 1);
ours is NaN there. `no_value` puts that NaN into TrackEval's answer, case by case, so that the
comparison states every difference between the two.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from trackeval.metrics import CLEAR, HOTA, Identity

from experiments.metrics import (
    ALPHAS,
    ClearScores,
    HotaScores,
    IdentityScores,
    Sequence,
    clear,
    combine_clear,
    combine_hota,
    combine_identity,
    hota,
    identity,
    sequence_from_matrices,
    sequence_from_rows,
)

TOLERANCE = 1e-12


def oracle(metric: type, threshold: float = 0.5) -> Any:
    return metric({"THRESHOLD": threshold, "PRINT_CONFIG": False})


def as_trackeval(sequence: Sequence) -> dict[str, Any]:
    """The dictionary TrackEval's datasets hand to `eval_sequence`."""
    frames = range(sequence.n_frames)
    return {
        "num_timesteps": sequence.n_frames,
        "num_gt_dets": len(sequence.truth),
        "num_tracker_dets": len(sequence.track),
        "num_gt_ids": sequence.n_objects,
        "num_tracker_ids": sequence.n_tracks,
        "gt_ids": np.split(sequence.truth, sequence.truth_start[1:-1]),
        "tracker_ids": np.split(sequence.track, sequence.track_start[1:-1]),
        "similarity_scores": [sequence.frame_similarity(k).copy() for k in frames],
    }


def no_value(score: Any, denominator: Any) -> Any:
    """TrackEval's score, NaN where what it was divided by is 0."""
    return np.where(np.asarray(denominator) > 0, score, np.nan)


def assert_hota_agrees(ours: HotaScores, theirs: dict[str, Any]) -> None:
    tp, fn, fp = (np.asarray(theirs[f"HOTA_{name}"]) for name in ("TP", "FN", "FP"))
    assert_array_equal(ours.tp, tp)
    assert_array_equal(ours.fn, fn)
    assert_array_equal(ours.fp, fp)
    denominators = {
        "HOTA": tp + fn + fp,
        "DetA": tp + fn + fp,
        "DetRe": tp + fn,
        "DetPr": tp + fp,
        "AssA": tp,
        "AssRe": tp,
        "AssPr": tp,
        "LocA": tp,
    }
    for name, denominator in denominators.items():
        expected = no_value(theirs[name], denominator)
        mine = getattr(ours, name.lower())
        assert_allclose(mine, expected, rtol=0, atol=TOLERANCE, err_msg=name)
        mean = getattr(ours, f"{name.lower()}_mean")
        assert_allclose(mean, np.mean(expected), rtol=0, atol=TOLERANCE, err_msg=name)


def assert_clear_agrees(ours: ClearScores, theirs: dict[str, Any]) -> None:
    for name in ("TP", "FN", "FP"):
        assert getattr(ours, name.lower()) == theirs[f"CLR_{name}"], name
    for name in ("IDSW", "MT", "PT", "ML", "Frag"):
        assert getattr(ours, name.lower()) == theirs[name], name
    expected = [
        no_value(theirs["MOTA"], ours.tp + ours.fn),
        no_value(theirs["MOTP"], ours.tp),
        no_value(theirs["CLR_Re"], ours.tp + ours.fn),
        no_value(theirs["CLR_Pr"], ours.tp + ours.fp),
    ]
    mine = [ours.mota, ours.motp, ours.recall, ours.precision]
    assert_allclose(mine, expected, rtol=0, atol=TOLERANCE)


def assert_identity_agrees(ours: IdentityScores, theirs: dict[str, Any]) -> None:
    for name in ("IDTP", "IDFN", "IDFP"):
        assert getattr(ours, name.lower()) == theirs[name], name
    expected = [
        no_value(theirs["IDF1"], ours.idtp + ours.idfn + ours.idfp),
        no_value(theirs["IDP"], ours.idtp + ours.idfp),
        no_value(theirs["IDR"], ours.idtp + ours.idfn),
    ]
    assert_allclose([ours.idf1, ours.idp, ours.idr], expected, rtol=0, atol=TOLERANCE)


def assert_all_agree(sequence: Sequence, threshold: float = 0.5) -> None:
    data = as_trackeval(sequence)
    assert_hota_agrees(hota(sequence), HOTA().eval_sequence(data))
    assert_clear_agrees(clear(sequence, threshold), oracle(CLEAR, threshold).eval_sequence(data))
    assert_identity_agrees(
        identity(sequence, threshold), oracle(Identity, threshold).eval_sequence(data)
    )


def random_traffic(rng: np.random.Generator, *, tied: bool) -> Sequence:
    """Objects that come and go, and tracks with everything that goes wrong with tracks.

    Missed frames, noise, clutter, identity switches, two tracks on one object, and frames without
    truth or tracks. `tied` rounds positions to a half-metre grid, so that distances coincide.
    """
    n_frames = int(rng.choice([1, 2, 10, 40]))
    n_objects = int(rng.integers(0, 14))
    side = rng.choice([2.0, 6.0, 60.0])  # [m] crowded to sparse
    begin = rng.integers(0, n_frames, n_objects)
    end = rng.integers(begin + 1, n_frames + 1)
    frame = np.concatenate([np.zeros(0, int), *map(np.arange, begin, end)])
    obj = np.repeat(np.arange(n_objects), end - begin)
    speed = rng.normal(0.0, rng.choice([0.0, 0.3]), (n_objects, 2))  # [m/frame]
    xy = rng.uniform(0.0, side, (n_objects, 2))[obj] + speed[obj] * frame[:, None]

    copies = 1 + (rng.random() < 0.3)
    track_frame = np.tile(frame, copies)
    track_id = np.concatenate([obj + 1000 * copy for copy in range(copies)])
    for switch in rng.integers(0, n_frames, rng.integers(0, 4)):
        after = track_frame >= switch
        track_id[after] = rng.permutation(2000)[track_id[after]]
    track_xy = np.tile(xy, (copies, 1)) + rng.normal(
        0.0, rng.choice([0.0, 0.1, 0.5]), (len(track_frame), 2)
    )
    kept = rng.random(len(track_frame)) < rng.choice([0.5, 0.9, 1.0])
    clutter = rng.integers(0, 20)
    track_frame = np.concatenate([track_frame[kept], rng.integers(0, n_frames, clutter)])
    track_id = np.concatenate([track_id[kept], 5000 + np.arange(clutter)])
    track_xy = np.concatenate([track_xy[kept], rng.uniform(0.0, side, (clutter, 2))])

    blind, bare = (rng.random((2, n_frames)) < 0.1) * (rng.random((2, 1)) < 0.5)
    seen, shown = ~blind[track_frame], ~bare[frame]
    if tied:
        xy, track_xy = np.round(2 * xy) / 2, np.round(2 * track_xy) / 2
    return sequence_from_rows(
        frame[shown], obj[shown], xy[shown],
        track_frame[seen], track_id[seen], track_xy[seen],
        n_frames,
    )  # fmt: skip


def from_matrices(truth: list[list[int]], track: list[list[int]], values: Any) -> Sequence:
    """A sequence with given ids per frame, whose similarities are drawn by `values(n)`."""
    shapes = [(len(a), len(b)) for a, b in zip(truth, track, strict=True)]
    sizes = [n * m for n, m in shapes]
    flat = np.asarray(values(sum(sizes)), dtype=np.float64)
    parts = np.split(flat, np.cumsum(sizes)[:-1])
    matrices = [part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)]
    return sequence_from_matrices(
        [np.array(ids, int) for ids in truth], [np.array(ids, int) for ids in track], matrices
    )


@pytest.mark.parametrize("tied", [False, True])
@pytest.mark.parametrize("block", range(10))
def test_random_traffic(block: int, tied: bool) -> None:
    """500 sequences of moving objects, half of them with coinciding distances."""
    for seed in range(25 * block, 25 * block + 25):
        rng = np.random.default_rng([seed, tied])
        assert_all_agree(random_traffic(rng, tied=tied), threshold=rng.choice([0.3, 0.5, 0.75]))


@pytest.mark.parametrize("seed", range(40))
def test_equal_similarities_in_crowds(seed: int) -> None:
    """Up to 24 x 24 similarities per frame, drawn from few values."""
    rng = np.random.default_rng(seed)
    truth, track = (
        [rng.permutation(24)[: rng.integers(0, 25)].tolist() for _ in range(12)] for _ in range(2)
    )
    steps = rng.choice([3, 5, 10, 20])
    assert_all_agree(from_matrices(truth, track, lambda n: rng.integers(0, steps + 1, n) / steps))


@pytest.mark.parametrize("seed", range(60))
def test_rounding_decides_between_interchangeable_tracks(seed: int) -> None:
    """Two kinds of objects and of tracks, equal within a kind: only rounding tells them apart.

    Which of them is matched changes the association, so sums must be rounded in numpy's order.
    """
    rng = np.random.default_rng(seed)
    n_objects, n_tracks, n_frames = rng.integers(3, 20, 3).tolist()
    by_kind = rng.choice([0.1, 0.2, 0.3, 0.6, 0.7, 0.9], (2, 2))
    by_pair = by_kind[rng.integers(0, 2, n_objects)][:, rng.integers(0, 2, n_tracks)]
    truth, track = (
        [np.sort(rng.permutation(n)[: n - rng.integers(0, 2)]).tolist() for _ in range(n_frames)]
        for n in (n_objects, n_tracks)
    )
    pairs = zip(truth, track, strict=True)
    similarity = np.concatenate([by_pair[np.ix_(a, b)].ravel() for a, b in pairs])
    assert_all_agree(from_matrices(truth, track, lambda _: similarity))


def id_lists(n_frames: int) -> st.SearchStrategy[list[list[int]]]:
    ids = st.lists(st.integers(0, 3), unique=True, max_size=4)
    return st.lists(ids, min_size=n_frames, max_size=n_frames)


@settings(
    max_examples=200, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck)
)
@given(data=st.data(), n_frames=st.integers(1, 5), threshold=st.sampled_from([0.0, 0.5, 1.0]))
def test_small_sequences_on_the_thresholds(
    data: st.DataObject, n_frames: int, threshold: float
) -> None:
    """Similarities exactly on, just below and just above the thresholds, and 0 and 1."""
    on = st.sampled_from([0.0, 1.0, 0.05, 0.5, 0.95, 0.15, 0.3])
    near = st.sampled_from([*ALPHAS, *(ALPHAS - 1e-15), *np.nextafter(ALPHAS, 0)])
    truth, track = data.draw(id_lists(n_frames)), data.draw(id_lists(n_frames))
    sequence = from_matrices(
        truth, track, lambda n: data.draw(st.lists(on | near, min_size=n, max_size=n))
    )
    assert_all_agree(sequence, threshold)


def test_a_long_crowded_sequence() -> None:
    """30 objects on 20 m x 20 m for 300 frames: nearly every frame needs an assignment."""
    rng = np.random.default_rng(5)
    frame, obj = np.divmod(np.arange(300 * 30), 30)
    xy = rng.uniform(0.0, 20.0, (30, 2))[obj] + rng.normal(0.0, 0.05, (30, 2))[obj] * frame[:, None]
    kept = rng.random(len(frame)) < 0.9
    sequence = sequence_from_rows(
        frame, obj, xy,
        frame[kept], (obj + 100 * (frame // 70))[kept],
        (xy + rng.normal(0.0, 0.3, xy.shape))[kept], 300,
    )  # fmt: skip
    assert_all_agree(sequence)


@pytest.mark.parametrize("seed", range(20))
def test_sequences_combined(seed: int) -> None:
    """Five sequences taken together, one of them without tracks, as `combine_sequences`."""
    rng = np.random.default_rng(seed)
    parts = [random_traffic(rng, tied=False) for _ in range(4)]
    parts.append(sequence_from_rows([0, 1], [7, 7], np.zeros((2, 2)), [], [], [], 3))

    def together(metric: Any) -> dict[str, Any]:
        scores = {str(i): metric.eval_sequence(as_trackeval(p)) for i, p in enumerate(parts)}
        combined: dict[str, Any] = metric.combine_sequences(scores)
        return combined

    assert_hota_agrees(combine_hota([hota(p) for p in parts]), together(HOTA()))
    assert_clear_agrees(combine_clear([clear(p) for p in parts]), together(oracle(CLEAR)))
    assert_identity_agrees(
        combine_identity([identity(p) for p in parts]), together(oracle(Identity))
    )


def test_thresholds_are_the_same() -> None:
    """To the last bit: a similarity on a threshold must fall on the same side."""
    assert_array_equal(ALPHAS, HOTA().array_labels)
