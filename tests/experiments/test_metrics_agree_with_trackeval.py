"""HOTA, CLEAR and Identity are TrackEval's wherever they have a value; the rest is said here.

TrackEval 1.3.0 runs unchanged on numpy 2. Where a denominator is empty it returns 0 (loca: 1);
ours is NaN there. `no_value` puts that NaN into TrackEval's answer, case by case, so that the
comparison states every difference between the two.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from trackeval.datasets._base_dataset import _BaseDataset
from trackeval.metrics import CLEAR, HOTA, Identity

from experiments.metrics import (
    ALPHAS,
    COLUMNS,
    ClearScores,
    HotaScores,
    IdentityScores,
    Sequence,
    Similarity,
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

Boxes = np.ndarray[Any, np.dtype[np.float64]]


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


def as_rows(boxes: Boxes, similarity: Similarity) -> Boxes:
    """What a similarity compares of boxes (n, 7) x, y, z, yaw, length, width, height."""
    x, y, z, yaw, length, width, height = boxes.T
    if similarity == "image":
        # A camera that looks down from high above, 20 px per metre, knows no yaw.
        return 20.0 * np.column_stack(
            [x - length / 2, y - width / 2, x + length / 2, y + width / 2]
        )
    named = {"x": x, "y": y, "z": z, "yaw": yaw, "length": length, "width": width, "height": height}
    return np.column_stack([named[column] for column in COLUMNS[similarity]])


def random_boxes(rng: np.random.Generator, n: int, side: float) -> Boxes:
    low, high = np.array([[0, 0, -0.5, -4, 0.5, 0.5, 0.5], [side, side, 0.5, 4, 5, 2, 3]])
    return rng.uniform(low, high, (n, 7))


def random_traffic(
    rng: np.random.Generator, *, tied: bool, similarity: Similarity = "centre"
) -> Sequence:
    """Objects that come and go, and tracks with everything that goes wrong with tracks.

    Missed frames, noise, clutter, identity switches, two tracks on one object, and frames without
    truth or tracks. `tied` rounds boxes to half metres and quarter turns, so that similarities
    coincide.
    """
    n_frames = int(rng.choice([1, 2, 10, 40], p=[0.3, 0.2, 0.4, 0.1]))
    n_objects = int(rng.integers(0, 14))
    side = rng.choice([2.0, 6.0, 60.0])  # [m] crowded to sparse
    begin = rng.integers(0, n_frames, n_objects)
    end = rng.integers(begin + 1, n_frames + 1)
    frame = np.concatenate([np.zeros(0, int), *map(np.arange, begin, end)])
    obj = np.repeat(np.arange(n_objects), end - begin)
    speed = rng.normal(0.0, rng.choice([0.0, 0.3]), (n_objects, 2))  # [m/frame]
    boxes = random_boxes(rng, n_objects, side)[obj]
    boxes[:, :2] += speed[obj] * frame[:, None]

    copies = 1 + (rng.random() < 0.3)
    track_frame = np.tile(frame, copies)
    track_id = np.concatenate([obj + 1000 * copy for copy in range(copies)])
    for switch in rng.integers(0, n_frames, rng.integers(0, 4)):
        after = track_frame >= switch
        track_id[after] = rng.permutation(2000)[track_id[after]]
    track_boxes = np.tile(boxes, (copies, 1))
    spread = np.array([1.0, 1.0, 0.5, 0.2, 0.0, 0.0, 0.0]) * rng.choice([0.0, 0.1, 0.5])
    track_boxes += spread * rng.normal(size=track_boxes.shape)
    kept = rng.random(len(track_frame)) < rng.choice([0.5, 0.9, 1.0])
    clutter = rng.integers(0, 20)
    track_frame = np.concatenate([track_frame[kept], rng.integers(0, n_frames, clutter)])
    track_id = np.concatenate([track_id[kept], 5000 + np.arange(clutter)])
    track_boxes = np.concatenate([track_boxes[kept], random_boxes(rng, clutter, side)])

    blind, bare = (rng.random((2, n_frames)) < 0.1) * (rng.random((2, 1)) < 0.5)
    seen, shown = ~blind[track_frame], ~bare[frame]
    if tied:
        step = np.array([0.5, 0.5, 0.5, np.pi / 2, 0.5, 0.5, 0.5])
        boxes, track_boxes = step * np.round(boxes / step), step * np.round(track_boxes / step)
    return sequence_from_rows(
        frame[shown], obj[shown], as_rows(boxes, similarity)[shown],
        track_frame[seen], track_id[seen], as_rows(track_boxes, similarity)[seen],
        n_frames, similarity,
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


@pytest.mark.parametrize("similarity", COLUMNS)
@pytest.mark.parametrize("tied", [False, True])
@pytest.mark.parametrize("block", range(10))
def test_random_traffic(block: int, tied: bool, similarity: Similarity) -> None:
    """1000 sequences of moving objects by each similarity, half of them with coinciding ones."""
    for seed in range(50 * block, 50 * block + 50):
        rng = np.random.default_rng([seed, tied])
        sequence = random_traffic(rng, tied=tied, similarity=similarity)
        assert_all_agree(sequence, threshold=rng.choice([0.3, 0.5, 0.75]))


@pytest.mark.parametrize("similarity", COLUMNS)
def test_random_traffic_has_what_goes_wrong(similarity: Similarity) -> None:
    """Of 100 sequences each fault is in 10 or more, and in none all is right."""
    scores = []
    for seed in range(100):
        sequence = random_traffic(np.random.default_rng(seed), tied=True, similarity=similarity)
        scores.append((clear(sequence, 0.3), hota(sequence), sequence))
    for fault in ("idsw", "frag", "fn", "fp", "tp"):
        assert sum(getattr(frames, fault) > 0 for frames, _, _ in scores) >= 10, fault
    assert sum(0.0 < h.assa[0] < 1.0 for _, h, _ in scores) >= 10
    rivals = [np.diff(sequence.pairs.start) for _, _, sequence in scores]
    assert sum((per_row > 1).any() for per_row in rivals) >= 10


HERE, BESIDE, FAR = (
    np.array([[x, 3.0, 0.75, 0.3, 4.0, 2.0, 1.5]]) for x in (0.0, 0.5, 100.0)
)  # one box


def rows(*parts: tuple[int, Any, Boxes]) -> tuple[Any, Any, Boxes]:
    """Frames, ids and boxes of parts (id, frames, box)."""
    frames = [np.asarray(part[1], int) for part in parts]
    return (
        np.concatenate([np.zeros(0, int), *frames]),
        np.repeat([part[0] for part in parts], [len(frame) for frame in frames]).astype(int),
        np.concatenate([np.zeros((0, 7)), *(np.repeat(p[2], len(p[1]), axis=0) for p in parts)]),
    )


FIRST, LAST, ALL = range(5), range(5, 10), range(10)
ONE, TWO = rows((1, ALL, HERE)), rows((1, ALL, HERE), (2, ALL, FAR))
TWINS = rows((1, ALL, HERE), (2, ALL, HERE))
NONE = rows()
BY_HAND = {
    "nothing": (NONE, NONE),
    "no truth": (NONE, ONE),
    "no tracks": (TWO, NONE),
    "one frame": (rows((1, [4], HERE)), rows((7, [4], BESIDE))),
    "the same": (TWO, TWO),
    "nothing similar": (ONE, rows((1, ALL, FAR))),
    "never at the same time": (rows((1, FIRST, HERE)), rows((1, LAST, HERE))),
    "a swap": (TWO, rows((1, FIRST, HERE), (2, FIRST, FAR), (1, LAST, FAR), (2, LAST, HERE))),
    "a swap and back": (
        TWO,
        rows((1, [*range(4), 8, 9], HERE), (2, range(4, 8), HERE), (2, [*range(4), 8, 9], FAR)),
    ),
    "two tracks on one object": (ONE, TWINS),
    "two objects under one track": (TWINS, ONE),
    "two tracks on two objects in one place": (TWINS, TWINS),
    "a better track beside the first": (ONE, rows((1, ALL, BESIDE), (2, LAST, HERE))),
    "a new track in every frame": (ONE, rows(*((k, [k], HERE) for k in ALL))),
    "every other frame": (TWO, rows((1, range(0, 10, 2), HERE), (2, range(1, 10, 2), FAR))),
    "an empty box": (ONE, rows((1, ALL, HERE * [1, 1, 1, 1, 0, 0, 0]))),
}


@pytest.mark.parametrize("similarity", COLUMNS)
@pytest.mark.parametrize("case", BY_HAND)
def test_sequences_by_hand(case: str, similarity: Similarity) -> None:
    """The corner cases of the field, at thresholds that all, some and no tracks meet."""
    (frame, obj, boxes), (track_frame, track, track_boxes) = BY_HAND[case]
    sequence = sequence_from_rows(
        frame, obj, as_rows(boxes, similarity),
        track_frame, track, as_rows(track_boxes, similarity), 10, similarity,
    )  # fmt: skip
    for threshold in (0.0, 0.5, 0.75, 1.0):
        assert_all_agree(sequence, threshold)


@pytest.mark.parametrize("threshold", [0.05, 0.3, 0.5, 0.95])
def test_boxes_exactly_on_the_thresholds(threshold: float) -> None:
    """Tracks that cover k twentieths of their object: the quotient of areas, not k times 0.05."""
    k = np.arange(1, 21)
    truth = np.tile([0.0, 0.0, 100.0, 30.0], (20, 1))
    track = np.column_stack([0 * k, 0 * k, 5.0 * k, 0 * k + 30.0])
    for frame in (0 * k, k - 1):
        apart = 200.0 * np.outer(k, [1, 0, 1, 0]) * (frame == 0)[:, None]
        assert_all_agree(
            sequence_from_rows(frame, k, truth + apart, frame, k, track + apart, 20, "image"),
            threshold,
        )


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("tied", [False, True])
def test_similarities_are_trackevals(seed: int, tied: bool) -> None:
    """To the last bit, frame by frame: those of centres and of image boxes, which TrackEval has."""
    theirs = {
        "centre": _BaseDataset._calculate_euclidean_similarity,
        "image": partial(_BaseDataset._calculate_box_ious, box_format="x0y0x1y1"),
    }
    rng = np.random.default_rng([seed, tied])
    truth, track = random_boxes(rng, 30, 6.0), random_boxes(rng, 40, 6.0)
    if tied:
        truth, track = np.round(2 * truth) / 2, np.round(2 * track) / 2
    for similarity, function in theirs.items():
        a, b = as_rows(truth, similarity), as_rows(track, similarity)
        built = sequence_from_rows(
            np.zeros(30, int), np.arange(30), a, np.zeros(40, int), np.arange(40), b, 1, similarity
        )
        assert_array_equal(built.frame_similarity(0), function(a, b))


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
