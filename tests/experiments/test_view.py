"""Claim: a recording for rerun holds the tables' own boxes, ellipses, gaps and errors, frame by
frame, and nothing is written for what cannot be shown."""

import json
import re
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from rerun.chunk import RrdReader
from scipy.stats import chi2

import mdkf
from experiments import OcclusionProtocol
from experiments.occlusion import recorded_gaps
from experiments.phases import gap_errors
from mdkf.tables import CLUTTER, KINDS, Detections, Trace, Tracks
from sim_bridge import detect, read_table, write_table
from tests.experiments.commands import Mdkf, answered, assert_refused, in_a_process

FILTERS = ("imm", "md")


class Recording:
    """What a file holds: by entity and component a list of values for each frame, `static` for
    those that never change. ids: those of its recordings. n_blueprints: how many layouts."""

    def __init__(self, path: Path) -> None:
        reader = RrdReader(path)
        self.ids = [each.recording_id for each in reader.recordings()]
        self.n_blueprints = len(reader.blueprints())
        self.frames: dict[str, list[int]] = {}
        self.seconds: dict[str, list[float]] = {}
        self.values: dict[tuple[str, str], list[Any]] = {}
        self.static: dict[tuple[str, str], Any] = {}
        for chunk in reader.stream():
            entity = chunk.entity_path.removeprefix("/")
            columns = chunk.to_record_batch().to_pydict()
            if not chunk.is_static:
                self.frames.setdefault(entity, []).extend(columns["frame"])
                seconds = [each.total_seconds() for each in columns["time"]]
                self.seconds.setdefault(entity, []).extend(seconds)
            for name, values in columns.items():
                _, colon, component = name.partition(":")
                key = entity, component
                if not colon:
                    continue
                if chunk.is_static:
                    self.static[key] = values[0]
                else:
                    self.values.setdefault(key, []).extend(values)

    def rows(self, entity: str, component: str) -> tuple[list[int], Any]:
        """All instances one after the other: the frame of each, and its values."""
        frames = self.frames[entity]
        assert frames == sorted(frames)
        listed = [each or [] for each in self.values[entity, component]]
        counts = [len(each) for each in listed]
        return np.repeat(frames, counts).tolist(), [value for each in listed for value in each]


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory, made: Path) -> Path:
    """A world's folder as `mdkf run` keeps it: the detections without the gaps' removals."""
    folder = tmp_path_factory.mktemp("run") / "worlds" / "bus_stop-3"
    folder.mkdir(parents=True)
    trace = read_table(made / "trace.parquet", Trace)
    seen = detect(trace, seed=3)
    write_table(trace, folder / "trace.parquet")
    write_table(seen, folder / "detections.parquet")
    occluded = OcclusionProtocol("mid", 20, 35).apply(seen)
    for name in FILTERS:
        tracks = mdkf.Tracker(mdkf.estimator(name), "pointrcnn").run(occluded)
        write_table(tracks, folder / f"tracks-{name}.parquet")
    return folder


@pytest.fixture(scope="module")
def recorded(world: Path, tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """The recording of that world."""
    out = tmp_path_factory.mktemp("recorded") / "world.rrd"
    answer = in_a_process("view", str(world), "--out", str(out))
    assert answer.status == 0, answer.err
    return Recording(out)


def _assert_boxes(recorded: Recording, entity: str, table: Any, rows: Any) -> None:
    """An entity holds the boxes of some rows of a table, each in its frame, and no other."""
    frames, centers = recorded.rows(entity, "centers")
    assert recorded.frames[entity] == list(range(table.n_frames))
    assert frames == table.frame[rows].tolist()
    single = {"rtol": 1e-6, "atol": 1e-6}  # rerun's numbers have single precision
    np.testing.assert_allclose(
        centers, np.column_stack([table.x, table.y, table.z])[rows], **single
    )
    sizes = np.column_stack([table.length, table.width, table.height])[rows]
    np.testing.assert_allclose(
        2 * np.array(recorded.rows(entity, "half_sizes")[1]), sizes, **single
    )
    x, y, z, w = np.array(recorded.rows(entity, "quaternions")[1]).T
    assert not x.any()
    assert not y.any()
    turned = np.remainder(2 * np.arctan2(z, w) - table.yaw[rows] + np.pi, 2 * np.pi) - np.pi
    np.testing.assert_allclose(turned, 0, atol=1e-6)


def test_truth_is_there_once_and_gaps_are_told_apart(recorded: Recording, world: Path) -> None:
    """Every object in every frame is a box of its kind, or one in its gap; what is hidden is
    darker, and says so."""
    trace = read_table(world / "trace.parquet", Trace)
    gaps = recorded_gaps(read_table(world / "tracks-md.parquet", Tracks)).rows()
    in_gap = np.zeros(len(trace), dtype=bool)
    for object_id, start, stop in gaps:
        in_gap |= (trace.object_id == object_id) & (start <= trace.frame) & (trace.frame < stop)
    assert 0 < in_gap.sum() < len(trace)
    told = 0
    for kind in np.unique(trace.kind):
        rows = (trace.kind == kind) & ~in_gap
        entity = f"world/truth/{KINDS[kind]}"
        _assert_boxes(recorded, entity, trace, rows)
        colours = np.array(recorded.rows(entity, "colors")[1])
        brightness = (colours >> 24 & 255) + (colours >> 16 & 255) + (colours >> 8 & 255)
        order = np.argsort(trace.visible[rows], kind="stable")
        assert (np.diff(brightness[order]) >= 0).all()
        labels = recorded.rows(entity, "labels")[1]
        visible = trace.visible[rows]
        assert all(f" {v:.0%} visible" in text for v, text in zip(visible, labels, strict=True))
        told += len(labels)
    _assert_boxes(recorded, "world/truth/in_gap", trace, in_gap)
    assert told + in_gap.sum() == len(trace)


def test_detections_are_given_removed_or_clutter(recorded: Recording, world: Path) -> None:
    """The removed ones are exactly those that the protocol takes from the filters."""
    seen = read_table(world / "detections.parquet", Detections)
    kept = OcclusionProtocol("mid", 20, 35).apply(seen)
    clutter = seen.source == CLUTTER
    _assert_boxes(recorded, "world/detections/clutter", seen, clutter)
    _assert_boxes(recorded, "world/detections/given", kept, kept.source != CLUTTER)
    _, removed = recorded.rows("world/detections/removed", "centers")
    assert len(removed) == len(seen) - len(kept) > 0


@pytest.mark.parametrize("name", FILTERS)
def test_tracks_are_measured_or_coasted(recorded: Recording, world: Path, name: str) -> None:
    """Every estimate is a box, apart by whether it had a detection."""
    tracks = read_table(world / f"tracks-{name}.parquet", Tracks)
    assert 0 < tracks.coasted.sum() < len(tracks)
    _assert_boxes(recorded, f"world/tracks/{name}/measured", tracks, ~tracks.coasted)
    _assert_boxes(recorded, f"world/tracks/{name}/coasted", tracks, tracks.coasted)


def test_ellipses_hold_95_percent(recorded: Recording, world: Path) -> None:
    """Their axes are eigenvectors of the covariance, as long as chi-square with two degrees of
    freedom says."""
    tracks = read_table(world / "tracks-md.parquet", Tracks)
    entity = "world/tracks/md/ellipses"
    frames, centers = recorded.rows(entity, "centers")
    assert frames == tracks.frame.tolist()
    np.testing.assert_allclose(
        np.array(centers)[:, :2], np.column_stack([tracks.x, tracks.y]), rtol=1e-6, atol=1e-6
    )
    x_axis = np.array(recorded.rows(entity, "half_sizes")[1])[:, :2]
    _, _, z, w = np.array(recorded.rows(entity, "quaternions")[1]).T
    angle = 2 * np.arctan2(z, w)
    c, s = np.cos(angle), np.sin(angle)
    turn = np.stack([np.stack([c, -s], axis=1), np.stack([s, c], axis=1)], axis=1)
    drawn = turn @ (np.eye(2) * (x_axis**2)[:, None, :]) @ turn.transpose(0, 2, 1)
    xx, xy, yy = tracks.cov_xx, tracks.cov_xy, tracks.cov_yy
    covariance = np.stack([np.stack([xx, xy], axis=1), np.stack([xy, yy], axis=1)], axis=1)
    expected = chi2.ppf(0.95, 2) * covariance
    np.testing.assert_allclose(drawn, expected, rtol=1e-4, atol=1e-5 * expected.max())


def test_paths_are_the_steps_of_what_moved(recorded: Recording, world: Path) -> None:
    """Each of a track's steps from one frame to the next, in the frame in which it ends."""
    tracks = read_table(world / "tracks-md.parquet", Tracks)
    expected = []
    for own in tracks.ids():
        rows = tracks.rows_of(int(own))
        for a, b in pairwise(rows):
            if tracks.frame[b] == tracks.frame[a] + 1 and (tracks.x[a], tracks.y[a]) != (
                tracks.x[b],
                tracks.y[b],
            ):
                expected.append((int(tracks.frame[b]), tracks.x[a], tracks.x[b]))
    frames, strips = recorded.rows("world/tracks/md/paths", "strips")
    drawn = sorted((k, ends[0][0], ends[1][0]) for k, ends in zip(frames, strips, strict=True))
    np.testing.assert_allclose(drawn, sorted(expected), rtol=1e-5, atol=1e-5)


def test_errors_are_those_of_the_scores(recorded: Recording, world: Path) -> None:
    """In every gap, frame by frame, the distance that `gap_errors` measures."""
    trace = read_table(world / "trace.parquet", Trace)
    compared = 0
    for place, name in enumerate(FILTERS):
        tracks = read_table(world / f"tracks-{name}.parquet", Tracks)
        errors = gap_errors(trace, tracks, recorded_gaps(tracks))
        measured = errors.filter((pl.col("track_id") >= 0) & pl.col("error").is_not_null())
        for object_id, frame, error in measured.select("object_id", "frame", "error").iter_rows():
            entity = f"objects/{object_id}/error"
            assert recorded.static[entity, "names"] == list(FILTERS)
            k = recorded.frames[entity].index(frame)
            assert recorded.values[entity, "scalars"][k][place] == pytest.approx(error, abs=1e-12)
            compared += 1
    assert compared > 100


def test_diagnostics_are_those_of_the_followed_track(recorded: Recording, world: Path) -> None:
    """Mode probabilities of IMM and weights of MD, of the track that goes through the gap."""
    trace = read_table(world / "trace.parquet", Trace)
    for name, prefix in (("imm", "probability_"), ("md", "weight_")):
        tracks = read_table(world / f"tracks-{name}.parquet", Tracks)
        errors = gap_errors(trace, tracks, recorded_gaps(tracks)).filter(pl.col("track_id") >= 0)
        object_id, track_id, frame = errors.select("object_id", "track_id", "frame").row(0)
        entity = f"objects/{object_id}/{name}"
        lines = recorded.static[entity, "names"]
        assert lines == [each for each in tracks.diagnostics if each.startswith(prefix)] != []
        k = recorded.frames[entity].index(frame)
        row = next(row for row in tracks.rows_of(track_id) if tracks.frame[row] == frame)
        expected = [tracks.diagnostics[line][row] for line in lines]
        assert recorded.values[entity, "scalars"][k] == expected


def test_the_sensor_moves_and_time_is_in_seconds(recorded: Recording, world: Path) -> None:
    """Its pose is the trace's; frame k is at k times dt."""
    ego = read_table(world / "trace.parquet", Trace).ego
    translation = recorded.rows("world/sensor", "translation")[1]
    np.testing.assert_allclose(translation, np.column_stack([ego.x, ego.y, ego.z]), rtol=1e-6)
    seconds = recorded.seconds["world/sensor"]
    np.testing.assert_allclose(seconds, ego.frame * ego.dt, atol=1e-9)
    assert recorded.n_blueprints == 1


def test_single_files_and_a_chosen_object(
    mdkf_command: Mdkf, made: Path, tmp_path: Path, recorded: Recording
) -> None:
    """Filters are called by their files; the object is the one whose plots are laid out; what was
    removed before the file was written cannot be shown."""
    tables = ("--detections", made / "seen.parquet", "--tracks", made / "tracks.parquet")
    trace, first, second = made / "trace.parquet", tmp_path / "a.rrd", tmp_path / "b.rrd"
    (row,) = answered(mdkf_command("view", trace, *tables, "--out", first, "--json"))["rows"]
    assert (row["name"], row["filters"]) == ("bus_stop, seed 3", ["tracks"])
    gaps = recorded_gaps(read_table(made / "tracks.parquet", Tracks))
    assert row["gaps"] == len(gaps) > 1
    other = next(int(each) for each in gaps.object_id if each != row["object"])
    chosen = mdkf_command("view", trace, *tables, "--out", second, "--object", other, "--json")
    assert answered(chosen)["rows"][0]["object"] == other
    one, two = Recording(first), Recording(second)
    assert f" {other}, around its gap" in two.static["legend", "text"][0]
    assert repr(one.values) == repr(two.values)  # in which NaN is NaN
    assert one.ids == two.ids != recorded.ids
    assert ("world/detections/removed", "centers") not in one.values


def test_without_a_display_recordings_are_written_beside(
    mdkf_command: Mdkf, world: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of each world of a run, and the user is told how to open them."""
    if sys.platform in ("darwin", "win32"):
        pytest.skip("there is always a display")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    answer = mdkf_command("view", world.parents[1], "--filters", "md")
    assert answer.status == 0, answer.err
    written = world / "trace.rrd"
    assert answer.out.split() == [str(written)]
    assert f"rerun {written}" in answer.err
    entities = {entity for entity, _ in Recording(written).values}
    assert "world/tracks/md/measured" in entities
    assert not any("imm" in entity for entity in entities)
    written.unlink()


@pytest.mark.parametrize(
    ("given", "parts"),
    [
        (("empty",), ("empty", "worlds/SCENARIO-SEED")),
        (("WORLD", "--filters", "md,nonsense"), ("nonsense", "imm, md")),
        (("WORLD", "--object", "999"), ("object 999", "expected one of")),
        (("WORLD", "--tracks", "MADE/tracks.parquet"), ("--tracks", "is a folder")),
        (("MADE/trace.parquet", "--filters", "md"), ("--filters", "no folder")),
        (("MADE/nothing.parquet",), ("nothing.parquet", "no such file")),
        (("MADE/truncated.parquet",), ("truncated.parquet",)),
        (("MADE/tracks.parquet",), ("holds Tracks, expected Trace",)),
        (
            ("MADE/other-trace.parquet", "--tracks", "MADE/tracks.parquet"),
            ("tracks.parquet", "another trace"),
        ),
        (
            ("MADE/other-trace.parquet", "--detections", "MADE/seen.parquet"),
            ("seen.parquet", "the detections come from another trace"),
        ),
        (
            ("MADE/trace.parquet", *(2 * ("--tracks", "MADE/tracks.parquet"))),
            ("tracks.parquet", "given twice"),
        ),
    ],
)
def test_what_cannot_be_shown_is_refused(
    mdkf_command: Mdkf, made: Path, world: Path, tmp_path: Path, given: Any, parts: Any
) -> None:
    """In one line that says what was expected; nothing is written."""
    (tmp_path / "empty").mkdir()
    places = {"MADE": str(made), "WORLD": str(world)}
    arguments = [re.sub("MADE|WORLD", lambda found: places[found[0]], each) for each in given]
    assert_refused(mdkf_command("view", *arguments, "--out", "x.rrd"), tmp_path, *parts)


def test_tracks_of_another_protocol_are_refused(
    mdkf_command: Mdkf, made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Filters are compared in the same gaps or not at all."""
    trace = read_table(made / "trace.parquet", Trace)
    occluded = OcclusionProtocol("late", 10, 35).apply(detect(trace, seed=3))
    others = mdkf.Tracker(mdkf.estimator("ca"), "pointrcnn").run(occluded)
    write_table(others, tmp_path / "late.parquet")
    both = ("--tracks", made / "tracks.parquet", "--tracks", "late.parquet")
    answer = mdkf_command("view", made / "trace.parquet", *both, "--out", "x.rrd")
    assert answer.status == 2
    assert re.fullmatch(r"mdkf: late\.parquet: its gaps are not those of [^\n]+\n", answer.err)
    assert not (tmp_path / "x.rrd").exists()


def test_one_file_takes_one_world(mdkf_command: Mdkf, world: Path, tmp_path: Path) -> None:
    """A run of several is refused with --out, and a name that rerun would not open always is."""
    other = world.with_name("bus_stop-4")
    other.symlink_to(world)
    try:
        answer = mdkf_command("view", world.parents[1], "--out", "x.rrd")
    finally:
        other.unlink()
    assert_refused(answer, tmp_path, "--out takes one world", "bus_stop-3", "bus_stop-4")
    assert_refused(mdkf_command("view", world, "--out", "x.mp4"), tmp_path, "x.mp4", ".rrd")
    assert_refused(mdkf_command("view", world, "--out", "no/x.rrd"), tmp_path, "no/x.rrd")


def test_without_rerun_the_user_is_told_what_to_install(
    mdkf_command: Mdkf, world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The extra is optional: one line, status 2."""
    monkeypatch.setitem(sys.modules, "rerun", None)
    answer = mdkf_command("view", world, "--out", "x.rrd")
    assert_refused(answer, tmp_path, "pip install 'mdkf[view]'")


def test_other_commands_do_not_load_rerun(tmp_path: Path) -> None:
    """Nor pyarrow, which brings a library that libsumo has too."""
    code = (
        "import sys; from experiments.command_line import application; application();"
        "print([name for name in ('rerun', 'pyarrow') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == []
