"""Claim: what another tracker wrote comes back as what it said, and nothing that it did not say."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import mdkf
import scenarios
from experiments import OcclusionProtocol, score
from experiments.matched import matched
from mdkf import Detections, TableError, Trace, Tracks
from sim_bridge import (
    KittiError,
    detect,
    kitti_detections,
    kitti_trace,
    read_results,
    read_table,
    simulate,
    write_table,
)
from sim_bridge.kitti_world import write_kitti_world
from sim_bridge.mot import write_mot_world
from tests.experiments.commands import shortened
from tests.sim_bridge.kitti_folder import detection, label, written
from tests.sim_bridge.kitti_folder import files as files_of
from tests.tables import trace_of, tracks_of

KITTI = "3 7 Car -1 -1 0.1 10 20 30 40 1.5 1.8 4.5 2.0 1.6 20.0 0.3 8.5"
MOT = "4,7,100.5,200.5,45,18,8.5,-1,-1,-1"


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> tuple[Trace, Detections, Tracks, Path]:
    """Ten seconds of a street, its occluded detections and their tracks, and the files."""
    folder = tmp_path_factory.mktemp("world")
    trace = simulate(scenarios.load(shortened(folder / "own")), 3)
    seen = OcclusionProtocol("mid", 20, 35).apply(detect(trace, seed=3))
    tracks = mdkf.Tracker(mdkf.estimator("md"), "pointrcnn").run(seen)
    write_kitti_world(folder / "kitti", "0000", trace, {}, {"md": tracks}, 60.0)
    everything = np.ones(len(trace), dtype=np.bool_)
    write_mot_world(folder / "mot", "0000", trace, None, {"md": tracks}, everything)
    return trace, seen, tracks, folder


def files(folder: Path) -> list[Path]:
    """The same tracks in both formats."""
    return [
        folder / "kitti" / "tracks" / "md" / "data" / "0000.txt",
        folder / "mot" / "trackers" / "mdkf-train" / "md" / "data" / "0000.txt",
    ]


@pytest.mark.parametrize("k", [0, 1])
def test_tracks_come_back_as_they_were_and_score_the_same(
    world: tuple[Trace, Detections, Tracks, Path], k: int
) -> None:
    """Ids, frames and positions to the decimals written, so HOTA, MOTA, IDF1, GOSPA and the errors
    around the gaps too."""
    trace, seen, tracks, folder = world
    back = read_results(files(folder)[k], trace, seen)
    assert_array_equal(back.frame, tracks.frame)
    assert_array_equal(back.track_id, tracks.track_id)
    for name in ("x", "y", "score"):
        assert_allclose(getattr(back, name), getattr(tracks, name), atol=2e-6, rtol=0)
    ours, theirs = score(trace, tracks), score(trace, back)
    assert len(theirs.gaps) == len(ours.gaps) > 0
    mine, other = ours.summary(), theirs.summary()
    same = ("hota", "deta", "assa", "mota", "idf1", "idsw", "fp", "fn", "gospa", "deleted")
    same += ("position_error", "error_before", "error_gap", "error_after", "gap_median", "followed")
    for name in same:
        assert_allclose(other[name], mine[name], rtol=1e-5, err_msg=name)
    assert mine["hota"] > 50


@pytest.mark.parametrize("k", [0, 1])
def test_what_a_file_does_not_tell_has_no_value(
    world: tuple[Trace, Detections, Tracks, Path], k: int, tmp_path: Path
) -> None:
    """Velocity, covariance and what depends on knowing which frames were coasted; from above, the
    heading and the overlap of boxes as well. Never 0, and the same from a table's file."""
    trace, seen, tracks, folder = world
    back = read_results(files(folder)[k], trace, seen)
    path = tmp_path / "tracks.parquet"
    write_table(back, path)
    assert read_table(path, Tracks) == back
    assert not back.knows_coasting
    assert tracks.knows_coasting
    ours, theirs = score(trace, tracks).summary(), score(trace, read_table(path, Tracks)).summary()
    unknown = ["velocity_error", "velocity_rmse", "nees", "nis", "captured", "lost"]
    unknown += ["heading_error", "backwards"] if k else []
    assert {name for name, value in theirs.items() if np.isnan(value)} == {
        *unknown,
        *(name for name, value in ours.items() if np.isnan(value)),
    }
    if k == 0:
        for similarity in ("bird", "box"):
            mine, other = (score(trace, t, similarity=similarity).hota for t in (tracks, back))  # type: ignore[arg-type]
            assert_allclose(other.hota_mean, mine.hota_mean, rtol=1e-5)
    else:
        with pytest.raises(TableError, match="the tracks have no sizes: similarity 'bird'"):
            matched(trace, back, similarity="bird")


def test_gaps_are_known_from_the_detections_alone(
    world: tuple[Trace, Detections, Tracks, Path],
) -> None:
    """Without them there are none; those of another trace are refused."""
    trace, seen, _, folder = world
    assert len(score(trace, read_results(files(folder)[0], trace)).gaps) == 0
    other = detect(trace_of([(0, 1, 20.0, 0.0)], trace.n_frames))
    with pytest.raises(TableError, match="detections come from another trace"):
        read_results(files(folder)[0], trace, other)
    assert seen.provenance["occlusion"]


def test_by_hand(tmp_path: Path) -> None:
    """The sensor at x = 0, y = 0, z = 0 looks along x. In the camera's axes 2 m right, 20 m ahead
    and the bottom 1.6 m below it: in the world x = 20.27, y = -2, and the middle at 0.75 - 1.68 m.
    From above: 100.5 px right of the edge at -150 m, and so on."""
    trace = trace_of([(0, 1, 20.0, 0.0)], 5)
    path = tmp_path / "0000.txt"
    path.write_text(f"{KITTI}\n")
    back = read_results(path, trace)
    assert (back.frame.tolist(), back.track_id.tolist(), back.score.tolist()) == ([3], [7], [8.5])
    assert_allclose([back.x[0], back.y[0], back.z[0]], [20.27, -2.0, -0.08 - 1.6 + 0.75])
    assert_allclose(back.yaw[0], -0.3 - np.pi / 2)
    path.write_text(f"{MOT}\n")
    back = read_results(path, trace)
    assert (back.frame.tolist(), back.track_id.tolist(), back.score.tolist()) == ([3], [7], [8.5])
    x, y = (100.5 + 22.5 - 1) / 10 - 150, 150 - (200.5 + 9 - 1) / 10
    assert_allclose([back.x[0], back.y[0]], [x, y])
    assert np.isnan([back.z[0], back.yaw[0], back.length[0], back.vx[0], back.cov_xx[0]]).all()


def test_robmots_rows_tell_places_alone(tmp_path: Path) -> None:
    """As its program writes them: world x, y and -1 where sizes belong, ry -10, six digits. The
    place is the box's; size, heading and height are not known, and nothing is made of them."""
    trace = trace_of([(0, 1, 20.0, 0.0)], 5)
    path = tmp_path / "0000.txt"
    row = "3 7 Car -1 -1 0 608 173 609 175 -20.27 -2 -1 2 1.6 20 -10 8.5"
    path.write_text(f"{row}\n{KITTI.replace('3 7', '3 8')}\n")
    back = read_results(path, trace)
    assert_allclose([back.x, back.y], [[20.27] * 2, [-2.0] * 2])
    for name in ("z", "yaw", "length", "width", "height"):
        assert np.isnan(getattr(back, name)).tolist() == [True, False]
    assert not back.knows_boxes()


def test_all_types_count_but_areas_and_no_row_is_no_track(tmp_path: Path) -> None:
    """A tracker of several classes; rows in any order of frames; an empty file."""
    trace = trace_of([(0, 1, 20.0, 0.0)], 5)
    path = tmp_path / "0000.txt"
    cyclist = KITTI.replace("Car", "Cyclist").replace("3 7", "1 8")
    area = KITTI.replace("Car", "DontCare").replace("3 7", "2 -1")
    path.write_text(f"{KITTI}\n{area}\n{cyclist}\n")
    assert read_results(path, trace).track_id.tolist() == [8, 7]
    path.write_text("")
    assert len(read_results(path, trace)) == 0


def replaced(row: str, column: int, value: str) -> str:
    """A row with another value in a column."""
    mark = "," if "," in row else " "
    words = row.split(mark)
    words[column] = value
    return mark.join(words)


@pytest.mark.parametrize(
    ("row", "told"),
    [
        (KITTI + " 1", r"line 2: 19 columns, expected 18: frame track_id type"),
        (KITTI.rpartition(" ")[0], r"line 2: 17 columns, expected 18"),
        (replaced(KITTI, 0, "5"), r"line 2: frame is 5, expected a whole number from 0 to 4"),
        (replaced(KITTI, 0, "1.5"), r"line 2: frame is 1\.5, expected a whole number"),
        (replaced(KITTI, 1, "-1"), r"line 2: track_id is -1, expected a whole number from 0"),
        (replaced(KITTI, 2, "Bus"), r"line 2: type is 'Bus', expected one of Car"),
        (replaced(KITTI, 10, "0"), r"line 2: h is 0, expected a size above 0 m"),
        (replaced(KITTI, 13, "nan"), r"line 2: x is 'nan', expected a number"),
        (replaced(KITTI, 14, "inf"), r"line 2: y is 'inf', expected a number"),
        (replaced(KITTI, 15, "1e300"), r"line 2: z is '1e300', expected a number"),
        (replaced(KITTI, 16, "1_0"), r"line 2: ry is '1_0', expected a number"),
        (replaced(KITTI, 17, "9" * 400), r"line 2: score is '9{40}', expected a number"),
        (KITTI, r"line 2: track_id is 7, expected at most once in a frame"),
        (replaced(KITTI, 16, "\x00"), r"line 2: holds '\\x00', expected ASCII"),
        (MOT + ",1,1", r"line 2: 12 columns, expected 10: frame id left"),
        (MOT.rpartition(",")[0], r"line 2: 9 columns, expected 10"),
        (replaced(MOT, 0, "0"), r"line 2: frame is 0, expected a whole number from 1 to 5"),
        (replaced(MOT, 0, "6"), r"line 2: frame is 6, expected a whole number from 1 to 5"),
        (replaced(MOT, 1, "-1"), r"line 2: id is -1, expected a whole number from 0"),
        (replaced(MOT, 3, "NaN"), r"line 2: top is 'NaN', expected a number"),
        (replaced(MOT, 4, "0"), r"line 2: w is 0, expected a size above 0 px"),
        (replaced(MOT, 5, "-18"), r"line 2: h is -18, expected a size above 0 px"),
        (replaced(MOT, 6, ""), r"line 2: conf is '', expected a number"),
        (MOT, r"line 2: id is 7, expected at most once in a frame"),
    ],
)
def test_bad_rows_are_one_line(tmp_path: Path, row: str, told: str) -> None:
    """The file, its line, and what was expected there."""
    trace = trace_of([(0, 1, 20.0, 0.0)], 5)
    path = tmp_path / "0000.txt"
    path.write_text(f"{MOT if ',' in row else KITTI}\n{row}\n")
    with pytest.raises(KittiError, match=rf"^{re.escape(str(path))}: {told}") as refused:
        read_results(path, trace)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (lambda t: {"cov_xy": np.full(len(t), np.nan)}, "cov_xy is nan, expected finite"),
        (lambda t: {"vx": np.full(len(t), np.nan)}, "vx is nan, expected finite"),
        (lambda t: {"x": np.full(len(t), np.nan)}, "x is nan, expected finite"),
        (lambda t: {"yaw": np.full(len(t), np.nan)}, "yaw is nan, expected finite"),
        (lambda t: {"cov_xx": -t.cov_xx}, "expected a positive covariance"),
        (
            lambda t: {"vx": np.full(len(t), np.inf), "vy": np.full(len(t), np.nan)},
            "vx is inf, expected finite",
        ),
    ],
)
def test_unknown_is_told_of_whole_states_only(
    spoil: Callable[[Tracks], dict[str, np.ndarray]], told: str
) -> None:
    """Half a velocity or covariance is no unknown one; a position is always there."""
    tracks = tracks_of([(0, 1, 2.0, 3.0), (1, 1, 2.0, 3.0)], 2)
    columns = {**tracks.columns(), **spoil(tracks)}
    with pytest.raises(TableError, match=told):
        Tracks.from_columns(columns, n_frames=2, dt=0.1)


def test_a_recorded_worlds_results_are_in_its_own_cameras_axes(tmp_path: Path) -> None:
    """The same box as a detection of the recording and as a track of it: one place in the world,
    in the frame in which the sensor has turned left, too."""
    place = ([3.0, 1.65, 20.0], 0.3)
    found = [detection(k, *place, 5.0) for k in (0, 1)]
    root = written(tmp_path / "root", files_of([label(0, 1, *place)], found))
    detected = kitti_detections(root, "mine", "0003")
    path = tmp_path / "0003.txt"
    path.write_text("".join(f"{label(k, 4, *place)} 5.0\n" for k in (0, 1)))
    tracks = read_results(path, kitti_trace(root, "0003"), root=root)
    for name in ("frame", "x", "y", "z", "yaw", "length", "width", "height", "score"):
        assert_array_equal(getattr(tracks, name), getattr(detected, name), err_msg=name)


@pytest.mark.parametrize("row", [KITTI, MOT])
def test_no_file_is_a_surprise(tmp_path: Path, row: str) -> None:
    """Four rows with one or two words replaced at random by others: tracks that hold their
    contract, or one line that names the file."""
    rng, mark = np.random.default_rng(5), "," if "," in row else " "
    words = ["nan", "-inf", "1e9", "-1e9", "1e10", "0", "-0", "-1", "-10", "4", "5", "2.5", "Car"]
    words += ["", "0x1", "1e-300", "Van", "\u0663", "\t", "\n", "9" * 30, mark]
    trace = trace_of([(0, 1, 20.0, 0.0)], 5)
    path = tmp_path / "0000.txt"
    read, told = 0, list[str]()
    for _ in range(400):
        rows = [replaced(row, 1, str(k)).split(mark) for k in range(4)]
        for _ in range(rng.integers(1, 3)):
            line = rows[rng.integers(len(rows))]
            line[rng.integers(len(line))] = words[rng.integers(len(words))]
        path.write_text("".join(f"{mark.join(line)}\n" for line in rows), encoding="utf-8")
        try:
            read_results(path, trace).validate()
            read += 1
        except KittiError as error:
            told.append(str(error))
    assert min(read, len(told)) > 40
    assert all(line.startswith(f"{path}: ") and "\n" not in line for line in told)
