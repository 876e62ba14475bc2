"""Claim: KITTI's rules of what counts are TrackEval's, to every bit of every score.

TrackEval 1.3.0's own `Kitti2DBox` reads the same files. On random scenes here; on the recordings
in `test_kitti_command`.
"""

import contextlib
import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from trackeval.datasets import Kitti2DBox
from trackeval.metrics import CLEAR, HOTA, Identity

from experiments.kitti.official import Judged, Labels
from experiments.kitti.unlabelled import without_label
from experiments.metrics import clear, hota, identity
from mdkf import Tracks
from mdkf.tables import FloatArray
from sim_bridge.kitti_image import PictureBoxes
from sim_bridge.kitti_writing import write_boxes
from tests.tables import trace_of, tracks_of

FRAMES = 15
QUIET = {"PRINT_CONFIG": False}

Row = tuple[int, int, str, int, int, tuple[float, float, float, float]]
"""Of a label: frame, track id, type, truncated, occluded, left, top, right, bottom [px]."""

Track = tuple[int, int, tuple[float, float, float, float]]
"""frame, track id, left, top, right, bottom [px]."""


def labelled(root: Path, rows: list[Row], n_frames: int = FRAMES) -> Path:
    """A folder with one labelled sequence, 0003; boxes stand on the ground where they may."""
    (root / "label_02").mkdir(parents=True)
    for split in ("training", "val"):
        line = f"0003 empty 000000 {n_frames:06d}\n"
        (root / f"evaluate_tracking.seqmap.{split}").write_text(line)
    lines = []
    for frame, track, kind, truncated, occluded, image in sorted(rows, key=lambda row: row[0]):
        pixels = " ".join(f"{value:.6f}" for value in image)
        space = "-1000 -1000 -1000 -10 -1 -1 -1" if track < 0 else f"1.5 1.8 4.5 {track} 1.6 20 0"
        lines.append(f"{frame} {track} {kind} {truncated} {occluded} -10 {pixels} {space}\n")
    (root / "label_02" / "0003.txt").write_text("".join(lines))
    return root


def tracked(rows: list[Track], n_frames: int = FRAMES) -> tuple[Tracks, PictureBoxes]:
    """Tracks that are all in the picture, there where told; in space each is at x = its id."""
    rows = sorted(rows)
    tracks = tracks_of([(frame, track, 0.0, 0.0) for frame, track, _ in rows], n_frames)
    n = len(rows)
    image = np.round(np.array([row[2] for row in rows], dtype=np.float64).reshape(n, 4), 6)
    places = np.column_stack([tracks.track_id, np.full(n, 1.6), np.full(n, 20.0)])
    ones = np.ones(n)
    return tracks, PictureBoxes(
        np.arange(n), tracks.frame, image, places, ones, ones, ones, ones, ones
    )


def scored(
    root: Path, tracks: Tracks, boxes: PictureBoxes, n_frames: int = FRAMES
) -> dict[str, Any]:
    """Our scores by TrackEval's names."""
    labels = Labels.read(root, "0003", n_frames)
    sequence = Judged.of(labels, boxes, tracks.track_id[boxes.row]).sequence()
    overall, counts, identities = hota(sequence), clear(sequence), identity(sequence)
    return {
        **{name: getattr(overall, name.lower()) for name in ("HOTA", "DetA", "AssA", "LocA")},
        **{f"HOTA_{name}": getattr(overall, name.lower()) for name in ("TP", "FN", "FP")},
        **{"MOTA": counts.mota, "MOTP": counts.motp, "IDSW": counts.idsw, "Frag": counts.frag},
        **{"CLR_TP": counts.tp, "CLR_FN": counts.fn, "CLR_FP": counts.fp},
        **{"MT": counts.mt, "PT": counts.pt, "ML": counts.ml},
        **{"IDF1": identities.idf1, "IDTP": identities.idtp, "IDFP": identities.idfp},
    }


def by_trackeval(root: Path, tracks: Tracks, boxes: PictureBoxes) -> dict[str, Any]:
    """TrackEval's scores of the same files, NaN where there was nothing to divide by."""
    folder = root / "tracks" / "ours" / "data"
    folder.mkdir(parents=True)
    write_boxes(folder / "0003.txt", tracks, boxes)
    told = {"GT_FOLDER": str(root), "TRACKERS_FOLDER": str(root / "tracks")}
    told |= {"CLASSES_TO_EVAL": ["car"], "SPLIT_TO_EVAL": "val", **QUIET}  # type: ignore[dict-item]
    dataset = Kitti2DBox(told)
    with contextlib.redirect_stdout(io.StringIO()):
        raw = dataset.get_raw_seq_data("ours", "0003")
        data = dataset.get_preprocessed_seq_data(raw, "car")
    scores: dict[str, Any] = {}
    for metric in (HOTA(), CLEAR(QUIET), Identity(QUIET)):
        scores |= metric.eval_sequence(data)
    return scores


def assert_same(root: Path, tracks: list[Track]) -> dict[str, Any]:
    """Ours are TrackEval's, wherever a score has a value."""
    ours = scored(root, *tracked(tracks))
    theirs = by_trackeval(root, *tracked(tracks))
    for name, value in ours.items():
        mine, other = np.asarray(value, dtype=float), np.asarray(theirs[name], dtype=float)
        has = ~np.isnan(mine)
        assert_allclose(mine[has], other[has], rtol=0, atol=1e-12, err_msg=name)
        assert (other[~has] % 1 == 0).all(), name  # TrackEval says 0 or 1 for no value
    return ours


def moved(box: FloatArray, rng: np.random.Generator, pixels: float) -> tuple[float, ...]:
    return tuple((box + rng.normal(0, pixels, 4)).tolist())


@pytest.mark.parametrize("seed", range(40))
def test_random_scenes_score_as_trackeval_scores_them(tmp_path: Path, seed: int) -> None:
    """Cars and vans, cut off, hidden, small, crossing; areas without labels; tracks that follow
    them more or less well, change places, or follow nothing."""
    rng = np.random.default_rng(seed)
    rows: list[Row] = []
    tracks: list[Track] = []
    for track in range(8):
        kind = "Van" if rng.random() < 0.25 else "Car"
        place = rng.uniform([0, 100], [1000, 220])
        size = rng.uniform(15, 120, 2)
        first, last = np.sort(rng.integers(0, FRAMES, 2))
        speed = rng.uniform(-15, 15, 2)
        follower = track if rng.random() < 0.8 else 20 + track
        for frame in range(first, last + 1):
            corner = place + speed * (frame - first)
            box = np.concatenate([corner, corner + size])
            truncated, occluded = rng.choice(3, p=[0.8, 0.1, 0.1]), rng.choice(4)
            rows.append((frame, track, kind, int(truncated), int(occluded), tuple(box.tolist())))
            if rng.random() < 0.85:
                tracks.append((frame, follower, moved(box, rng, size.min() / 12)))  # type: ignore[arg-type]
            if rng.random() < 0.05:
                follower = 40 + track
        if rng.random() < 0.5:
            for frame in range(first, last + 1):  # nothing, or a second track of the same object
                box = np.concatenate([place, place + size])
                tracks.append((frame, 60 + track, moved(box, rng, 3)))  # type: ignore[arg-type]
    for frame in range(FRAMES):
        for _ in range(rng.integers(0, 3)):
            corner = rng.uniform([0, 100], [1000, 220])
            area = (*corner.tolist(), *(corner + rng.uniform(30, 200, 2)).tolist())
            rows.append((frame, -1, "DontCare", -1, -1, area))
    tracks = [row for row in tracks if row[2][0] < row[2][2] and row[2][1] < row[2][3]]
    ours = assert_same(labelled(tmp_path, rows), tracks)
    assert ours["CLR_TP"] > 0


CAR = (100.0, 100.0, 200.0, 150.0)
BESIDE = (100.0, 100.0, 200.0, 146.0)  # overlaps by 0.92
AWAY = (600.0, 100.0, 700.0, 150.0)


@pytest.mark.parametrize(
    ("labels", "box", "counts"),
    [
        ([("Car", 0, 0, CAR)], BESIDE, (1, 0, 0)),
        ([("Car", 0, 2, CAR)], BESIDE, (1, 0, 0)),
        ([("Car", 0, 3, CAR)], BESIDE, (0, 0, 0)),  # hidden by nobody knows how much
        ([("Car", 1, 0, CAR)], BESIDE, (0, 0, 0)),  # cut by the picture's edge
        ([("Van", 0, 0, CAR)], BESIDE, (0, 0, 0)),
        ([("Van", 0, 0, CAR), ("Car", 0, 0, BESIDE)], BESIDE, (1, 0, 0)),
        ([("Car", 0, 0, CAR)], AWAY, (0, 1, 1)),
        ([("Van", 0, 0, CAR)], AWAY, (0, 0, 1)),
        ([("DontCare", -1, -1, (600.0, 100.0, 651.0, 150.0))], AWAY, (0, 0, 0)),
        ([("DontCare", -1, -1, (600.0, 100.0, 650.0, 150.0))], AWAY, (0, 0, 1)),  # half of it
        (
            [
                ("DontCare", -1, -1, (600.0, 100.0, 640.0, 150.0)),
                ("DontCare", -1, -1, (640.0, 100.0, 680.0, 150.0)),
            ],
            AWAY,
            (0, 0, 1),
        ),  # two areas hold more than half together, neither alone
        ([("Car", 0, 0, CAR)], (600.0, 100.0, 700.0, 125.0), (0, 1, 0)),  # 25 px high
        ([("Car", 0, 0, CAR)], (600.0, 100.0, 700.0, 125.1), (0, 1, 1)),
        ([("Car", 0, 0, (100.0, 100.0, 200.0, 120.0))], (100.0, 100.0, 200.0, 119.0), (1, 0, 0)),
    ],
)
def test_what_counts_by_hand(
    tmp_path: Path,
    labels: list[tuple[str, int, int, tuple[float, float, float, float]]],
    box: tuple[float, float, float, float],
    counts: tuple[int, int, int],
) -> None:
    """One frame, one track: hits, misses and false tracks; TrackEval says the same."""
    rows: list[Row] = [
        (0, -1 if kind == "DontCare" else track, kind, truncated, occluded, image)
        for track, (kind, truncated, occluded, image) in enumerate(labels)
    ]
    ours = assert_same(labelled(tmp_path, rows), [(0, 7, box)])
    assert (ours["CLR_TP"], ours["CLR_FN"], ours["CLR_FP"]) == counts


def test_on_the_ground_the_same_rows_count(tmp_path: Path) -> None:
    """Cars at x = 0 and 1 m, tracks in their pictures at 1.5 and 9: the first is 0.5 m from the
    second car, what a van takes is ignored though it is 1 m from a car."""
    van = (300.0, 100.0, 400.0, 150.0)
    root = labelled(
        tmp_path,
        [(0, 0, "Car", 0, 0, CAR), (0, 1, "Car", 0, 0, AWAY), (0, 3, "Van", 0, 0, van)],
    )
    tracks, boxes = tracked([(0, 0, CAR), (0, 2, van), (0, 9, AWAY)])
    labels = Labels.read(root, "0003", FRAMES)
    in_picture = Judged.of(labels, boxes, tracks.track_id).sequence()
    assert (len(in_picture.truth), len(in_picture.track)) == (2, 2)
    np.testing.assert_allclose(in_picture.frame_similarity(0), np.eye(2))
    boxes.bottom[0, 0] = 1.5
    on_ground = Judged.of(labels, boxes, tracks.track_id).sequence("ground")
    np.testing.assert_allclose(on_ground.frame_similarity(0), [[0.25, 0.0], [0.75, 0.0]])


def test_rows_are_spared_only_where_they_belong_to_nothing(tmp_path: Path) -> None:
    """Of two tracks that are to be spared one has the car, which counts as ever."""
    root = labelled(tmp_path, [(0, 0, "Car", 0, 0, CAR)])
    tracks, boxes = tracked([(0, 3, BESIDE), (0, 4, AWAY)])
    labels = Labels.read(root, "0003", FRAMES)
    spared = np.ones(2, dtype=np.bool_)
    counts = clear(Judged.of(labels, boxes, tracks.track_id).sequence(spared=spared))
    assert (counts.tp, counts.fn, counts.fp) == (1, 0, 0)
    counts = clear(Judged.of(labels, boxes, tracks.track_id).sequence())
    assert (counts.tp, counts.fn, counts.fp) == (1, 0, 1)


def test_frames_without_the_label_of_a_tracks_car_are_told() -> None:
    """Track 5 is with car 1 in most frames, and outside its labels in frames 0, 1 and 8; track 6
    with nothing in any; track 7 with car 2 from before until after, its labels' gap is within."""
    truth = [(k, 1, 0.0, 0.0) for k in range(2, 8)]
    truth += [(k, 2, 30.0, 0.0) for k in (3, 4, 7)] + [(1, 3, 0.0, 0.0)]
    rows = [(k, 5, 0.5, 0.0) for k in range(9)] + [(k, 6, 60.0, 0.0) for k in range(9)]
    rows += [(k, 7, 30.0, 1.0) for k in range(2, 9)]
    tracks = tracks_of(rows, 9)
    outside = without_label(trace_of(truth, 9), tracks)
    told = {
        (int(f), int(t))
        for f, t in zip(tracks.frame[outside], tracks.track_id[outside], strict=True)
    }
    assert told == {(0, 5), (1, 5), (8, 5), (2, 7), (8, 7)}
