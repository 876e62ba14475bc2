"""Claim: whatever stands in a KITTI file, it is refused where it stands or read as what it says.

100 000 lines of labels and detections and 6000 others, spoilt as in `kitti_mutations`, whose
grammar says what is wrong with them.
"""

from collections.abc import Callable
from pathlib import Path
from random import Random

import numpy as np
import pytest

from mdkf import Tracker, estimator
from mdkf.tables import FloatArray
from sim_bridge import KittiError, kitti_detections, kitti_trace
from sim_bridge.kitti_files import (
    CameraBoxes,
    read_calibration,
    read_detections,
    read_labels,
    read_poses,
    read_sequences,
)
from tests.sim_bridge.kitti_folder import CALIBRATION, FOUND, LABELS, POSES, SEQUENCES
from tests.sim_bridge.kitti_mutations import (
    DETECTION,
    LABEL,
    OBJECTS,
    POSE,
    SEQUENCE,
    faults_in,
    is_text,
    lines_of,
    number,
    sound,
    spoilt,
    words_of,
)

N_FRAMES = 50
BEFORE = {
    LABEL: b"0 1000000 Car 0 0 -10 0 0 9 9 1.5 1.8 4.5 3 1.65 20 0\n",
    DETECTION: b"0 Car -1 -1 -10 0 0 9 9 1.5 1.8 4.5 3 1.65 20 0 3\n",
}
"""A line that may stand before a spoilt one."""

Reader = Callable[[Path, int], CameraBoxes]


def refusal(read: Callable[[], object], path: Path) -> str:
    """The message with which a file is refused, without the file's name: one short line."""
    with pytest.raises(KittiError) as raised:
        read()
    message = str(raised.value)
    assert message.isprintable()
    assert len(message) < len(str(path)) + 300
    assert message.startswith(f"{path}: ")
    return message.removeprefix(f"{path}: ")


def is_refused(
    read: Callable[[], object], path: Path, content: bytes, names: tuple[str, ...], n_frames: int
) -> bool:
    """Whether the grammar finds a fault in a file's content; where it does, the reader names it,
    by line and column."""
    faults = faults_in(lines_of(content), names, n_frames)
    if not any(faults):
        return False
    path.write_bytes(content)
    message = refusal(read, path)
    if not is_text(content):
        assert message == "is not UTF-8 text"
        return True
    line, _, fault = message.removeprefix("line ").partition(": ")
    there = faults[int(line) - 1]
    if fault.startswith("holds "):
        assert "text" in there, message
    elif " columns, expected " in fault:
        assert "columns" in there, message
    else:
        assert fault.partition(" is ")[0] in there, message
    return True


@pytest.mark.parametrize(
    ("read", "names", "last"),
    [(read_labels, LABEL, "track_id"), (read_detections, DETECTION, "score")],
)
def test_a_spoilt_line_is_refused_where_it_stands_or_read_as_it_is(
    tmp_path: Path, read: Reader, names: tuple[str, ...], last: str
) -> None:
    """50 000 lines: what the grammar refuses is refused by line and column, whatever stands before
    it; what it takes is read, all numbers as they are written."""
    rng, path = Random(last), tmp_path / "0003.txt"
    taken: list[list[bytes]] = []
    for _ in range(50_000):
        line = spoilt(rng, sound(rng, names, N_FRAMES))
        content = rng.choice((b"", BEFORE[names])) + line + rng.choice((b"", b"\n", b"\r\n"))
        if not is_refused(lambda: read(path, N_FRAMES), path, content, names, N_FRAMES):
            taken += map(words_of, lines_of(content))

    assert len(taken) > 10_000
    taken.sort(key=lambda words: float(words[0]))
    rows = [dict(zip(names, words, strict=True)) for words in taken]
    if "track_id" in names:
        unique = {(float(row["frame"]), float(row["track_id"])): row for row in rows}
        rows = [row for row in rows if unique[float(row["frame"]), float(row["track_id"])] is row]
    path.write_bytes(b"\n".join(b" ".join(row.values()) for row in rows))
    boxes = read(path, N_FRAMES)
    rows = [row for row in rows if row["type"] in OBJECTS]
    assert boxes.name == [row["type"].decode() for row in rows]
    read_as = {
        **{"frame": boxes.frame, "truncated": boxes.truncated, "occluded": boxes.occluded},
        **{"h": boxes.height, "w": boxes.width, "l": boxes.length, "ry": boxes.ry},
        **dict(zip("xyz", boxes.bottom.T, strict=True)),
        **dict(zip(("x1", "y1", "x2", "y2"), boxes.image.T, strict=True)),
        last: boxes.last,
    }
    for name, column in read_as.items():
        np.testing.assert_array_equal(column, [float(row[name]) for row in rows], err_msg=name)


def file_of(rng: Random, rows: list[list[bytes]]) -> bytes:
    """Lines of words of which one is spoilt."""
    lines = [b" ".join(words) for words in rows]
    k = rng.randrange(len(rows))
    lines[k] = spoilt(rng, rows[k])
    return rng.choice((b"\n", b"\r\n")).join(lines)


def test_a_spoilt_list_of_sequences(tmp_path: Path) -> None:
    """2000 lists of three sequences: refused where one is spoilt, or read as it is."""
    rng, path, taken = Random("sequences"), tmp_path / SEQUENCES, 0
    for _ in range(2000):
        content = file_of(rng, [sound(rng, SEQUENCE, 0) for _ in range(3)])
        if is_refused(lambda: read_sequences(tmp_path), path, content, SEQUENCE, 0):
            continue
        path.write_bytes(content)
        words = [words_of(line) for line in lines_of(content)]
        expected = [(name.decode(), float(frames)) for name, _, _, frames in words]
        assert list(read_sequences(tmp_path).items()) == expected
        taken += 1
    assert taken > 200


def is_rotation(matrix: FloatArray) -> bool:
    """To the digits of KITTI's files."""
    (a, b, c), (d, e, f), (g, h, i) = matrix
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    right = np.allclose(matrix @ matrix.T, np.eye(3), rtol=0.0, atol=1e-3)
    return right and bool(determinant > 0.0)


def test_spoilt_poses(tmp_path: Path) -> None:
    """2000 files of three poses: refused where one is spoilt, is no rotation or not its frame's, or
    read as they are."""
    rng, path, taken = Random("poses"), tmp_path / "0003.txt", 0
    for _ in range(2000):
        content = file_of(rng, [[b"%d" % k, *sound(rng, POSE, 1)[1:]] for k in range(3)])
        if is_refused(lambda: read_poses(path, 3), path, content, POSE, 3):
            continue
        path.write_bytes(content)
        values = np.array([[float(w) for w in words_of(line)] for line in lines_of(content)])
        matrices = values[:, 1:].reshape(-1, 3, 4)
        if len(values) != 3:
            told = f"{len(values)} poses, expected 3, one per frame"
            assert refusal(lambda: read_poses(path, 3), path) == told
        elif values[:, 0].tolist() != [0, 1, 2]:
            assert "every frame once" in refusal(lambda: read_poses(path, 3), path)
        elif not all(map(is_rotation, matrices[:, :, :3])):
            assert ": r11 is " in refusal(lambda: read_poses(path, 3), path)
        else:
            rotation, translation = read_poses(path, 3)
            np.testing.assert_array_equal(np.dstack([rotation, translation]), matrices)
            taken += 1
    assert taken > 200


def calibration_of(lines: list[bytes], key: bytes, n: int) -> FloatArray | str:
    """The matrix (3, n) of a key, or what is said of it."""
    there = [k for k, line in enumerate(lines) if line.partition(b":")[0].strip(b"\t ") == key]
    if not there:
        return f"no line {key.decode()}:"
    if len(there) > 1:
        return f"line {there[1] + 1}: {key.decode()} is there twice, expected once"
    about = f"line {there[0] + 1}: {key.decode()}"
    words = words_of(lines[there[0]].partition(b":")[2])
    if len(words) != 3 * n:
        return f"{about} has {len(words)} numbers, expected {3 * n}"
    if any(number(word) is None for word in words):
        return f"{about} holds "
    matrix = np.array([float(word) for word in words]).reshape(3, n)
    return matrix if is_rotation(matrix[:, :3]) else f"{about} is no rotation matrix"


def test_a_spoilt_calibration(tmp_path: Path) -> None:
    """2000 files: refused where a matrix is spoilt, or missing; or R0_rect Tr_velo_to_cam of what
    is written times what is read is one."""
    rng, path, taken = Random("calibration"), tmp_path / "0003.txt", 0
    plain = (b"1 0 0 0 1 0 0 0 1", b"0 -1 0 0 0 0 -1 -0.08 1 0 0 -0.27")
    keys = (b"R0_rect", b"Tr_velo_to_cam")
    rows = [[key + b":", *words.split()] for key, words in zip(keys, plain, strict=True)]
    for _ in range(2000):
        content = file_of(rng, rows)
        path.write_bytes(content)
        lines = lines_of(content)
        matrices = [calibration_of(lines, key, n) for key, n in zip(keys, (3, 4), strict=True)]
        told = next((m for m in matrices if isinstance(m, str)), None)
        if not is_text(content):
            assert refusal(lambda: read_calibration(path), path) == "is not UTF-8 text"
        elif any("text" in faults for faults in faults_in(lines, (), 0)):
            assert ": holds " in refusal(lambda: read_calibration(path), path)
        elif told is not None:
            assert refusal(lambda: read_calibration(path), path).startswith(told)
        else:
            rectification, mounting = (np.eye(4), np.eye(4))
            rectification[:3, :3], mounting[:3] = matrices
            product = rectification @ mounting @ read_calibration(path)
            np.testing.assert_allclose(product, np.eye(4), atol=1e-12 * np.abs(mounting).max())
            taken += 1
    assert taken > 200


# --- what is allowed --------------------------------------------------------------------------

PLACES = (b"0", b"-0", b"1e9", b"-1e9", b"5e8", b"-1e5", b"1e-9", b"5e-324", b"2.25", b"0.75")
SIZES = (b"1e9", b"1e5", b"4.5", b"1e-5", b"1e-9", b"1e-300", b"5e-324")
TURNS = (  # of a pose and of the camera, the second to the digits of a file
    b"1 0 0 0 1 0 0 0 1",
    b"1.0004 0 0 0 1 0 0 0 0.9996",
    b"0 -1 0 1 0 0 0 0 1",
    b"0 0 1 0 1 0 -1 0 0",  # straight up
)


def extreme(rng: Random, names: tuple[str, ...], **given: int) -> bytes:
    """A line about a car whose places, sizes and angles may be whatever is allowed."""
    word = dict(zip(names, sound(rng, names, 1), strict=True))
    word |= {"type": rng.choice(OBJECTS)}
    word |= {name: b"%d" % value for name, value in given.items() if name in names}
    for name in names:
        if name not in (*given, "type", "truncated", "occluded") and rng.random() < 0.3:
            word[name] = rng.choice(SIZES if name in "hwl" else PLACES)
    return b" ".join(word.values())


def pose_of(rng: Random, turn: bytes) -> bytes:
    """The twelve numbers of a turn and of any place."""
    r = turn.split()
    t = [rng.choice(PLACES) if rng.random() < 0.3 else b"%.3f" % rng.gauss(0, 50) for _ in range(3)]
    return b" ".join([*r[:3], t[0], *r[3:6], t[1], *r[6:], t[2]])


def test_whatever_is_allowed_has_a_place_in_the_world(tmp_path: Path) -> None:
    """600 recordings with boxes, poses and a camera as far, as large and as small as files allow:
    every box has a finite place, turned back to where it was written, and a share that is visible,
    and what is detected can be tracked; or the box holds the LiDAR, which is told with its line."""
    rng, frames, refused = Random("world"), range(3), []
    for name in (SEQUENCES, CALIBRATION, POSES, LABELS, FOUND):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / SEQUENCES).write_bytes(b"0003 empty 000000 000003\n")
    for _ in range(600):
        rectification, camera = rng.choice(TURNS[:2]), pose_of(rng, b"0 -1 0 0 0 -1 1 0 0")
        poses = [pose_of(rng, rng.choice(TURNS)) for _ in frames]
        content = {
            CALIBRATION: [b"R0_rect: " + rectification, b"Tr_velo_to_cam: " + camera],
            POSES: [b"%d %s" % (k, pose) for k, pose in enumerate(poses)],
            LABELS: [
                extreme(rng, LABEL, frame=k, track_id=i) for k in frames for i in range(k + 1)
            ],
            FOUND: [extreme(rng, DETECTION, frame=k, score=i) for k in frames for i in range(3)],
        }
        for name, lines in content.items():
            (tmp_path / name).write_bytes(b"\n".join(lines))
        try:
            trace = kitti_trace(tmp_path, "0003")
        except KittiError as error:
            refused.append(str(error))
            continue
        assert ((trace.visible >= 0.05) & (trace.visible <= 1.0)).all()
        detections = kitti_detections(tmp_path, "mine", "0003", unlabelled=rng.random() < 0.5)
        for table in (trace, detections):
            table.validate()
            assert ((table.yaw > -np.pi) & (table.yaw <= np.pi)).all()
        Tracker(estimator(rng.choice(("ca", "imm", "md")))).run(detections).validate()
        words = [dict(zip(LABEL, line.split(), strict=True)) for line in content[LABELS]]
        assert len(trace) == len(words)
        turn = np.array(rectification.split(), dtype=float).reshape(3, 3)
        mounting = np.array(camera.split(), dtype=float).reshape(3, 4)
        for row, word in enumerate(words):
            pose = np.array(poses[int(word["frame"])].split(), dtype=float).reshape(3, 4)
            x, y, z, h = (float(word[name]) for name in "xyzh")
            world = np.array([trace.x[row], trace.y[row], trace.z[row] - 1.73])
            by_lidar = np.linalg.solve(pose[:, :3], world - pose[:, 3])
            back = turn @ (mounting[:, :3] @ by_lidar + mounting[:, 3])
            far = max(np.abs(pose).max(), np.abs(mounting).max(), abs(x), abs(y), abs(z), h)
            np.testing.assert_allclose(back, [x, y - h / 2, z], atol=1e-14 * far + 1e-12)
    assert 0 < len(refused) < 300
    assert all("the box holds the LiDAR that sees it" in told for told in refused)
