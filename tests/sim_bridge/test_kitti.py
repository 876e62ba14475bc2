"""Claim: recorded KITTI data becomes a trace and detections in one world frame, or one clear line.

All files here are made by hand; `test_kitti_recorded` looks at the recordings themselves.
"""

import itertools
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sim_bridge
from mdkf import MotionDynamics, Tracker
from mdkf.tables import CLUTTER, KINDS, REGIMES, FloatArray, TableError
from sim_bridge import kitti_detections, kitti_trace
from sim_bridge.line_of_sight import visible_fraction
from tests.sim_bridge.kitti_folder import (
    CAR,
    GOOD,
    PLAIN,
    POSES,
    STILL,
    detection,
    files,
    label,
    numbers,
    written,
)

# --- frames -----------------------------------------------------------------------------------


def test_a_car_ahead_is_where_a_hand_puts_it(tmp_path: Path) -> None:
    """A car 20 m ahead of the camera and 3 m to the right, its wheels 1.65 m below: in frame 0 at
    (20.27, -3) on the ground; from where the LiDAR has moved to (10, 2) and turned left at
    (10 + 3, 2 + 20.27), half a metre uphill. ry = -pi/2 looks ahead, 0 to the right, pi/2 back."""
    place = (3, 1.65, 20)
    lines = [
        label(0, 4, place, -np.pi / 2),
        "0 -1 DontCare -1 -1 -10 0 0 9 9 -1000 -1000 -1000 -10 -1 -1 -1",
        label(0, 2, place, np.pi / 2, "Van"),
        label(1, 2, place, 0.0, "Van"),
        label(1, 4, place, -np.pi / 2),
        label(1, 5, place, 1.0, "Cyclist"),
    ]
    trace = kitti_trace(written(tmp_path, files(lines)), "0003")
    assert (trace.n_frames, trace.dt) == (2, 0.1)
    assert trace.frame.tolist() == [0, 0, 1, 1]
    assert trace.object_id.tolist() == [2, 4, 2, 4]
    assert [KINDS[kind] for kind in trace.kind] == ["van", "car", "van", "car"]
    np.testing.assert_allclose(trace.x, [20.27, 20.27, 13, 13], atol=1e-12)
    np.testing.assert_allclose(trace.y, [-3, -3, 22.27, 22.27], atol=1e-12)
    np.testing.assert_allclose(trace.z, [0.75, 0.75, 1.25, 1.25], atol=1e-12)
    np.testing.assert_allclose(trace.yaw, [np.pi, 0, 0, np.pi / 2], atol=1e-12)
    assert (trace.yaw > -np.pi).all()
    for name, size in zip(("height", "width", "length"), CAR, strict=True):
        assert (getattr(trace, name) == size).all()
    ego = trace.ego
    np.testing.assert_allclose(
        [ego.x, ego.y, ego.z, ego.yaw], [[0, 10], [0, 2], [1.73, 2.23], [0, np.pi / 2]], atol=1e-12
    )


def test_labels_come_back_from_the_world(tmp_path: Path) -> None:
    """Under rotated and tilted poses and calibration, the inverse matrices take box centres back
    to the labels' places to 1e-9 m; the vertical plane through the yaw cuts the camera's x-z plane
    at the label's ry. Detections take the same way, and a turn too much changes nothing."""
    rng = np.random.default_rng(3)
    tilts = Rotation.from_euler("ZYX", rng.uniform(-1, 1, (6, 3)) * [3.1, 0.1, 0.1]).as_matrix()
    poses = [np.column_stack([r, rng.normal(0, 200, 3)]) for r in tilts]
    rectification = Rotation.from_rotvec([0.01, -0.02, 0.03]).as_matrix()
    turned = Rotation.from_rotvec([0.02, 0.01, -0.01]).as_matrix() @ PLAIN[:, :3]
    mounting = np.column_stack([turned, [0.02, -0.07, -0.3]])
    frame = np.repeat(np.arange(6), 5)
    bottom = rng.uniform([-30, 0, 5], [30, 3, 70], (30, 3))
    ry = rng.uniform(-np.pi, np.pi, 30)
    labels = [label(f, k % 5, bottom[k], ry[k]) for k, f in enumerate(frame)]
    found = [detection(f, bottom[k], ry[k] - 2 * np.pi, k) for k, f in enumerate(frame)]
    folder = written(tmp_path, files(labels, found, poses, rectification, mounting))
    trace = kitti_trace(folder, "0003")
    assert np.abs(trace.z).max() > 100

    to_camera = rectification @ mounting
    for k in range(30):
        pose = poses[frame[k]]
        world = np.array([trace.x[k], trace.y[k], trace.z[k] - 1.73])
        by_lidar = pose[:, :3].T @ (world - pose[:, 3])
        centre = to_camera[:, :3] @ by_lidar + to_camera[:, 3]
        np.testing.assert_allclose(centre, bottom[k] - [0, 0.75, 0], atol=1e-9)
        across = np.array([-np.sin(trace.yaw[k]), np.cos(trace.yaw[k]), 0])
        along = np.array([np.cos(trace.yaw[k]), np.sin(trace.yaw[k]), 0])
        nx, _, nz = to_camera[:, :3] @ (pose[:, :3].T @ across)
        ax, _, az = to_camera[:, :3] @ (pose[:, :3].T @ along)
        ahead = np.array([nz, -nx]) * np.sign(nz * ax - nx * az)  # x, z in the plane, forwards
        assert np.angle(np.exp(1j * (np.arctan2(-ahead[1], ahead[0]) - ry[k]))) == pytest.approx(0)

    detections = kitti_detections(folder, "mine", "0003")
    order = np.lexsort((detections.score, detections.frame))
    for name in ("x", "y", "z", "length", "width", "height"):
        np.testing.assert_array_equal(getattr(detections, name)[order], getattr(trace, name))
    np.testing.assert_allclose(detections.yaw[order], trace.yaw, atol=1e-12)
    assert (np.abs(detections.yaw) <= np.pi).all()
    np.testing.assert_array_equal(detections.source[order], trace.object_id)


def test_a_recording_knows_no_derivatives_but_what_is_hidden(tmp_path: Path) -> None:
    """Regime `unknown`, derivatives NaN; where the label does not know what is hidden (level 3),
    `visible` is the line of sight to the labelled boxes."""
    lines = [
        label(0, 0, (0, 1.65, 12), 0.1, occluded=3),
        label(0, 1, (1, 1.65, 20), 0.1, occluded=3),
    ]
    trace = kitti_trace(written(tmp_path, files(lines)), "0003")
    assert (trace.regime == REGIMES.index("unknown")).all()
    for name in ("vx", "vy", "ax", "ay", "jx", "jy", "yaw_rate"):
        assert np.isnan(getattr(trace, name)).all()
    assert not trace.turning.any()
    names = ("x", "y", "z", "yaw", "length", "width", "height")
    boxes = np.column_stack([getattr(trace, name) for name in names])
    np.testing.assert_array_equal(trace.visible, visible_fraction([0, 0, 1.73], boxes))
    assert trace.visible[0] == 1.0
    assert 0.05 < trace.visible[1] < 0.5


@pytest.mark.parametrize(("level", "bounds"), [(0, (0.8, 1.0)), (1, (0.4, 0.8)), (2, (0.05, 0.4))])
def test_visible_is_what_the_label_says(
    tmp_path: Path, level: int, bounds: tuple[float, float]
) -> None:
    """Of a car in full view and of one behind it, `visible` is brought within the bounds of the
    level of occlusion: much that hides cars has no label, and not all that is labelled hides."""
    lines = [
        label(0, 0, (0, 1.65, 12), 0.1, occluded=level),
        label(0, 1, (0.2, 1.65, 20), 0.1, occluded=level),
    ]
    trace = kitti_trace(written(tmp_path, files(lines)), "0003")
    names = ("x", "y", "z", "yaw", "length", "width", "height")
    boxes = np.column_stack([getattr(trace, name) for name in names])
    seen = visible_fraction([0, 0, 1.73], boxes)
    assert seen[0] == 1.0
    assert seen[1] < 0.4
    np.testing.assert_array_equal(trace.visible, np.clip(seen, *bounds))
    assert trace.visible[0] == bounds[1]


# --- whose detection --------------------------------------------------------------------------


def sources_of(folder: Path, cars: FloatArray, boxes: FloatArray) -> list[int]:
    """Sources of boxes at x, z (n, 2) in one frame with cars 0, 1, ... at (m, 2)."""
    labels = [label(0, k, (x, 1.65, z), 0.0) for k, (x, z) in enumerate(cars)]
    found = [detection(0, (x, 1.65, z), 0.0, k) for k, (x, z) in enumerate(boxes)]
    detections = kitti_detections(written(folder, files(labels, found)), "mine", "0003")
    return detections.source[np.argsort(detections.score)].tolist()


def test_each_detection_belongs_to_one_car_within_two_metres(tmp_path: Path) -> None:
    """Of two boxes on a car the nearer is its own; beyond 2 m none is; two good pairs win over
    the single nearest one, but no near pair is torn apart for two far ones."""
    one = np.array([[0.0, 20.0]])
    assert sources_of(tmp_path, one, np.array([[0.3, 20], [-0.2, 20]])) == [CLUTTER, 0]
    assert sources_of(tmp_path, one, np.array([[1.99, 20]])) == [0]
    assert sources_of(tmp_path, one, np.array([[2.01, 20]])) == [CLUTTER]
    assert sources_of(tmp_path, one, np.array([[0, 22.5]])) == [CLUTTER]
    assert sources_of(tmp_path, np.empty((0, 2)), one) == [CLUTTER]
    two = np.array([[0.0, 20.0], [2.5, 20.0]])
    assert sources_of(tmp_path, two, np.array([[0.9, 20], [-1, 20]])) == [1, 0]
    two = np.array([[0.0, 20.0], [1.9, 20.0]])
    assert sources_of(tmp_path, two, np.array([[1.9, 20], [3.8, 20]])) == [1, CLUTTER]


def test_the_assignment_is_the_best_of_all(tmp_path: Path) -> None:
    """No other one-to-one assignment has a greater sum of 1 - d / 2 m over its pairs."""
    rng = np.random.default_rng(8)
    for _ in range(25):
        cars = rng.uniform([-3, 20], [3, 24], (3, 2))
        boxes = rng.uniform([-3, 20], [3, 24], (4, 2))
        near = np.maximum(1 - np.hypot(*(boxes[:, None] - cars[None]).transpose(2, 0, 1)) / 2, 0)
        best = max(near[list(p), range(3)].sum() for p in itertools.permutations(range(4), 3))
        mine = sources_of(tmp_path, cars, boxes)
        pairs = [(b, source) for b, source in enumerate(mine) if source != CLUTTER]
        assert len({source for _, source in pairs}) == len(pairs)
        assert all(near[pair] > 0 for pair in pairs)
        assert sum(near[pair] for pair in pairs) == pytest.approx(best, abs=1e-12)


def test_nothing_labelled_and_nothing_detected_is_no_error(tmp_path: Path) -> None:
    """Empty files give tables of all frames without rows; a time that is none is refused."""
    folder = written(tmp_path, files([]))
    trace, detections = kitti_trace(folder, "0003"), kitti_detections(folder, "mine", "0003")
    assert (len(trace), trace.n_frames, len(trace.ego)) == (0, 2, 2)
    assert (len(detections), detections.n_frames) == (0, 2)
    with pytest.raises(TableError, match=r"frames of 0.0 s"):
        kitti_trace(folder, "0003", dt=0.0)


def test_recordings_take_the_place_of_simulations(tmp_path: Path) -> None:
    """Trace and detections survive a Parquet file, say where they come from, depend on the files'
    contents alone, and a simulated detector and a tracker take them."""
    folder = written(tmp_path / "a", GOOD)
    trace, found = kitti_trace(folder, "0003"), kitti_detections(folder, "mine", "0003")
    for table in (trace, found):
        path = tmp_path / "table.parquet"
        sim_bridge.write_table(table, path)
        again = sim_bridge.read_table(path, type(table))
        assert again == table
        assert again.provenance == table.provenance
    assert {"source": "kitti", "scenario": "kitti-0003"}.items() <= trace.provenance.items()
    assert found.provenance["detector"] == "mine"
    assert found.provenance["trace"] == trace.content_hash()
    same = kitti_trace(written(tmp_path / "b", GOOD), "0003")
    assert (same, same.provenance) == (trace, trace.provenance)
    moved = {**GOOD, POSES: files([], poses=[STILL, STILL])[POSES]}
    other = kitti_trace(written(tmp_path / "c", moved), "0003")
    assert other.provenance["identity"] != trace.provenance["identity"]
    assert sim_bridge.detect(trace, seed=1) == sim_bridge.detect(same, seed=1)
    assert Tracker(MotionDynamics(order=3)).run(found).n_frames == 2


@pytest.mark.parametrize(
    ("area", "kept"),
    [
        ((0, 0, 9, 9), False),
        ((4, 0, 20, 9), False),  # five ninths of the box
        ((5, 0, 20, 9), True),  # four ninths
        ((9, 0, 20, 9), True),  # touching
        ((20, 20, 30, 30), True),
    ],
)
def test_boxes_where_nothing_is_labelled_can_be_left_out(
    tmp_path: Path, area: tuple[float, ...], kept: bool
) -> None:
    """A box of no label goes if more than half of it in the picture (0, 0 to 9, 9) is in a DontCare
    area of its frame; one with a label stays, as does every box if not asked to go."""
    dont_care = f"0 -1 DontCare -1 -1 -10 {numbers(area)} -1 -1 -1 -1000 -1000 -1000 -10"
    lines = [label(0, 0, (0, 1.65, 12), 0.1), dont_care, label(1, 0, (0, 1.65, 12), 0.1)]
    found = [
        detection(0, (0, 1.65, 12), 0.1, 3.0),
        detection(0, (9, 1.65, 30), 0.1, 2.0),
        detection(1, (9, 1.65, 30), 0.1, 1.0),
    ]
    folder = written(tmp_path, files(lines, found))
    assert len(kitti_detections(folder, "mine", "0003")) == 3
    known = kitti_detections(folder, "mine", "0003", unlabelled=False)
    assert sorted(known.score) == ([1.0, 2.0, 3.0] if kept else [1.0, 3.0])
