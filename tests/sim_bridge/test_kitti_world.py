"""Claim: a simulated world in KITTI's layout is the same world to whoever reads it.

Read back by this project's reader of recordings, by the formulas of KITTI's devkit for navigation,
and as AB3DMOT reads detections.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import scenarios
import sim_bridge
from mdkf.tables import KINDS, Detections, EgoPath, FloatArray, TableError, Trace
from sim_bridge import kitti_detections, kitti_trace
from sim_bridge.kitti import VISIBLE
from sim_bridge.kitti_image import KITTI_PICTURE, NOWHERE, pictures
from sim_bridge.kitti_world import occlusion_levels, write_kitti_world, write_sequences
from sim_bridge.virtual_camera import MOUNTING, PROJECTION, oxts_text
from tests.experiments.commands import shortened
from tests.tables import trace_of

REACH = 60.0
WRITTEN = 1e-6  # [m, rad] of a box: six decimals, twice where a corner is turned


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> tuple[Trace, Detections, Path]:
    """Ten seconds of a street with buses and bicycles, what was detected there, and its files."""
    folder = tmp_path_factory.mktemp("world")
    trace = sim_bridge.simulate(scenarios.load(shortened(folder / "own")), 3)
    found = sim_bridge.detect(trace, seed=3)
    out = folder / "kitti"
    write_kitti_world(out, "0000", trace, {"pointrcnn": found}, {}, REACH)
    write_sequences(out, {"0000": trace.n_frames})
    return trace, found, out


def test_truth_read_back_is_the_truth(world: tuple[Trace, Detections, Path]) -> None:
    """Every car and van within reach, wherever the camera looks: its id, kind, box and frame, and
    the sensor's path; no other."""
    trace, _, out = world
    kinds = np.isin(trace.kind, [KINDS.index("car"), KINDS.index("van")])
    told = trace.take(kinds & (trace.sensor_distance() <= REACH))
    back = kitti_trace(out, "0000")
    assert len(told) > 1000
    for name in ("frame", "object_id", "kind"):
        assert_array_equal(getattr(back, name), getattr(told, name))
    for name in ("x", "y", "z", "length", "width", "height"):
        assert_allclose(getattr(back, name), getattr(told, name), atol=WRITTEN, rtol=0)
    assert_allclose(np.exp(1j * back.yaw), np.exp(1j * told.yaw), atol=WRITTEN, rtol=0)
    for name in ("x", "y", "z", "yaw"):
        assert_allclose(getattr(back.ego, name), getattr(trace.ego, name), atol=1e-9, rtol=0)
    bounds = np.array(VISIBLE)[occlusion_levels(told.visible)]
    assert (back.visible >= bounds[:, 0]).all()
    assert (back.visible <= bounds[:, 1]).all()


def test_detections_read_back_are_the_detections(world: tuple[Trace, Detections, Path]) -> None:
    """All of them, behind the camera too: boxes and scores, in the order of frames."""
    _, found, out = world
    back = kitti_detections(out, "pointrcnn", "0000")
    assert len(back) == len(found)
    rows = [np.lexsort((table.score, table.x, table.frame)) for table in (found, back)]
    for name in ("frame", "x", "y", "z", "length", "width", "height", "score"):
        mine, other = (getattr(t, name)[r] for t, r in zip((found, back), rows, strict=True))
        assert_allclose(other, mine, atol=WRITTEN, rtol=0, err_msg=name)


def test_ab3dmot_reads_the_same_detections(world: tuple[Trace, Detections, Path]) -> None:
    """Its 15 columns, read as it reads them, are those of the other file in its own order."""
    _, found, out = world
    theirs = np.loadtxt(out / "ab3dmot" / "pointrcnn_Car_val" / "0000.txt", delimiter=",")
    lines = (out / "detections" / "pointrcnn" / "0000.txt").read_text().splitlines()
    rows = [line.split() for line in lines]
    assert theirs.shape == (len(found), 15)
    frame, alpha, image = (
        [float(r[0]) for r in rows],
        [r[4] for r in rows],
        [r[5:9] for r in rows],
    )
    box, score = [r[9:16] for r in rows], [r[16] for r in rows]
    columns = [np.array(part, dtype=float).reshape(len(rows), -1) for part in (frame, alpha)]
    picture, space, scores = (
        np.array(part, dtype=float).reshape(len(rows), -1) for part in (image, box, score)
    )
    kind = np.full((len(rows), 1), 2.0)
    assert_array_equal(theirs, np.hstack([columns[0], kind, picture, scores, space, columns[1]]))


def after(words: list[str], name: str, count: int) -> FloatArray:
    """The numbers that follow a name among a file's words."""
    begin = words.index(name) + 1
    return np.array(words[begin : begin + count], dtype=float)


def test_robmot_finds_the_same_camera_and_poses(world: tuple[Trace, Detections, Path]) -> None:
    """It looks for words, `P2:`, `R_rect` and `Tr_velo_cam`, and for a frame's number among those
    of its poses, each with twelve more."""
    trace, _, out = world
    folder = out / "robmot" / "kitti" / "LiDAR" / "training"
    words = (folder / "calib" / "0000.txt").read_text().split()
    assert_array_equal(after(words, "P2:", 12).reshape(3, 4), PROJECTION)
    assert_array_equal(after(words, "R_rect", 9).reshape(3, 3), np.eye(3))
    assert_array_equal(after(words, "Tr_velo_cam", 12).reshape(3, 4), MOUNTING)
    poses = (folder / "pose" / "0000.txt").read_text().split()
    assert poses[::13] == [str(k) for k in range(trace.n_frames)]
    assert (folder / "pose" / "0000.txt").read_text() == (out / "pose" / "0000.txt").read_text()


def poses_by_the_devkit(text: str) -> FloatArray:
    """Poses (n, 4, 4) relative to the first, as KITTI's `convertOxtsToPose` has them."""
    radius, poses = 6378137.0, []
    rows = np.array([[float(word) for word in line.split()] for line in text.splitlines()])
    assert rows.shape[1] == 30
    scale = np.cos(rows[0, 0] * np.pi / 180)
    for latitude, longitude, altitude, roll, pitch, yaw in rows[:, :6]:
        x = scale * longitude * np.pi * radius / 180
        y = scale * radius * np.log(np.tan((90 + latitude) * np.pi / 360))
        (cr, cp, cy), (sr, sp, sy) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
        about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
        about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
        about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = about_z @ about_y @ about_x, (x, y, altitude)
        poses.append(pose)
    return np.linalg.inv(poses[0]) @ np.stack(poses)


def test_the_devkit_reads_the_poses_from_the_navigation() -> None:
    """A path that turns and climbs, far from the origin: every pose relative to the first, and the
    speed of a straight stretch."""
    k = np.arange(80)
    bend = 40 * np.sin(k / 25)
    columns = {"frame": k, "x": 900 + 1.3 * k, "y": bend - 300, "z": 2 + 0.01 * k, "yaw": k / 9.0}
    ego = EgoPath.from_columns(columns, n_frames=80, dt=0.1)
    poses = np.tile(np.eye(4), (80, 1, 1))
    cosine, sine = np.cos(ego.yaw), np.sin(ego.yaw)
    poses[:, 0, 0], poses[:, 0, 1], poses[:, 1, 0], poses[:, 1, 1] = cosine, -sine, sine, cosine
    poses[:, :3, 3] = np.column_stack([ego.x, ego.y, ego.z])
    back = poses_by_the_devkit(oxts_text(ego))
    assert_allclose(back, np.linalg.inv(poses[0]) @ poses, atol=1e-7, rtol=0)
    straight = replace(ego, y=np.zeros(80), yaw=np.zeros(80))
    forward = [float(line.split()[8]) for line in oxts_text(straight).splitlines()]
    assert_allclose(forward, 13.0, atol=1e-9)


def corners_in_the_picture(row: list[str]) -> FloatArray:
    """Pixels and depth (8, 3) of a label's corners, from its columns alone."""
    height, width, length, x, y, z, ry = map(float, row[10:17])
    along, across = np.array([np.cos(ry), 0, -np.sin(ry)]), np.array([np.sin(ry), 0, np.cos(ry)])
    middle = np.array([x, y, z])
    corners = np.array(
        [
            middle + a * length / 2 * along + b * width / 2 * across - np.array([0, c * height, 0])
            for a in (1, -1)
            for b in (1, -1)
            for c in (0, 1)
        ]
    )
    pixels = np.column_stack([corners, np.ones(8)]) @ PROJECTION.T
    return np.column_stack([pixels[:, :2] / pixels[:, 2:], pixels[:, 2]])


def test_labels_tell_what_the_picture_shows(world: tuple[Trace, Detections, Path]) -> None:
    """Truncated 0: the box spans its corners, all of them in the picture. 1 and 2: some are not.
    Without a box in the picture: it reaches behind the camera, or all corners are beside it."""
    _, _, out = world
    edge = np.array([KITTI_PICTURE.right, KITTI_PICTURE.bottom])
    seen = {0: 0, 1: 0, 2: 0, "nowhere": 0}
    for line in (out / "label_02" / "0000.txt").read_text().splitlines():
        row = line.split()
        if row[2] == "DontCare":
            continue
        image, corners = np.array(row[6:10], dtype=float), corners_in_the_picture(row)
        level, ahead = int(row[3]), (corners[:, 2] > 0.1).all()
        inside = ((corners[:, :2] >= 0) & (corners[:, :2] <= edge)).all()
        if tuple(image) == NOWHERE:
            seen["nowhere"] += 1
            assert level == 2
            beside = (corners[:, :2] <= 0).all(axis=0) | (corners[:, :2] >= edge).all(axis=0)
            assert beside.any() or not ahead
            continue
        seen[level] += 1
        if ahead:
            whole = [*corners[:, :2].min(axis=0), *corners[:, :2].max(axis=0)]
            assert_allclose(image, np.clip(whole, 0, [*edge, *edge]), atol=1e-3)
            share = np.prod(image[2:] - image[:2]) / np.prod(np.subtract(whole[2:], whole[:2]))
            assert level == (0 if inside else 1 if share >= 0.5 else 2)
    assert min(seen.values()) > 0, seen


def test_levels_of_occlusion_by_hand() -> None:
    """KITTI's four levels: full view, partly, largely hidden, unknown."""
    visible = np.array([1.0, 0.8, 0.79, 0.4, 0.39, 0.05, 0.049, 0.0])
    assert occlusion_levels(visible).tolist() == [0, 0, 1, 1, 2, 2, 3, 3]


def test_what_has_no_label_that_counts_has_an_area(tmp_path: Path) -> None:
    """Ahead of the camera a car, a bus, a far car and a wall: labels of the first two with their
    types, areas over the bus and the far car."""
    rows = [(0, 1, 20.0, 0.0), (0, 2, 25.0, 8.0), (0, 3, 70.0, -5.0), (0, 4, 30.0, -9.0)]
    kinds = [KINDS.index(kind) for kind in ("car", "bus", "car", "wall")]
    trace = trace_of(rows, 1, kind=kinds)
    write_kitti_world(tmp_path, "0000", trace, {}, {}, REACH)
    lines = (tmp_path / "label_02" / "0000.txt").read_text().splitlines()
    told = sorted((row[2], int(row[1]), row[6:10]) for row in map(str.split, lines))
    assert [(kind, identifier) for kind, identifier, _ in told] == [
        *(("Car", 1), ("DontCare", -1), ("DontCare", -1), ("Misc", 2))
    ]
    assert told[3][2] in (told[1][2], told[2][2])


def test_the_pictures_size_is_told_not_guessed(tmp_path: Path) -> None:
    """A car that stands before a standing sensor ends at the same pixel in every frame; by labels
    alone that would be taken for the picture's edge."""
    trace = trace_of([(k, 1, 20.0, 2.0) for k in range(9)], 9)
    write_kitti_world(tmp_path, "0000", trace, {}, {}, REACH)
    write_sequences(tmp_path, {"0000": 9})
    assert pictures(tmp_path, ["0000"]) == {"0000": KITTI_PICTURE}
    calibration = tmp_path / "calib" / "0000.txt"
    text = calibration.read_text()
    calibration.write_text("".join(text.splitlines(keepends=True)[:-1]))
    assert pictures(tmp_path, ["0000"])["0000"].right < 600
    calibration.write_text(text.replace("S_rect_02: 1.242000000000e+03", "S_rect_02: 0"))
    with pytest.raises(sim_bridge.KittiError, match=r"0000\.txt: line 8: S_rect_02 is 0 x 375"):
        pictures(tmp_path, ["0000"])


def test_the_camera_is_mounted_as_the_calibration_says() -> None:
    """A place 10 m ahead of the LiDAR and 1 m to its left is 9.73 m before the camera, 1 m left of
    its axis and 0.08 m above it."""
    assert_allclose(MOUNTING @ [10.0, 1.0, 0.0, 1.0], [-1.0, -0.08, 9.73])


def test_another_frame_rate_is_refused(tmp_path: Path) -> None:
    """KITTI's files do not tell the time between frames: they would be read as 10 Hz."""
    trace = trace_of([(0, 1, 20.0, 0.0)], 1)
    ego = replace(trace.ego, dt=0.05)
    with pytest.raises(TableError, match=r"frames of 0\.05 s, expected 0\.1 s"):
        write_kitti_world(tmp_path, "0000", replace(trace, dt=0.05, ego=ego), {}, {}, REACH)
    assert list(tmp_path.iterdir()) == []
