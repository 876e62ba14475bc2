"""Claim: the files of a trace and of tracks hold all that is needed to score them: `mdkf score`
gives every number that the library gives in memory, for any estimator, and tells what has none."""

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mdkf
import sim_bridge
from experiments import score
from experiments.terminal import BINNED, SECTIONS
from mdkf.tables import Detections, Trace, Tracks
from tests.experiments.commands import Mdkf, assert_refused
from tests.mdkf.test_check_estimator import AlphaBeta
from tests.tables import tracks_of

GROUPS = ("phase", "regime", "range", "level", "range,level")


class Telling(AlphaBeta):
    """A user's estimator that tells a NIS of its own."""

    def diagnostics(self, state: Any) -> Any:
        return {"variance": state[:, 4], "nis": np.where(state[:, 0] > 0, 2.0, np.nan)}


ESTIMATORS: dict[str, Any] = {
    **{name: mdkf.estimator(name) for name in ("ca", "imm", "md", "md-retuned")},
    "user's": AlphaBeta(),
    "user's with nis": Telling(),
}
SETTINGS = {
    "as they are": {},
    "online": {"confirmation": "online"},
    "measured": {"position": "measurement"},
    "not coasting": {"coasting": False, "max_missed": 3},
}


@pytest.mark.parametrize("options", SETTINGS)
@pytest.mark.parametrize("name", ESTIMATORS)
def test_files_give_the_scores_of_memory(
    made: Path, tmp_path: Path, name: str, options: str
) -> None:
    """Every score and bin, bit for bit, by whatever estimator and rules; the settings, of which
    NEES must know, travel along."""
    trace = sim_bridge.read_table(made / "trace.parquet", Trace)
    seen = sim_bridge.read_table(made / "seen.parquet", Detections)
    tracks = mdkf.Tracker(ESTIMATORS[name], "pointrcnn", **SETTINGS[options]).run(seen)
    sim_bridge.write_table(tracks, tmp_path / "tracks.parquet")
    again = sim_bridge.read_table(tmp_path / "tracks.parquet", Tracks)
    of_memory, of_files = (score(trace, table) for table in (tracks, again))
    expected, found = of_memory.summary(), of_files.summary()
    assert list(found) == list(expected)
    np.testing.assert_array_equal(list(found.values()), list(expected.values()))
    assert of_files.by(*GROUPS).equals(of_memory.by(*GROUPS))
    assert {"trace", "occlusion", "settings", "estimator"} <= again.provenance.keys()
    assert math.isnan(found["nis"]) == (name == "user's")
    if options == "measured":
        estimates = of_files.states
        coasted = again.coasted[estimates.track_row]
        np.testing.assert_array_equal(np.isnan(estimates.nees), ~coasted)
    else:
        assert found["nees"] > 0


@pytest.mark.parametrize("similarity", ["centre", "bird", "box"])
@pytest.mark.parametrize("convention", ["keep", "ignore"])
def test_the_command_gives_the_librarys_numbers(
    mdkf_command: Mdkf, made: Path, convention: Any, similarity: Any
) -> None:
    """One JSON document: the summary, and with --by the rows of the breakdowns, in order."""
    files = (made / "trace.parquet", made / "tracks.parquet")
    options = ("--gap-truth", convention, "--similarity", similarity, "--json")
    answer = mdkf_command("score", *files, *options, "--by", "phase", "--by", "range, level")
    assert answer.status == 0, answer.err
    told = json.loads(answer.out)
    trace, tracks = sim_bridge.read_table(files[0], Trace), sim_bridge.read_table(files[1], Tracks)
    rows = told.pop("breakdown")
    expected = score(trace, tracks, None, convention, similarity)
    assert told == {k: None if math.isnan(v) else v for k, v in expected.summary().items()}
    assert rows == expected.by("phase", "range,level").to_dicts()
    plain = json.loads(mdkf_command("score", *files, *options).out)
    assert plain == told


@pytest.mark.parametrize("columns", ["80", "100", "140"])
def test_tables_show_every_score_and_bin(
    mdkf_command: Mdkf, made: Path, monkeypatch: pytest.MonkeyPatch, columns: str
) -> None:
    """Nothing is cut off, on a terminal of any width."""
    monkeypatch.setenv("COLUMNS", columns)
    monkeypatch.setenv("FORCE_COLOR", "1")
    files = (made / "trace.parquet", made / "tracks.parquet")
    answer = mdkf_command("score", *files, "--by", "phase", "--by", "range,level")
    assert answer.status == 0
    assert max(map(len, answer.out.splitlines())) <= int(columns)
    assert "…" not in answer.out
    trace, tracks = sim_bridge.read_table(files[0], Trace), sim_bridge.read_table(files[1], Tracks)
    lines = {line.split()[0]: line for line in answer.out.splitlines() if line.strip()}
    for name, value in score(trace, tracks).summary().items():
        shown = "–" if math.isnan(value) else f"{value:.4g}"
        assert lines[name].split()[1] == shown, name
    for word in ("before", "occluded", "LEVEL_1", "LEVEL_2"):
        assert word in answer.out
    wide = int(columns) >= 130
    for _, heading, _, _, needs_width in BINNED:
        assert (heading in answer.out.split("By phase")[1]) == (wide or not needs_width), heading
    assert "not independent" in " ".join(answer.out.split())


def test_a_summarys_names_are_all_shown(made: Path) -> None:
    """Each once, with its unit."""
    trace = sim_bridge.read_table(made / "trace.parquet", Trace)
    summary = score(trace, tracks_of([], trace.n_frames)).summary()
    shown = [name for _, units in SECTIONS for name in units]
    assert sorted(shown) == sorted(summary)


def test_what_has_no_value_is_null(mdkf_command: Mdkf, made: Path, tmp_path: Path) -> None:
    """No track, no error: in the summary and in every bin."""
    trace = sim_bridge.read_table(made / "trace.parquet", Trace)
    sim_bridge.write_table(tracks_of([], trace.n_frames), tmp_path / "none.parquet")
    answer = mdkf_command(
        "score", made / "trace.parquet", tmp_path / "none.parquet", "--by", "range", "--json"
    )
    told = json.loads(answer.out)
    for name in ("position_error", "velocity_rmse", "heading_error", "backwards", "nees", "nis"):
        assert told[name] is None
        assert {row["value"] for row in told["breakdown"] if row["score"] == name} == {None}
    assert told["miss_rate"] == 100.0
    assert told["gospa_false"] == 0.0
    assert told["gospa"] == told["gospa_missed"] > 0


@pytest.mark.parametrize(
    ("options", "parts"),
    [
        (("--by", "speed"), ("'speed'", "phase, regime, range, level")),
        (("--by", "range,range"), ("'range,range'", "different ones")),
        (("--by", ""), ("''", "phase, regime, range, level")),
        (("--similarity", "image"), ("'image'", "centre, bird, box")),
        (("--gap-truth", "drop"), ("'drop'", "keep or ignore")),
    ],
)
def test_bad_options_are_one_line(
    mdkf_command: Mdkf, tmp_path: Path, options: tuple[str, ...], parts: tuple[str, ...]
) -> None:
    """Told before any file is looked for."""
    answer = mdkf_command("score", "no-trace.parquet", "no-tracks.parquet", *options)
    assert_refused(answer, tmp_path, *parts)


@pytest.mark.parametrize(
    "told",
    [
        "mid:20",
        '{"protocol": "mid:20:35"}',
        '{"gaps": [[1, 2]]}',
        '{"protocol": "mid:20:35", "gaps": [[1, 2, 1e400]]}',
    ],
)
def test_gaps_that_cannot_be_read_are_one_line(
    mdkf_command: Mdkf, made: Path, tmp_path: Path, told: str
) -> None:
    """A track table of the user's own making, whose provenance is not the protocol's."""
    trace = sim_bridge.read_table(made / "trace.parquet", Trace)
    own = dataclasses.replace(tracks_of([], trace.n_frames), provenance={"occlusion": told})
    path = tmp_path / "own.parquet"
    sim_bridge.write_table(own, path)
    answer = mdkf_command("score", made / "trace.parquet", path)
    path.unlink()
    assert_refused(answer, tmp_path, "occlusion", "gaps of (object, start, stop)")
