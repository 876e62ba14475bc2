"""Claim: official TrackEval accepts what `mdkf export` writes, and gives our scores of it.

As its users run it: a folder of truth, a folder of trackers, its own evaluator, its own files. Ours
are worked out from the same files: KITTI's by `experiments.kitti`'s rules, MOTChallenge's by the
rectangles and one rule, that a track on a distractor is ignored.
"""

import contextlib
import io
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import linear_sum_assignment
from trackeval import Evaluator
from trackeval.datasets import Kitti2DBox, MotChallenge2DBox
from trackeval.metrics import CLEAR, HOTA, Identity

import scenarios
import sim_bridge
from experiments import OcclusionProtocol
from experiments.exchange.worlds import Folder, World
from experiments.kitti.official import Judged, Labels
from experiments.metrics import (
    Sequence,
    clear,
    combine_clear,
    combine_hota,
    combine_identity,
    hota,
    identity,
    image_iou,
    sequence_from_matrices,
)
from mdkf import Trace, Tracker, Tracks, estimator
from mdkf.tables import FloatArray
from sim_bridge.kitti_files import read_results
from sim_bridge.kitti_image import PictureBoxes
from tests.experiments.commands import shortened

QUIET = {"PRINT_CONFIG": False}


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two seeds of ten seconds of a street, with gaps, tracked by CA and MD, in both layouts."""
    folder = tmp_path_factory.mktemp("exported")
    scenario = scenarios.load(shortened(folder / "own"))
    folders = [Folder(folder / layout, layout) for layout in ("kitti", "mot")]  # type: ignore[arg-type]
    for seed in (3, 4):
        trace = sim_bridge.simulate(scenario, seed)
        found = OcclusionProtocol("mid", 20, 35).apply(sim_bridge.detect(trace, seed=seed))
        tracks = {name: Tracker(estimator(name)).run(found) for name in ("ca", "md")}
        for each in folders:
            each.add(World(trace, found, tracks))
    return folder


def official(dataset: Any, kind: str, out: Path) -> dict[str, Any]:
    """TrackEval's scores by tracker, of both sequences together and of each."""
    settings = {"USE_PARALLEL": False, "PRINT_RESULTS": False, "PLOT_CURVES": False, **QUIET}
    settings |= {
        "OUTPUT_SUMMARY": False,
        "OUTPUT_DETAILED": False,
        "LOG_ON_ERROR": str(out / "log"),
    }
    with contextlib.redirect_stdout(io.StringIO()):
        evaluator = Evaluator({**settings, "TIME_PROGRESS": False, "BREAK_ON_ERROR": True})
        results, messages = evaluator.evaluate([dataset], [HOTA(), CLEAR(QUIET), Identity(QUIET)])
    (name,) = results
    assert set(messages[name].values()) == {"Success"}
    return {
        tracker: {sequence: found[kind] for sequence, found in by_sequence.items()}
        for tracker, by_sequence in results[name].items()
    }


def assert_same(theirs: dict[str, Any], sequences: list[Sequence]) -> None:
    """Every score of each sequence, and of all together."""
    parts = [[measure(each) for each in sequences] for measure in (hota, clear, identity)]
    whole = (combine_hota(parts[0]), combine_clear(parts[1]), combine_identity(parts[2]))  # type: ignore[arg-type]
    named = {f"{k:04d}": tuple(part[k] for part in parts) for k in range(len(sequences))}
    for name, (overall, counts, ids) in {**named, "COMBINED_SEQ": whole}.items():
        found = theirs[name]
        for mine, other in (
            *((getattr(overall, key.lower()), found["HOTA"][key]) for key in ("HOTA", "DetA")),
            *((getattr(overall, key.lower()), found["HOTA"][key]) for key in ("AssA", "LocA")),
            *((getattr(counts, key.lower()), found["CLEAR"][key]) for key in ("MOTA", "MOTP")),
            *((getattr(counts, key.lower()), found["CLEAR"][key]) for key in ("IDSW", "Frag")),
            (counts.tp, found["CLEAR"]["CLR_TP"]),
            (counts.fp, found["CLEAR"]["CLR_FP"]),
            (counts.fn, found["CLEAR"]["CLR_FN"]),
            (ids.idf1, found["Identity"]["IDF1"]),
            (ids.idtp, found["Identity"]["IDTP"]),
        ):
            assert_allclose(mine, other, rtol=0, atol=1e-12, err_msg=name)


def kitti(root: Path) -> dict[str, Any]:
    """Official scores of a folder in KITTI's layout."""
    told = {"GT_FOLDER": str(root), "TRACKERS_FOLDER": str(root / "tracks"), **QUIET}
    dataset = Kitti2DBox({**told, "CLASSES_TO_EVAL": ["car"], "SPLIT_TO_EVAL": "val"})
    return official(dataset, "car", root)


def ours_in_the_picture(root: Path, name: str, sequence: str) -> Sequence:
    """KITTI's rules, from the files."""
    labels = Labels.read(root, sequence, 100)
    ids, rows, known = read_results(root / "tracks" / name / "data" / f"{sequence}.txt", 100)
    assert known.all()
    ones = np.ones(len(ids))
    boxes = PictureBoxes(
        np.arange(len(ids)),
        rows.frame,
        rows.image,
        rows.bottom,
        *(ones, ones, ones, ones, ones),
    )
    return Judged.of(labels, boxes, ids).sequence()


def test_kittis_scorer_gives_our_scores(exported: Path) -> None:
    """Of both filters and sequences: HOTA, CLEAR and Identity to the last digits, and there is
    something to score: cars that are hit, missed and tracked though nothing is there."""
    theirs = kitti(exported / "kitti")
    assert set(theirs) == {"ca", "md"}
    for name, found in theirs.items():
        sequences = [ours_in_the_picture(exported / "kitti", name, f"{k:04d}") for k in (0, 1)]
        assert_same(found, sequences)
        counts = found["COMBINED_SEQ"]["CLEAR"]
        assert min(counts["CLR_TP"], counts["CLR_FN"], counts["CLR_FP"]) > 0


def truth_as_tracks(trace: Trace) -> Tracks:
    """A tracker that knows all: every road user in every frame, wherever it is."""
    users = trace.take(trace.road_users())
    columns = {
        name: users.columns().get(name, np.zeros(len(users))) for name in Tracks.column_types()
    }
    columns |= {"track_id": users.object_id, "score": np.ones(len(users))}
    columns |= {"cov_xx": np.ones(len(users)), "cov_yy": np.ones(len(users))}
    return Tracks.from_columns(columns, n_frames=trace.n_frames, dt=trace.dt)


def test_who_knows_the_truth_is_perfect(exported: Path, tmp_path: Path) -> None:
    """By both official scorers, whatever is behind the camera, far away, hidden, a bus or a
    bicycle: none of it is missed or false, and its cars are all hits."""
    trace = sim_bridge.read_table(exported / "mot" / "worlds" / "0000" / "trace.parquet", Trace)
    for layout in ("kitti", "mot"):
        world = World(trace, None, {"truth": truth_as_tracks(trace)})
        Folder(tmp_path / layout, layout).add(world)  # type: ignore[arg-type]
    told = {"GT_FOLDER": str(tmp_path / "mot"), **QUIET, "BENCHMARK": "mdkf"}
    dataset = MotChallenge2DBox({**told, "TRACKERS_FOLDER": str(tmp_path / "mot" / "trackers")})
    from_above = official(dataset, "pedestrian", tmp_path / "mot")
    for found in (kitti(tmp_path / "kitti"), from_above):
        scores = found["truth"]["COMBINED_SEQ"]
        assert_allclose(scores["HOTA"]["HOTA"], 1.0, rtol=0, atol=1e-12)
        assert (scores["CLEAR"]["CLR_FN"], scores["CLEAR"]["CLR_FP"]) == (0, 0)
        assert scores["CLEAR"]["CLR_TP"] > 100


def without(folder: Path, unwanted: Any) -> None:
    """Take the rows that are not wanted out of every file of a folder."""
    for path in folder.rglob("*.txt"):
        lines = path.read_text().splitlines(keepends=True)
        path.write_text("".join(line for line in lines if not unwanted(line.split())))


def test_what_is_behind_the_camera_does_not_touch_the_official_scores(
    exported: Path, tmp_path: Path
) -> None:
    """Boxes in space are written all around; without those that are not in the picture, labels or
    tracks, every official score is the same. Without the areas over buses, bicycles and far cars it
    is not: they spare tracks that nothing else would."""
    before = kitti(exported / "kitti")
    copy = tmp_path / "copy"
    shutil.copytree(exported / "kitti", copy)
    rows = sum(len(path.read_text().splitlines()) for path in (copy / "tracks").rglob("*.txt"))
    for folder in (copy / "tracks", copy / "label_02"):
        without(folder, lambda row: row[6:10] == ["-1.000000"] * 4)
    left = sum(len(path.read_text().splitlines()) for path in (copy / "tracks").rglob("*.txt"))
    assert left < 0.8 * rows
    after = kitti(copy)
    for name, found in before.items():
        for metric in ("HOTA", "CLEAR", "Identity"):
            for key, value in found["COMBINED_SEQ"][metric].items():
                np.testing.assert_array_equal(after[name]["COMBINED_SEQ"][metric][key], value, key)
    without(copy / "label_02", lambda row: row[2] == "DontCare")
    more = kitti(copy)["md"]["COMBINED_SEQ"]["CLEAR"]["CLR_FP"]
    assert more > before["md"]["COMBINED_SEQ"]["CLEAR"]["CLR_FP"]


def read(path: Path) -> FloatArray:
    """A file of MOTChallenge's (rows, columns)."""
    return np.loadtxt(path, delimiter=",", ndmin=2)


def from_above(root: Path, name: str, sequence: str) -> Sequence:
    """MOTChallenge's rules, from the files: tracks on distractors are ignored."""
    truth = read(root / "mdkf-train" / sequence / "gt" / "gt.txt")
    tracks = read(root / "trackers" / "mdkf-train" / name / "data" / f"{sequence}.txt")
    truth_ids, track_ids, similarities = [], [], []
    for frame in range(1, 101):
        there, mine = truth[truth[:, 0] == frame], tracks[tracks[:, 0] == frame]
        corners = [np.hstack([t[:, 2:4], t[:, 2:4] + t[:, 4:6]]) for t in (there, mine)]
        likeness = image_iou(*corners)
        enough = np.where(likeness < 0.5 - np.finfo(float).eps, 0.0, likeness)
        a, b = linear_sum_assignment(enough, maximize=True)
        on_distractor = b[(enough[a, b] > 0) & (there[a, 7] == 8)]
        kept = np.setdiff1d(np.arange(len(mine)), on_distractor)
        counts = there[:, 6] == 1
        truth_ids.append(there[counts, 1].astype(np.int64))
        track_ids.append(mine[kept, 1].astype(np.int64))
        similarities.append(likeness[counts][:, kept])
    return sequence_from_matrices(truth_ids, track_ids, similarities)


@pytest.mark.parametrize("preprocessing", [True, False])
def test_motchallenges_scorer_gives_our_scores(exported: Path, preprocessing: bool) -> None:
    """With its defaults but for the names of folders. Without its preprocessing distractors are
    nothing at all, and tracks on them are false."""
    root = exported / "mot"
    told = {"GT_FOLDER": str(root), "TRACKERS_FOLDER": str(root / "trackers"), **QUIET}
    dataset = MotChallenge2DBox({**told, "BENCHMARK": "mdkf", "DO_PREPROC": preprocessing})
    theirs = official(dataset, "pedestrian", root)
    assert set(theirs) == {"ca", "md"}
    for name, found in theirs.items():
        counts = found["COMBINED_SEQ"]["CLEAR"]
        assert min(counts["CLR_TP"], counts["CLR_FN"], counts["CLR_FP"]) > 0
        if preprocessing:
            assert_same(found, [from_above(root, name, f"{k:04d}") for k in (0, 1)])
        else:
            assert counts["CLR_FP"] > 100


def test_rectangles_are_those_of_the_boxes(exported: Path) -> None:
    """About each box's four corners, ten pixels a metre, y downwards, from the edge 150 m from the
    sensor's path; what counts is what `mdkf score` counts."""
    path = exported / "mot" / "worlds" / "0000" / "trace.parquet"
    trace = sim_bridge.read_table(path, Trace)
    rows = read(exported / "mot" / "mdkf-train" / "0000" / "gt" / "gt.txt")
    place = {(f, i): k for k, (f, i) in enumerate(zip(trace.frame, trace.object_id, strict=True))}
    left, top = np.floor(trace.ego.x.min()) - 150, np.ceil(trace.ego.y.max()) + 150
    for row in rows[:: max(1, len(rows) // 200)]:
        k = place[int(row[0]) - 1, int(row[1])]
        c, s = np.cos(trace.yaw[k]), np.sin(trace.yaw[k])
        corners = np.array(
            [
                (
                    trace.x[k] + a * trace.length[k] / 2 * c - b * trace.width[k] / 2 * s,
                    trace.y[k] + a * trace.length[k] / 2 * s + b * trace.width[k] / 2 * c,
                )
                for a in (1, -1)
                for b in (1, -1)
            ]
        )
        pixels = np.column_stack([corners[:, 0] - left, top - corners[:, 1]]) * 10 + 1
        assert_allclose(row[2:4], pixels.min(axis=0), atol=2e-6)
        assert_allclose(row[4:6], np.ptp(pixels, axis=0), atol=2e-6)
        assert_allclose(
            row[8:12], [trace.visible[k], trace.x[k], trace.y[k], trace.z[k]], atol=1e-6
        )
        assert (row[6], row[7]) in ((1, 1), (0, 8))
