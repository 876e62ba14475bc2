"""Claim: on recordings made by hand, `mdkf kitti` and `mdkf export` do what they say."""

import re
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from sim_bridge.kitti_image import Picture, in_picture
from tests.experiments.commands import Mdkf, answered, assert_refused
from tests.sim_bridge.kitti_folder import CAR, STILL, detection, files, label, numbers, written

FRAMES = 90
PROJECTION = np.array([[700.0, 0, 600, 0], [0, 700, 180, 0], [0, 0, 1, 0]])


@pytest.fixture
def root(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Nine seconds of a parked car and of one that drives away at 5 m/s, and what detectors `mine`
    and `pvcnn` see of them, to 0.05 m; no other detections. `mine` misses the sixtieth to
    seventieth frame."""
    rng = np.random.default_rng(3)
    labels, found, fewer = [], [], []
    for k in range(FRAMES):
        for track, place in enumerate([(-4.0, 1.65, 15.0), (3.0, 1.65, 10.0 + 0.5 * k)]):
            labels.append(in_its_picture(label(k, track, place, -np.pi / 2), place))
            near = place + rng.normal(0, 0.05, 3)
            found.append(detection(k, near, -np.pi / 2, 4.0))
            if not 60 <= k < 70:
                fewer.append(found[-1])
    content = files(labels, fewer, [STILL] * FRAMES)
    content["calib/0003.txt"][0] = f"P2: {numbers(PROJECTION)}"
    content["detections/pvcnn/0003.txt"] = found
    content["evaluate_tracking.seqmap.val"] = content["evaluate_tracking.seqmap.training"]
    folder = written(tmp_path_factory.mktemp("recorded"), content)
    monkeypatch.setenv("MDKF_KITTI", str(folder))
    return folder


def in_its_picture(line: str, place: tuple[float, float, float]) -> str:
    height, width, length = CAR
    size, ry = np.array([[length, height, width]]), np.array([-np.pi / 2])
    _, image = in_picture(np.array([place]), size, ry, PROJECTION, Picture(1241.0, 374.0))
    words = line.split()
    words[6:10] = [f"{value:.6f}" for value in image[0]]
    return " ".join(words)


MINE = ("kitti", "--detector", "pointrcnn", "--filters", "ca,md")


def test_a_folder_of_a_users_own_is_tracked_scored_and_written(
    root: Path, mdkf_command: Mdkf, tmp_path: Path
) -> None:
    """One row per filter and rules. Under robmot's rules the frames without a detection are missed,
    under the paper's they are coasted through. Files and table hold what the document does."""
    mine = ("--detections", root / "detections" / "mine", "--out", "out")
    document = answered(mdkf_command(*MINE, *mine, "--json"))
    rows = document["rows"]
    assert [(row["rules"], row["filter"]) for row in rows] == [
        *[("robmot", "ca"), ("paper", "ca"), ("robmot", "md"), ("paper", "md")]
    ]
    for row in rows:
        missed = 20 if row["rules"] == "robmot" else 0
        counts = {name: row[name] for name in ("idsw", "fp", "fn")}
        assert counts == {"idsw": 0, "fp": 0, "fn": missed}
        assert row["mota"] == pytest.approx(100 * (1 - missed / (2 * FRAMES)))
        assert row["ground_hota"] > 80
        assert (row["detections"], row["seed"], row["occlusion"]) == ("recorded", None, "none")
    assert document["gaps"] == document["comparisons"] == []
    table = pl.read_parquet(tmp_path / "out" / "results.parquet")
    assert table.to_dicts() == rows
    lines = {
        name: len(
            (tmp_path / "out" / "tracks" / name / "data" / "0003.txt").read_text().split("\n")
        )
        for name in ("ca", "ca-paper", "md", "md-paper")
    }
    assert lines == {"ca": 161, "ca-paper": 181, "md": 161, "md-paper": 181}
    shown = mdkf_command(*MINE, *mine)
    assert "mine, rules robmot" in shown.out
    assert shown.err == ""
    (root / "detections" / "mine").rename(root / "detections" / "mine[v2]")
    own = ("--detections", root / "detections" / "mine[v2]", "--occlusion", "mid:20")
    told = mdkf_command(*MINE, *own).out
    assert "mine[v2], occlusion mid:20:35, rules robmot" in told
    assert "mine[v2], occlusion mid:20:35: errors in" in told


def test_detectors_settings_are_those_of_its_folders_name(
    root: Path, mdkf_command: Mdkf, tmp_path: Path
) -> None:
    """pvcnn's are known, mine's are not; with several folders each has its own in the output."""
    only = ("--detections", root / "detections" / "pvcnn")
    named = answered(mdkf_command("kitti", *only, "--filters", "ca", "--json"))
    told = answered(
        mdkf_command("kitti", *only, "--filters", "ca", "--detector", "pvrcnn", "--json")
    )
    for one, other in zip(named["rows"], told["rows"], strict=True):
        assert {**one, "ms_per_frame": 0} == {**other, "ms_per_frame": 0}
    assert_refused(mdkf_command("kitti"), tmp_path, "no tracker settings for 'mine'", "pointrcnn")
    both = answered(mdkf_command(*MINE, "--out", "out", "--json"))
    assert [row["detector"] for row in both["rows"]] == ["mine"] * 4 + ["pvcnn"] * 4
    for name in ("mine", "pvcnn"):
        assert (tmp_path / "out" / name / "tracks" / "md" / "data" / "0003.txt").is_file()


def test_occlusion_is_where_filters_differ(root: Path, mdkf_command: Mdkf) -> None:
    """Of each car twenty detections are hidden: missed where coasting is not written. Errors in the
    gaps have intervals over objects, and differences to the first filter."""
    only = ("--detections", root / "detections" / "pvcnn", "--filters", "ca,md")
    document = answered(mdkf_command("kitti", *only, "--occlusion", "mid:20", "--json"))
    robmot, paper = (row for row in document["rows"] if row["filter"] == "ca")
    assert (robmot["rules"], robmot["fn"], robmot["occlusion"]) == ("robmot", 40, "mid:20:35")
    assert paper["fn"] < 10
    ca, md = document["gaps"]
    for row in (ca, md):
        assert (row["gaps"], row["followed"], row["captured"], row["deleted"]) == (2, 2, 0, 0)
        assert 0 < row["drift_low"] <= row["drift"] <= row["drift_high"] < 2
        # With no other detection about, the tracker's filter does what the filter does alone.
        assert row["error"] == pytest.approx(row["drift"])
    assert ca["against"] == 0
    assert md["against"] == pytest.approx(md["drift"] - ca["drift"])
    shown = mdkf_command("kitti", *only, "--occlusion", "mid:20", "--out", "out").out
    assert "errors in 2 gaps" in shown
    assert "occlusion mid:20:35" in shown
    errors = pl.read_parquet("out/errors.parquet").filter(phase="gap", detector="pvcnn")
    for row in (ca, md):
        drift = errors.filter(filter=row["filter"])["drift"]
        assert len(drift) == 40
        assert row["drift"] == pytest.approx(drift.mean())


def test_simulated_detections_stand_beside_recorded_ones(root: Path, mdkf_command: Mdkf) -> None:
    """Of the same cars by the profile of the same detector, one row for each seed; their mean and
    its interval in the comparison."""
    only = ("--detections", root / "detections" / "pvcnn", "--filters", "ca,md", "--seeds", 2)
    document = answered(mdkf_command("kitti", *only, "--rules", "paper", "--simulated", "--json"))
    seeds = {name: [] for name in ("ca", "md")}  # type: dict[str, list[float]]
    for row in document["rows"][2:]:
        assert (row["detections"], row["rules"]) == ("simulated", "paper")
        seeds[row["filter"]].append(row["hota"])
    for row, real in zip(document["comparisons"], document["rows"][:2], strict=True):
        made = seeds[row["filter"]]
        assert (row["detector"], row["filter"], row["seeds"]) == ("pvcnn", real["filter"], 2)
        assert row["hota_recorded"] == real["hota"]
        assert row["hota_simulated"] == pytest.approx(np.mean(made))
        assert row["hota_difference"] == pytest.approx(np.mean(made) - real["hota"])
        assert row["hota_difference_low"] <= row["hota_difference"] <= row["hota_difference_high"]
        assert row["hota_recorded_rank"] in (1, 2)
    assert len(set(seeds["ca"])) == 2  # another seed, other detections
    shown = " ".join(mdkf_command("kitti", *only, "--rules", "paper", "--simulated").out.split())
    assert "recorded against simulated" in shown
    assert "HOTA within 2 points for" in shown
    assert "without what is tracked of labelled cars before or after their labels" in shown


def test_kinds_of_occlusion_that_a_recording_may_have(root: Path, mdkf_command: Mdkf) -> None:
    """Several gaps of each car are that many; of natural ones there are none here; true switches of
    motion nobody knows."""
    mine = (*MINE, "--rules", "exact", "--detections", root / "detections" / "pvcnn")
    gaps = answered(mdkf_command(*mine, "--occlusion", "mid:5:9:gaps=3", "--json"))["gaps"]
    assert [(row["filter"], row["gaps"], row["followed"]) for row in gaps] == [
        *[("ca", 6, 6), ("md", 6, 6)]
    ]
    assert "no object is hidden by others" in mdkf_command(*mine, "--occlusion", "natural:20").out
    refused = mdkf_command(*mine, "--occlusion", "switch:20")
    assert (refused.status, refused.out) == (2, "")
    assert re.fullmatch(r"mdkf: [^\n]*no switches of motion[^\n]*\n", refused.err)


def test_nothing_detected_is_no_value_not_an_error(
    root: Path, mdkf_command: Mdkf, tmp_path: Path
) -> None:
    """An empty file of detections: every car is missed, an empty file is written, and what has no
    value is a dash, also beside simulated detections."""
    (root / "detections" / "pvcnn" / "0003.txt").write_text("")
    options = ("--detections", root / "detections" / "pvcnn", "--filters", "ca,md", "--out", "out")
    more = ("--simulated", "--seeds", 2, "--occlusion", "mid:20", "--rules", "exact")
    document = answered(mdkf_command("kitti", *options, *more, "--json"))
    for row in document["rows"][:2]:
        assert (row["hota"], row["fn"], row["fp"]) == (0, 2 * FRAMES, 0)
        assert row["assa"] is row["motp"] is None
    assert [row["hota_recorded"] for row in document["comparisons"]] == [0, 0]
    assert (tmp_path / "out" / "tracks" / "ca" / "data" / "0003.txt").read_text() == ""
    shown = mdkf_command("kitti", *options, *more).out
    assert "–" in shown
    assert "no object has detections enough for mid:20:35" in shown
    (root / "label_02" / "0003.txt").write_text("")  # nor is anything labelled
    document = answered(mdkf_command("kitti", *options, *more, "--json"))
    assert {row["hota_difference"] for row in document["comparisons"]} == {None}
    assert mdkf_command("kitti", *options, *more).status == 0


def test_a_file_chooses_the_sequences(root: Path, mdkf_command: Mdkf, tmp_path: Path) -> None:
    """One at the begin of each line, as KITTI's own lists have them or alone; unknown ones, and
    those named twice, are refused."""
    chosen = tmp_path / "chosen"
    for text in ("0003 empty 000000 000090\n", "0003\n\n"):
        chosen.write_text(text)
        assert len(answered(mdkf_command(*MINE, "--split", chosen, "--json"))["rows"]) == 8
    (root / "evaluate_tracking.seqmap.val").unlink()  # a folder need not have KITTI's own splits
    assert len(answered(mdkf_command(*MINE, "--split", chosen, "--json"))["rows"]) == 8
    chosen.write_text("0003\n0004\n")
    refused = mdkf_command(*MINE, "--split", chosen)
    assert (refused.status, refused.err.count("\n")) == (2, 1)
    assert "sequence '0004', expected each once of: 0003" in refused.err
    chosen.write_text("0003\n0003\n")
    assert "sequence '0003', expected each once" in mdkf_command(*MINE, "--split", chosen).err


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--root", "nowhere", "--detections", "nowhere"), "nowhere: no such folder"),
        (("--root", "nowhere"), "nowhere/detections: no folder of detections"),
        (("--split", "tset"), "--split is 'tset', expected train, val, all or a file"),
        (("--filters", "ca,kalman"), "unknown filter 'kalman'"),
        (("--rules", "robmot,mine"), "--rules holds 'mine', expected some of: robmot, paper"),
        (("--detector", "lidar"), "--detector is 'lidar', expected one of: virconv"),
        (("--occlusion", "mid"), None),
        (("--occlusion", "middle:20"), "occlusion 'middle:20', expected KIND:LENGTH"),
        (("--position", "middle"), "position"),
        (("--seeds", "0"), "--seeds"),
        (("--out", __file__), "is a file"),
    ],
)
def test_bad_input_is_one_line(
    root: Path, mdkf_command: Mdkf, tmp_path: Path, options: tuple[str, ...], told: str | None
) -> None:
    """Status 2, and nothing written."""
    answer = mdkf_command(*MINE, "--out", "out", *options)
    if told is None:  # a length is not needed
        assert answer.status == 0
        return
    assert_refused(answer, tmp_path, told)


def test_bad_recordings_are_one_line(root: Path, mdkf_command: Mdkf, tmp_path: Path) -> None:
    """A missing sequence of detections, a malformed label: the file, and nothing written."""
    found = root / "detections" / "mine" / "0003.txt"
    text = found.read_text()
    found.unlink()
    assert_refused(mdkf_command(*MINE, "--out", "out"), tmp_path, f"{found}: no such file")
    found.write_text(text)
    calibration = root / "calib" / "0003.txt"
    calibration.write_text(calibration.read_text().replace("P2:", "P5:"))
    assert_refused(mdkf_command(*MINE, "--out", "out"), tmp_path, f"{calibration}: no line P2:")


# --- export ---------------------------------------------------------------------------------------


def test_tables_of_recordings_are_exported(root: Path, mdkf_command: Mdkf, tmp_path: Path) -> None:
    """Tracks with ids, detections without, each in a file of its sequence's name. Coasted frames
    are there: 180 rows of two cars in 90 frames."""
    assert mdkf_command("simulate", "kitti-0003", "--out", "trace.parquet").status == 0
    seen = ("detect", "trace.parquet", "--detector", "recorded:mine", "--out", "seen.parquet")
    assert mdkf_command(*seen).status == 0
    tracks = ("track", "seen.parquet", "--settings", "pointrcnn", "--out", "tracks.parquet")
    assert mdkf_command(*tracks).status == 0
    for table, rows, columns in (("tracks", 180, 18), ("seen", 160, 17)):
        answer = mdkf_command("export", f"{table}.parquet", "--format", "kitti", "--out", table)
        assert (answer.status, answer.out) == (0, f"{table}/0003.txt\n")
        lines = (tmp_path / table / "0003.txt").read_text().splitlines()
        assert len(lines) == rows
        assert {len(line.split(" ")) for line in lines} == {columns}
    refused = mdkf_command("export", "trace.parquet", "--out", "tracks")
    assert refused.status == 2
    assert "trace.parquet: the table is the trace of kitti-0003" in refused.err
    other = root / "pose" / "0003.txt"
    other.write_text(other.read_text().replace("0 1 0 0", "0 1 0 7", 1))
    refused = mdkf_command("export", "tracks.parquet", "--out", "tracks")
    assert refused.status == 2
    assert "of kitti-0003 of other recordings" in refused.err


def test_a_simulated_world_without_its_trace_is_not_exported(
    mdkf_command: Mdkf, made: Path, tmp_path: Path
) -> None:
    """Its trace has the sensor's path; what is no table is told as everywhere."""
    answer = mdkf_command("export", made / "tracks.parquet", "--out", tmp_path)
    assert_refused(answer, tmp_path, "tracks.parquet", "bus_stop, whose trace is not given")
    answer = mdkf_command("export", made / "foreign.parquet", "--out", tmp_path)
    assert_refused(answer, tmp_path, "foreign.parquet", "not one of mdkf's tables")
    answer = mdkf_command("export", made / "tracks.parquet", "--format", "csv", "--out", tmp_path)
    assert_refused(answer, tmp_path, "--format")
