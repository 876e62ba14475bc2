"""Claim: worlds go out by one command as step by step, and results come back by one command."""

import csv
from pathlib import Path
from typing import Any

import pytest

import sim_bridge
from experiments.exchange import jobs
from mdkf.tables import Trace, Tracks
from sim_bridge import SeedRefused, read_table
from tests.experiments.commands import Mdkf, answered, assert_refused


def content(folder: Path) -> dict[str, bytes]:
    """Every file's bytes by its path, but for the list of what the sequences are."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != "sequences.csv"
    }


@pytest.mark.parametrize("layout", ["kitti", "mot"])
def test_a_scenario_is_exported_as_its_tables_are(
    mdkf_command: Mdkf, made: Path, tmp_path: Path, layout: str
) -> None:
    """Seeds 0 and 1, simulated, detected, occluded and tracked on the way, or step by step in files
    of their own: the same bytes."""
    own = made / "own" / "scenario.yaml"
    options = ("--seeds", 2, "--occlusion", "mid:20", "--filters", "md", "--format", layout)
    answer = mdkf_command("export", own, *options, "--out", "one")
    assert (answer.status, answer.out) == (0, "one/sequences.csv\n"), answer.err
    tables = []
    for seed in (0, 1):
        folder = tmp_path / str(seed)
        folder.mkdir()
        trace, seen, tracks = (folder / f"{name}.parquet" for name in ("trace", "seen", "md"))
        hide = ("--seed", seed, "--occlusion", "mid:20")
        assert mdkf_command("simulate", own, "--seed", seed, "--out", trace).status == 0
        assert mdkf_command("detect", trace, *hide, "--out", seen).status == 0
        assert mdkf_command("track", seen, "--filter", "md", "--out", tracks).status == 0
        tables += [trace, seen, tracks]
    # In any order of files, those of traces decide that of the sequences.
    given = (tables[4], tables[0], tables[3], *tables[1:3], tables[5])
    answer = mdkf_command("export", *given, "--format", layout, "--out", "two")
    assert (answer.status, answer.out) == (0, "two/sequences.csv\n"), answer.err
    one, two = content(tmp_path / "one"), content(tmp_path / "two")
    assert list(one) == list(two)
    assert one == two
    with (tmp_path / "one" / "sequences.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["sequence"], row["seed"]) for row in rows] == [("0000", "0"), ("0001", "1")]
    assert {row["occlusion"] for row in rows} == {"mid:20:35"}
    assert {row["scenario"] for row in rows} == {"bus_stop"}


def test_results_are_imported_and_scored(mdkf_command: Mdkf, made: Path, tmp_path: Path) -> None:
    """The tracks' own file, exported and read again: HOTA is that of the tracks, by way of a table
    or of the text itself, and what the file does not tell is null."""
    tables = [made / f"{name}.parquet" for name in ("trace", "seen", "tracks")]
    assert mdkf_command("export", *tables, "--out", "out").status == 0
    result = tmp_path / "out" / "tracks" / "tracks" / "data" / "0000.txt"
    seen = ("--detections", made / "seen.parquet")
    told = ("--trace", made / "trace.parquet", *seen, "--out", "back.parquet")
    answer = mdkf_command("import", result, *told)
    assert (answer.status, answer.out) == (0, "")
    ours = answered(
        mdkf_command("score", made / "trace.parquet", made / "tracks.parquet", "--json")
    )
    table = answered(mdkf_command("score", made / "trace.parquet", "back.parquet", "--json"))
    text = answered(mdkf_command("score", made / "trace.parquet", result, *seen, "--json"))
    assert table == text
    assert table["hota"] == pytest.approx(ours["hota"], rel=1e-6)
    assert table["error_gap"] == pytest.approx(ours["error_gap"], rel=1e-5)
    assert (table["nees"], table["velocity_error"], table["lost"]) == (None, None, None)
    assert ours["nees"] is not None
    shown = mdkf_command("score", made / "trace.parquet", "back.parquet", "--by", "phase,range")
    assert shown.status == 0


def test_recorded_worlds_and_kittis_rules_take_the_exported_folder(
    mdkf_command: Mdkf, made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a recording: by name where the environment says, and as a root of `mdkf kitti`, whose
    detections it has."""
    tables = [made / f"{name}.parquet" for name in ("trace", "seen")]
    assert mdkf_command("export", *tables, "--out", "out").status == 0
    monkeypatch.setenv("MDKF_KITTI", str(tmp_path / "out"))
    assert mdkf_command("simulate", "kitti-0000", "--out", "again.parquet").status == 0
    again, trace = (
        read_table(path, Trace) for path in (tmp_path / "again.parquet", made / "trace.parquet")
    )
    assert set(again.ids()) <= set(trace.ids())
    assert again.n_frames == trace.n_frames
    found = answered(mdkf_command("kitti", "--root", "out", "--filters", "ca,md", "--json"))
    assert found


def test_a_document_tells_the_sequences(
    mdkf_command: Mdkf, made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And the seeds that gave no valid truth, which are left out; if all are, the work failed."""
    simulated = jobs.simulated

    def refusing(scenario: Any, seed: int, *others: Any) -> Trace:
        if seed == 1:
            raise SeedRefused("bus_stop, seed 1: planted")
        return simulated(scenario, seed, *others)

    monkeypatch.setattr(jobs, "simulated", refusing)
    own = made / "own" / "scenario.yaml"
    told = answered(mdkf_command("export", own, "--seeds", 3, "--out", "out", "--json"))
    assert [(row["sequence"], row["seed"]) for row in told["sequences"]] == [
        *(("0000", "0"), ("0001", "2"))
    ]
    assert told["refused"] == ["bus_stop, seed 1: planted"]
    lists = (tmp_path / "out" / "evaluate_tracking.seqmap.val").read_text().splitlines()
    assert lists == ["0000 empty 000000 000100", "0001 empty 000000 000100"]

    def nothing(*others: Any) -> Trace:
        raise SeedRefused("planted")

    monkeypatch.setattr(jobs, "simulated", nothing)
    answer = mdkf_command("export", own, "--seeds", 2, "--out", "empty")
    assert answer.status == 1
    assert answer.err.splitlines()[-1] == "mdkf: no world is left: every seed was refused"


def test_what_is_interrupted_keeps_its_whole_sequences(
    mdkf_command: Mdkf, made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C within the second world: 130, and the lists name the first."""
    simulated = jobs.simulated

    def interrupted(scenario: Any, seed: int, *others: Any) -> Trace:
        if seed == 1:
            raise KeyboardInterrupt
        return simulated(scenario, seed, *others)

    monkeypatch.setattr(jobs, "simulated", interrupted)
    own = made / "own" / "scenario.yaml"
    answer = mdkf_command("export", own, "--seeds", 3, "--format", "mot", "--out", "out")
    assert (answer.status, answer.err) == (130, "mdkf: interrupted\n")
    assert (tmp_path / "out" / "seqmaps" / "mdkf-train.txt").read_text() == "name\n0000\n"


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("export", "nowhere.parquet"), "nowhere.parquet: no such file"),
        (("export", "nowhere"), "unknown scenario 'nowhere'"),
        (("export", "MADE/trace.parquet", "bus_stop"), "'bus_stop' is no .parquet file"),
        (("export", "MADE/trace.parquet", "--seeds", "2"), "--seeds, --detector, --occlusion"),
        (("export", "MADE/trace.parquet", "--format", "coco"), "--format"),
        (("export", "MADE/seen.parquet"), "seen.parquet: the table is of bus_stop, whose trace"),
        (
            ("export", "MADE/other-trace.parquet", "MADE/seen.parquet"),
            "seen.parquet: the table is of bus_stop, whose trace",
        ),
        (
            ("export", "MADE/trace.parquet", "MADE/seen.parquet", "MADE/seen.parquet"),
            "seen.parquet: a second table of detections of one trace",
        ),
        (("export", "bus_stop", "--filters", "kalman"), "unknown filter 'kalman'"),
        (("export", "bus_stop", "--detector", "eyes"), "unknown detector 'eyes'"),
        (("export", "bus_stop", "--detector", "recorded:mine"), "has source sumo"),
        (("export", "bus_stop", "--occlusion", "all:20"), "occlusion 'all:20', expected KIND"),
        (("export", "bus_stop", "--set", "speed=fast"), "'speed=fast', expected NAME=NUMBER"),
        (("export", "bus_stop", "--set", "colour=2"), "colour"),
        (("export", "bus_stop", "--seeds", "0"), "--seeds"),
    ],
)
def test_bad_input_is_one_line(
    mdkf_command: Mdkf, made: Path, tmp_path: Path, arguments: tuple[str, ...], told: str
) -> None:
    """Status 2, and nothing written."""
    given = [argument.replace("MADE", str(made)) for argument in arguments]
    assert_refused(mdkf_command(*given, "--out", "out"), tmp_path, told)


def test_bad_results_are_one_line(mdkf_command: Mdkf, made: Path, tmp_path: Path) -> None:
    """The file and its line; a table of detections where none belongs, or of another trace."""
    trace, seen, tracks = (made / f"{n}.parquet" for n in ("trace", "seen", "tracks"))
    answer = mdkf_command("import", "no.txt", "--trace", trace, "--out", "back.parquet")
    assert_refused(answer, tmp_path, "no.txt: no such file")
    answer = mdkf_command("score", trace, tracks, "--detections", seen)
    assert_refused(answer, tmp_path, "--detections is for another tracker's results")
    bad = made / "bad.txt"
    bad.write_text("0 1 Car 0 0 0 1 1 2 2 1 1 1 0 0 9 0\n")
    for command in (("import", bad, "--trace", trace, "--out", "b.parquet"), ("score", trace, bad)):
        assert_refused(mdkf_command(*command), tmp_path, "bad.txt: line 1: 17 columns, expected 18")
    bad.write_text("0 1 Car 0 0 0 1 1 2 2 1 1 1 0 0 9 0 1\n")
    answer = mdkf_command("score", made / "other-trace.parquet", bad, "--detections", seen)
    assert_refused(answer, tmp_path, "seen.parquet: the detections come from another trace")


def test_tracks_that_know_no_boxes_are_not_exported(
    mdkf_command: Mdkf, made: Path, tmp_path: Path
) -> None:
    """Read from above they have neither height nor heading."""
    trace = read_table(made / "trace.parquet", Trace)
    result = made / "mot.txt"
    result.write_text("1,1,10,10,40,20,1,-1,-1,-1\n")
    sim_bridge.write_table(sim_bridge.read_results(result, trace), made / "flat.parquet")
    assert not read_table(made / "flat.parquet", Tracks).knows_boxes()
    given = (made / "trace.parquet", made / "flat.parquet")
    answer = mdkf_command("export", *given, "--out", "out")
    assert_refused(answer, tmp_path, "the tracks flat have no sizes, expected boxes")
