"""Claim: a bad KITTI file is one line that says where, what stood there and what was expected."""

from collections.abc import Callable
from pathlib import Path

import pytest

from sim_bridge import KittiError, kitti_detections, kitti_trace
from tests.sim_bridge.kitti_folder import (
    CALIBRATION,
    FOUND,
    GOOD,
    LABELS,
    POSES,
    SEQUENCES,
    Files,
    written,
)


def swap(old: str, new: str) -> Callable[[str], str]:
    return lambda line: line.replace(old, new, 1)


@pytest.mark.parametrize(
    ("file", "line", "change", "message"),
    [
        (LABELS, 2, swap("1 1 Car", "1 Car"), "16 columns, expected 17: frame track_id type"),
        (LABELS, 2, swap("Car 0 0", "Car 0 0 0"), "18 columns, expected 17"),
        (LABELS, 2, lambda _: "", "0 columns, expected 17"),
        (LABELS, 2, swap(" 20 ", " x20 "), "z is 'x20', expected a number"),
        (LABELS, 1, swap(" 20 ", " nan "), "z is 'nan', expected a number"),
        (LABELS, 1, swap(" 20 ", " -inf "), "z is '-inf', expected a number"),
        (LABELS, 1, swap(" 20 ", " 1e300 "), "z is '1e300', expected a number"),
        (LABELS, 1, swap(" 20 ", " 2_0 "), "z is '2_0', expected a number"),
        (LABELS, 2, swap(" 20 ", "\x0c20 "), r"holds '\x0c', expected ASCII without control"),
        (LABELS, 2, swap("1 1 Car", "2 1 Car"), "frame is 2, expected a whole number from 0 to 1"),
        (LABELS, 1, swap("0 1 Car", "-1 1 Car"), "frame is -1, expected a whole number"),
        (LABELS, 1, swap("0 1 Car", "0.5 1 Car"), "frame is 0.5, expected a whole number"),
        (LABELS, 1, swap("0 1 Car", "0 -1 Car"), "track_id is -1, expected a whole number"),
        (LABELS, 2, swap("1 1 Car", "0 1 Car"), "track_id is 1, expected at most once in a frame"),
        (LABELS, 1, swap("0 1 Car", "0 1 Cat"), "type is 'Cat', expected one of Car, Van, Truck"),
        (
            LABELS,
            2,
            swap("Car 0 0", "Car 3 0"),
            "truncated is 3, expected a whole number from -1 to 2",
        ),
        (
            LABELS,
            1,
            swap("Car 0 0", "Car 0 4"),
            "occluded is 4, expected a whole number from -1 to 3",
        ),
        (LABELS, 2, swap(" 4.5 ", " 0 "), "l is 0, expected a size above 0 m"),
        (LABELS, 1, swap("3 1.6499999999999999 20", "0 1.65 0"), "the box holds the LiDAR"),
        (FOUND, 2, swap("1 Car", "1 1 Car"), "18 columns, expected 17: frame type"),
        (FOUND, 2, swap(" 6", " high"), "score is 'high', expected a number"),
        (FOUND, 2, swap("1 Car", "7 Car"), "frame is 7, expected a whole number from 0 to 1"),
        (FOUND, 1, lambda _: GOOD[LABELS][0], "truncated is 'Car', expected a number"),
        (FOUND, 2, swap("1.8", "-1.8"), "w is -1.8, expected a size above 0 m"),
        (POSES, 2, swap("1 0 -1", "1 0 -2"), "r11 is 0, expected part of a rotation matrix"),
        (POSES, 2, swap("1 0 -1 0", "1 0 1 0"), "r11 is 0, expected part of a rotation matrix"),
        (POSES, 2, swap("1 0", "0 0"), "frame is 0, expected every frame once"),
        (CALIBRATION, 2, swap("1 ", "one "), "R0_rect holds 'one', expected numbers"),
        (CALIBRATION, 2, swap("1 ", ""), "R0_rect has 8 numbers, expected 9"),
        (CALIBRATION, 3, swap("-1", "1"), "Tr_velo_to_cam is no rotation matrix"),
        (CALIBRATION, 3, swap("Tr_velo_to_cam", "R0_rect"), "R0_rect is there twice"),
        (SEQUENCES, 1, swap("000002", "two"), "frames is 'two', expected a number"),
        (SEQUENCES, 1, swap("000002", "0"), "frames is 0, expected a whole number from 1"),
        (SEQUENCES, 1, swap("000000", "000005"), "first is 5, expected 0"),
    ],
)
def test_a_bad_line_is_named(
    tmp_path: Path, file: str, line: int, change: Callable[[str], str], message: str
) -> None:
    """One line of text says which file, which line, what stood there and what was expected."""
    content = {name: list(lines) for name, lines in GOOD.items()}
    before = content[file][line - 1]
    content[file][line - 1] = change(before)
    assert content[file][line - 1] != before
    folder = written(tmp_path, content)
    with pytest.raises(KittiError) as raised:
        kitti_detections(folder, "mine", "0003")
    text = str(raised.value)
    assert text.startswith(f"{folder / file}: line {line}: {message}")
    assert "\n" not in text


def test_frames_must_ascend(tmp_path: Path) -> None:
    """Rows out of order are refused where the order breaks, in labels, detections and poses."""
    for file in (LABELS, FOUND, POSES):
        swapped = {**GOOD, file: GOOD[file][::-1]}
        with pytest.raises(KittiError, match=rf"{file}: line 2: frame is 0, .*ascending order$"):
            kitti_detections(written(tmp_path / file[:4], swapped), "mine", "0003")


def without(name: str) -> Files:
    return {key: lines for key, lines in GOOD.items() if key != name}


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    """A missing folder or file, a pose too few, a key that calibration lacks: each by its name.
    Unknown sequences and detectors are told with the known ones."""
    nowhere = tmp_path / "nowhere" / "kitti"
    with pytest.raises(KittiError, match=rf"^{tmp_path}/nowhere: no such folder$"):
        kitti_trace(nowhere, "0003")
    for k, name in enumerate((SEQUENCES, LABELS, POSES, CALIBRATION)):
        folder = written(tmp_path / str(k), without(name))
        missing = folder / name if name == SEQUENCES else (folder / name).parent
        with pytest.raises(KittiError, match=rf"^{missing}: no such f"):
            kitti_trace(folder, "0003")
    folder = written(tmp_path / "short", {**GOOD, POSES: GOOD[POSES][:1]})
    with pytest.raises(KittiError, match=r"pose/0003.txt: 1 poses, expected 2, one per frame$"):
        kitti_trace(folder, "0003")
    folder = written(tmp_path / "key", {**GOOD, CALIBRATION: GOOD[CALIBRATION][:2]})
    with pytest.raises(KittiError, match=r"calib/0003.txt: no line Tr_velo_to_cam:$"):
        kitti_trace(folder, "0003")
    folder = written(tmp_path / "good", GOOD)
    with pytest.raises(KittiError, match=r"unknown sequence '0004'; known: 0003$"):
        kitti_trace(folder, "0004")
    with pytest.raises(KittiError, match=r"detections: unknown detector '\.\.'; known: mine$"):
        kitti_detections(folder, "..", "0003")
    (folder / FOUND).unlink()
    with pytest.raises(KittiError, match=r"mine/0003.txt: no such file$"):
        kitti_detections(folder, "mine", "0003")
    (folder / FOUND).write_bytes(b"\xff\xfe\x00")
    with pytest.raises(KittiError, match=r"mine/0003.txt: is not UTF-8 text$"):
        kitti_detections(folder, "mine", "0003")
