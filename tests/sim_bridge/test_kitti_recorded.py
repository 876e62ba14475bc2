"""Claim: in the world frame, KITTI's parked cars stand, moving ones look where they go, and
detections lie on their labels.

The recordings are read from the folder `MDKF_KITTI`, by default `../shared/kitti`.
"""

import os
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import scenarios
import sim_bridge
from experiments.metrics import image_iou
from mdkf.tables import CLUTTER, Detections, FloatArray, Trace
from sim_bridge import kitti_detections, kitti_trace
from sim_bridge.kitti_files import (
    read_detections,
    read_labels,
    read_projection,
    read_sequences,
)
from sim_bridge.kitti_image import KITTI_PICTURE, NEAR, Camera, in_picture, pictures

ROOT = Path(__file__).resolve().parents[2]
RECORDED = Path(os.environ.get("MDKF_KITTI", ROOT.parent / "shared" / "kitti"))
pytestmark = pytest.mark.skipif(
    not (RECORDED / "label_02").is_dir(), reason=f"no KITTI data in {RECORDED} (MDKF_KITTI)"
)

DETECTORS = ("pointrcnn", "pvcnn", "second_iou")
SOME = ("0001", "0007", "0009", "0011", "0014", "0020")  # parked cars in all, moving ones too


@cache
def trace_of(sequence: str) -> Trace:
    return kitti_trace(RECORDED, sequence)


@cache
def detections_of(detector: str, sequence: str) -> Detections:
    return kitti_detections(RECORDED, detector, sequence)


def lives(trace: Trace) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
    """Frame, place as x + iy [m] and yaw [rad] of every object, within 30 m of the sensor."""
    near = trace.take(trace.sensor_distance() < 30.0)
    return [
        (near.frame[rows].astype(float), near.x[rows] + 1j * near.y[rows], near.yaw[rows])
        for rows in (near.rows_of(int(i)) for i in near.ids())
    ]


def test_every_row_of_every_sequence_is_read() -> None:
    """As many frames as the sequence map says, 8008 in all, and one row per label of a car or a
    van, 30601 in all (one sequence has none)."""
    frames = rows = 0
    for line in (RECORDED / "seqmap.txt").read_text().splitlines():
        sequence, _, _, count = line.split()
        trace = trace_of(sequence)
        text = (RECORDED / "label_02" / f"{sequence}.txt").read_text()
        assert trace.n_frames == len(trace.ego) == int(count)
        assert len(trace) == text.count(" Car ") + text.count(" Van ")
        frames += trace.n_frames
        rows += len(trace)
    assert (frames, rows) == (8008, 30601)


def test_parked_cars_stay_where_they_are() -> None:
    """Cars that end within 1 m of where they were first seen spread by 0.03 to 0.24 m, typically
    0.07 m, while the sensor drives past."""
    spreads = []
    for sequence in SOME:
        for frame, place, _ in lives(trace_of(sequence)):
            if len(frame) >= 20 and abs(place[:5].mean() - place[-5:].mean()) < 1.0:
                spreads.append(np.sqrt(np.mean(np.abs(place - place.mean()) ** 2)))
    assert len(spreads) > 100
    assert 0.04 < np.median(spreads) < 0.1
    assert np.quantile(spreads, 0.95) < 0.24


def test_moving_cars_look_where_they_go() -> None:
    """Over half a second and at least 2 m, the direction of motion is that of the yaw in its
    middle: to 0.04 rad in the median, and hardly ever the opposite."""
    errors = []
    for sequence in SOME:
        for frame, place, yaw in lives(trace_of(sequence)):
            moved = place[6:] - place[:-6]
            going = (frame[6:] - frame[:-6] == 6) & (np.abs(moved) > 2.0)
            errors.append(np.angle(moved * np.exp(-1j * yaw[3:-3]))[going])
    off = np.abs(np.concatenate(errors))
    assert len(off) > 500
    assert np.median(off) < 0.04
    assert (off > 1.0).mean() < 0.01


def test_cars_stand_on_the_ground_under_the_sensor() -> None:
    """Where recordings begin, the bottoms of cars within 25 m are at z = 0, to 0.35 m: roads are
    not flat."""
    bottoms = []
    for sequence in SOME:
        trace = trace_of(sequence).between(0, 5)
        near = trace.sensor_distance() < 25.0
        bottoms.append((trace.z - trace.height / 2)[near])
    assert abs(np.median(np.concatenate(bottoms))) < 0.35


@pytest.mark.parametrize("detector", DETECTORS)
def test_detections_lie_on_their_labels(detector: str) -> None:
    """The median distance to the label is below 0.15 m, heights and yaws agree too; most labels
    within 30 m have a detection, and a label has at most one in a frame."""
    apart, above, turned, share = [], [], [], []
    for sequence in SOME:
        trace, found = trace_of(sequence), detections_of(detector, sequence)
        keys = trace.frame * 10_000 + trace.object_id
        mine = found.source != CLUTTER
        wanted = found.frame[mine] * 10_000 + found.source[mine]
        assert len(np.unique(wanted)) == len(wanted)
        rows = np.searchsorted(keys, wanted)
        np.testing.assert_array_equal(keys[rows], wanted)
        apart.append(np.hypot(found.x[mine] - trace.x[rows], found.y[mine] - trace.y[rows]))
        above.append(found.z[mine] - trace.z[rows])
        turned.append(np.angle(np.exp(1j * (found.yaw[mine] - trace.yaw[rows]))))
        near = (trace.sensor_distance() < 30.0) & (trace.visible > 0.5)
        share.append(np.isin(keys[near], wanted).mean())
    assert np.concatenate(apart).max() < 2.0
    assert np.median(np.concatenate(apart)) < 0.15
    assert abs(np.median(np.concatenate(above))) < 0.05
    assert np.median(np.abs(np.concatenate(turned))) < 0.03
    assert np.mean(share) > 0.8


def test_every_sequence_is_a_scenario(monkeypatch: pytest.MonkeyPatch) -> None:
    """Listed by name, as long as its recording, with the trace and the detections of its files."""
    monkeypatch.setenv("MDKF_KITTI", str(RECORDED))
    names = [name for name in scenarios.list() if name.startswith("kitti-")]
    assert names == [f"kitti-{k:04d}" for k in range(21)]
    for name in names:
        scenario = scenarios.load(name)
        sequence = name.removeprefix("kitti-")
        trace = sim_bridge.simulate(scenario, 0)
        assert trace == trace_of(sequence)
        assert trace.n_frames * trace.dt == pytest.approx(scenario.duration)
        if sequence in SOME:
            found = sim_bridge.detect(trace, "recorded:pvcnn")
            assert found == detections_of("pvcnn", sequence)


def test_recorded_boxes_are_projected_onto_their_own_boxes_in_the_picture() -> None:
    """From the world back into the picture, pointrcnn's boxes are its files' own to 0.2 px, 0.002
    px in the median (it cuts all at 1242 x 375), for all 40765; the others', which were projected
    from unrounded boxes, to 4 px, 0.06 px in the median, wherever they are all in front of the
    camera: what reaches behind it they project mirrored."""
    sequences = read_sequences(RECORDED)
    sizes = pictures(RECORDED, sequences)
    for detector, median, most in (
        ("pointrcnn", 0.003, 0.2),
        ("pvcnn", 0.1, 4.0),
        ("second_iou", 0.1, 4.0),
    ):
        apart, rows = [], 0
        for name, n_frames in sequences.items():
            picture = KITTI_PICTURE if detector == "pointrcnn" else sizes[name]
            camera = Camera.read(RECORDED, name, n_frames, picture)
            path = RECORDED / "detections" / detector / f"{name}.txt"
            own = read_detections(path, n_frames)
            world = camera.rig.world_boxes(own)
            table = Detections.from_columns(
                {**world, "frame": own.frame, "score": own.last, "source": own.line},
                n_frames=n_frames,
                dt=0.1,
            )
            boxes = camera.boxes(table)
            assert len(boxes.row) == len(own.line)  # each is in the picture
            mine = table.source[boxes.row] - 1
            reach = np.hypot(own.length, own.width) / 2
            front = (own.bottom[:, 2] - reach)[mine] > NEAR
            np.testing.assert_allclose(boxes.bottom, own.bottom[mine], atol=1e-6)
            apart.append(np.abs(boxes.image - own.image[mine]).max(axis=1)[front])
            rows += front.sum()
        assert rows > 30_000
        assert np.median(np.concatenate(apart)) < median
        assert np.concatenate(apart).max() < most


def test_labels_that_reach_behind_the_camera_are_drawn_where_people_drew_them() -> None:
    """Of the boxes that may, being half a diagonal away or nearer, half overlap the label in the
    picture by more than 0.9. The pictures end where KITTI's do."""
    sequences = read_sequences(RECORDED)
    sizes = pictures(RECORDED, sequences)
    known = {(1241, 374), (1223, 369), (1237, 373), (1240, 375)}  # as KITTI's pictures are
    assert {(picture.right, picture.bottom) for picture in sizes.values()} == known
    overlaps = []
    for name, n_frames in sequences.items():
        labels = read_labels(RECORDED / "label_02" / f"{name}.txt", n_frames)
        projection = read_projection(RECORDED / "calib" / f"{name}.txt")
        size = np.column_stack([labels.length, labels.height, labels.width])
        inside, image = in_picture(labels.bottom, size, labels.ry, projection, sizes[name])
        reach = np.hypot(labels.length, labels.width) / 2
        behind = np.flatnonzero(inside & (labels.bottom[:, 2] < reach))
        overlaps += [image_iou(image[k : k + 1], labels.image[k : k + 1])[0, 0] for k in behind]
    assert len(overlaps) > 100
    assert np.median(overlaps) > 0.9
