"""Claim: boxes get into the picture of their camera as they are seen, and into files as they are.

All recordings here are made by hand; `test_kitti_recorded` looks at KITTI's own.
"""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mdkf import Detections, Tracks
from mdkf.tables import FloatArray
from sim_bridge.kitti_files import CameraBoxes, KittiError, read_detections
from sim_bridge.kitti_image import NEAR, Camera, Picture, in_picture, pictures
from sim_bridge.kitti_rig import Rig
from sim_bridge.kitti_writing import write_boxes
from tests.sim_bridge.kitti_folder import files, label, numbers, written
from tests.tables import random_detections, random_tracks

FOCAL = 700.0
PROJECTION = np.array([[FOCAL, 0, 600, 0], [0, FOCAL, 180, 0], [0, 0, 1, 0]])
WIDE = Picture(1241.0, 374.0)


def seen(
    place: tuple[float, float, float], ry: float, picture: Picture = WIDE
) -> tuple[bool, list[float]]:
    """A box 4 m long, 1.5 m high and 2 m wide in the picture."""
    size = np.array([[4.0, 1.5, 2.0]])
    inside, image = in_picture(np.array([place]), size, np.array([ry]), PROJECTION, picture)
    return bool(inside[0]), image[0].tolist()


def test_boxes_are_where_a_hand_draws_them() -> None:
    """A car 12 m ahead that looks ahead ends 10 m from the camera: 1 m to each side is 70 px, its
    wheels 1.5 m below 105 px. Across the view it is 2 m to each side and 11 m away."""
    assert seen((0, 1.5, 12), -np.pi / 2) == (True, pytest.approx([530, 180, 670, 285]))
    across = 2 * FOCAL / 11
    expected = [600 - across, 180, 600 + across, 180 + 1.5 * FOCAL / 11]
    assert seen((0, 1.5, 12), 0.0) == (True, pytest.approx(expected))
    left, top, right, bottom = seen((0, 1.5, 12), 0.0, Picture(1242, 375, robmot=True))[1]
    assert [left, top, right, bottom] == [round(value) for value in expected]


def test_boxes_are_cut_at_the_edges_and_left_out_beyond() -> None:
    """To the right: half in the picture, then outside; a picture half as wide ends before."""
    inside, (left, _, right, _) = seen((9.5, 1.5, 12), -np.pi / 2)
    assert inside
    assert left == pytest.approx(600 + 8.5 * FOCAL / 14)
    assert right == 1241
    assert not seen((14.5, 1.5, 12), -np.pi / 2)[0]
    assert not seen((9.5, 1.5, 12), -np.pi / 2, Picture(620, 374))[0]
    assert not seen((0, -8, 12), -np.pi / 2)[0]


def test_what_is_behind_the_camera_is_not_seen() -> None:
    """A car beside the camera is seen as far as it is ahead of it, one whose middle is behind it
    not at all; RobMOT writes neither."""
    inside, (left, _, right, bottom) = seen((3, 1.5, 1), -np.pi / 2)
    assert inside
    assert left == pytest.approx(600 + 2 * FOCAL / 3)  # its far end, 3 m ahead
    assert (right, bottom) == (1241, 374)
    assert not seen((3, 1.5, 1), -np.pi / 2, Picture(1242, 375, robmot=True))[0]
    assert not seen((3, 1.5, -0.5), -np.pi / 2)[0]
    assert not seen((0, 1.5, -12), -np.pi / 2)[0]


def test_near_boxes_span_what_their_points_do() -> None:
    """Points spread over the edges of random boxes about the camera, those in front of it, span
    what the boxes do, to the points' spacing."""
    rng = np.random.default_rng(5)
    n = 60
    bottom = rng.uniform([-6, 0, 0.05], [6, 3, 8], (n, 3))
    size, ry = rng.uniform(1, 5, (n, 3)), rng.uniform(-np.pi, np.pi, n)
    huge = Picture(1e6, 1e6)
    turned = PROJECTION + np.array([[0, 0, 5e5, 0], [0, 0, 5e5, 0], [0, 0, 0, 0]])  # none negative
    inside, image = in_picture(bottom, size, ry, turned, huge)
    assert inside.all()
    reach_behind = 0
    for k in range(n):
        points = edge_points(bottom[k], size[k], ry[k])
        front = points[points[:, 2] >= NEAR]
        reach_behind += len(front) < len(points)
        pixels = front[:, :2] / front[:, 2:] * FOCAL + [500_600, 500_180]
        expected = np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])
        # Near the camera a step of 0.6 mm between points is 4 px, and 0.6 % of the depth.
        slack = 5.0 + 0.01 * np.abs(expected - 5e5)
        assert (np.abs(image[k] - expected) <= slack).all()
    assert 15 < reach_behind < 55


def edge_points(bottom: FloatArray, size: FloatArray, ry: float) -> FloatArray:
    """Points (n, 3) on a box's twelve edges."""
    length, height, width = size
    steps = np.linspace(0, 1, 8001)
    unit = []
    for axis in range(3):
        for a in (0.0, 1.0):
            for b in (0.0, 1.0):
                edge = np.empty((len(steps), 3))
                edge[:, axis], edge[:, axis - 1], edge[:, axis - 2] = steps, a, b
                unit.append(edge)
    own = (np.concatenate(unit) - [0.5, 1.0, 0.5]) * [length, height, width]
    return Rotation.from_euler("y", ry).apply(own) + bottom


def test_boxes_come_back_from_the_world() -> None:
    """Under tilted poses that turn, the world's boxes have in their camera the place and ry that
    they came from."""
    rng = np.random.default_rng(3)
    n = 300
    poses = Rotation.from_euler("ZYX", rng.uniform(-1, 1, (n, 3)) * [3.1, 0.1, 0.1]).as_matrix()
    axes = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # x right, y down, z forward
    camera = np.eye(4)
    camera[:3, :3] = Rotation.from_euler("ZYX", [0.01, -0.02, 0.01]).as_matrix() @ axes
    camera[:3, 3] = [0.27, 0.0, -0.08]
    rig = Rig(camera, np.round(poses, 6), rng.uniform(-500, 500, (n, 3)))
    boxes = CameraBoxes(
        line=np.arange(n),
        frame=np.arange(n),
        name=["Car"] * n,
        bottom=rng.uniform([-30, 0, 2], [30, 3, 80], (n, 3)),
        length=rng.uniform(3, 5, n),
        width=rng.uniform(1.5, 2, n),
        height=rng.uniform(1.3, 2, n),
        ry=rng.uniform(-np.pi, np.pi, n),
        image=np.zeros((n, 4)),
        truncated=np.zeros(n, dtype=np.int64),
        occluded=np.zeros(n, dtype=np.int64),
        last=np.zeros(n),
    )
    table = Detections.from_columns(
        {"frame": boxes.frame, "score": boxes.last, "source": boxes.line, **rig.world_boxes(boxes)},
        n_frames=n,
        dt=0.1,
    )
    bottom, ry = rig.camera_boxes(table)
    np.testing.assert_allclose(bottom, boxes.bottom, atol=1e-9)
    np.testing.assert_allclose(np.angle(np.exp(1j * (ry - boxes.ry))), 0.0, atol=1e-12)


# --- the picture's size -----------------------------------------------------------------------


def label_ending(frame: int, track: int, right: float, bottom: float) -> str:
    words = label(frame, track, (3, 1.65, 20), 0.0).split()
    words[8:10] = [f"{right}", f"{bottom}"]
    return " ".join(words)


@pytest.mark.parametrize(
    ("ends", "expected"),
    [
        ([(1223, 369), (1223, 200), (700.5, 369)], (1223, 369)),
        ([(1223, 369), (1100, 200)], (1241, 374)),  # once may be chance
        ([(640.25, 200), (640.25, 201)], (640.25, 374)),
        ([(1300, 200), (9, 500)], (1300, 500)),
        ([], (1241, 374)),
    ],
)
def test_the_picture_ends_where_labels_end(
    tmp_path: Path, ends: list[tuple[float, float]], expected: tuple[float, float]
) -> None:
    """At the greatest coordinate that two labels share; else where KITTI's usually does, or at
    the greatest coordinate that there is."""
    labels = [label_ending(0, track, *end) for track, end in enumerate(ends)]
    root = written(tmp_path, files(labels))
    assert pictures(root, ["0003"]) == {"0003": Picture(*expected)}


def test_one_camera_has_one_picture(tmp_path: Path) -> None:
    """A sequence in which nothing leaves the picture has that of another of the same P2."""
    content = files([label_ending(0, track, 1223, 369) for track in range(2)])
    content["evaluate_tracking.seqmap.training"] += [
        f"{name} empty 000000 000002" for name in ("0004", "0005", "0006")
    ]
    content["label_02/0004.txt"] = content["label_02/0005.txt"] = []
    content["calib/0004.txt"] = content["calib/0003.txt"]
    content["calib/0005.txt"] = [f"P2: {numbers(2 * np.eye(3, 4))}"]
    root = written(tmp_path, content)
    found = pictures(root, ["0004", "0005"])
    assert found == {"0004": Picture(1223, 369), "0005": Picture(1241, 374)}
    with pytest.raises(KittiError, match=r"calib/0006\.txt: no such file"):
        pictures(root, ["0006"])


# --- files ------------------------------------------------------------------------------------


@pytest.fixture
def camera() -> Camera:
    """A camera that looks along x, 20 m above and behind 12 frames of random boxes."""
    axes = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    still = np.broadcast_to(np.eye(3), (12, 3, 3))
    return Camera(Rig(axes, still, np.full((12, 3), [-150.0, 0, 0])), PROJECTION, WIDE)


@pytest.mark.parametrize("seed", range(5))
def test_files_hold_the_numbers_in_memory(tmp_path: Path, camera: Camera, seed: int) -> None:
    """Detections that are written and read again are the same to the last bit, and those in the
    picture are all there."""
    table = random_detections(np.random.default_rng(seed), 60)
    boxes = camera.boxes(table)
    assert 10 < len(boxes.row) < 60
    write_boxes(tmp_path / "0003.txt", table, boxes)
    again = read_detections(tmp_path / "0003.txt", 12)
    for name in ("frame", "bottom", "length", "width", "height", "ry", "image"):
        np.testing.assert_array_equal(getattr(again, name), getattr(boxes, name), err_msg=name)
    np.testing.assert_allclose(again.last, table.score[boxes.row], rtol=0, atol=1e-6)


def test_tracks_have_their_ids_and_scores(tmp_path: Path, camera: Camera) -> None:
    """`frame track_id Car -1 -1 alpha x1 y1 x2 y2 h w l x y z ry score`, by frame and track;
    alpha is ry against the ray to the box."""
    table = random_tracks(np.random.default_rng(1), 50)
    boxes = camera.boxes(table)
    write_boxes(tmp_path / "0003.txt", table, boxes)
    rows = [line.split(" ") for line in (tmp_path / "0003.txt").read_text().splitlines()]
    assert len(rows) == len(boxes.row) > 10
    assert {(len(row), *row[2:5]) for row in rows} == {(18, "Car", "-1", "-1")}
    keys = [(int(row[0]), int(row[1])) for row in rows]
    assert keys == sorted(keys)
    assert keys == list(zip(table.frame[boxes.row], table.track_id[boxes.row], strict=True))
    values = np.array([row[5:] for row in rows], dtype=np.float64)
    alpha, height, x, z, ry, score = values[:, [0, 5, 8, 10, 11, 12]].T
    np.testing.assert_allclose(np.exp(1j * (alpha + np.arctan2(x, z))), np.exp(1j * ry), atol=1e-5)
    np.testing.assert_allclose(height, table.height[boxes.row], atol=1e-6)
    np.testing.assert_allclose(score, table.score[boxes.row], atol=1e-6)


def test_nothing_in_the_picture_is_an_empty_file(tmp_path: Path, camera: Camera) -> None:
    """Of tracks behind the camera, and of none at all; an old file is replaced."""
    away = Camera(
        Rig(camera.rig.camera, camera.rig.rotation, camera.rig.position + 900.0), *PICTURE
    )
    for table in (random_tracks(np.random.default_rng(2), 40), no_tracks()):
        path = tmp_path / "0003.txt"
        path.write_text("old")
        write_boxes(path, table, away.boxes(table))
        assert path.read_text() == ""


PICTURE = PROJECTION, WIDE


def no_tracks() -> Tracks:
    return random_tracks(np.random.default_rng(0), 0)


def test_a_file_appears_whole_or_not_at_all(tmp_path: Path, camera: Camera) -> None:
    """Where the folder is missing nothing is left behind, and the error names the file."""
    table = random_detections(np.random.default_rng(1), 20)
    with pytest.raises(OSError, match="No such file") as refused:
        write_boxes(tmp_path / "none" / "0003.txt", table, camera.boxes(table))
    assert refused.value.filename == str(tmp_path / "none" / "0003.txt")
    assert list(tmp_path.iterdir()) == []
