"""Claim: bad input is answered with one line and status 2, and leaves nothing behind."""

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import sim_bridge
from tests.experiments.commands import Mdkf, assert_refused, in_a_process, shortened

OUT = ("--out", "out.parquet")
BAD_ARGUMENTS: dict[str, tuple[tuple[object, ...], tuple[str, ...]]] = {
    "unknown scenario": (("run", "bus_stpo"), ("'bus_stpo'", "did you mean bus_stop?")),
    "unknown scenario to simulate": (("simulate", "bus_stpo", *OUT), ("did you mean bus_stop?",)),
    "unknown scenario to describe": (("scenarios", "bus_stpo"), ("did you mean bus_stop?",)),
    "scenario file that is not there": (("run", "my/own.yaml"), ("my/own.yaml", "not exist")),
    "scenario twice": (("run", "bus_stop", "bus_stop"), ("bus_stop",)),
    "unknown parameter": (
        ("simulate", "bus_stop", "--set", "sped=9", *OUT),
        ("'sped'", "did you mean speed?"),
    ),
    "parameter out of bounds": (
        ("simulate", "bus_stop", "--set", "speed=99", *OUT),
        ("speed", "from 6 to 13 [m/s]", "99"),
    ),
    "parameter that is no number": (
        ("simulate", "bus_stop", "--set", "speed=fast", *OUT),
        ("'speed=fast'", "NAME=NUMBER"),
    ),
    "parameter without a value": (
        ("simulate", "bus_stop", "--set", "speed", *OUT),
        ("'speed'", "NAME=NUMBER"),
    ),
    "time step": (("simulate", "bus_stop", "--dt", "0.033", *OUT), ("0.033", "multiple of 0.01")),
    "time step that is no number": (("simulate", "bus_stop", "--dt", "nan", *OUT), ("dt is nan",)),
    "infinite time step": (("simulate", "bus_stop", "--dt", "inf", *OUT), ("dt is inf",)),
    "time step beyond the scenario": (
        ("simulate", "bus_stop", "--dt", "100", *OUT),
        ("dt is 100",),
    ),
    "negative time step": (("simulate", "bus_stop", "--dt", "-0.1", *OUT), ("-0.1",)),
    "unknown filter": (("run", "--filters", "ca,mdd"), ("'mdd'", "did you mean 'md'?", "imm")),
    "unknown filter to track with": (
        ("track", "{made}/seen.parquet", "--filter", "kalman", *OUT),
        ("'kalman'", "known filters: "),
    ),
    "no filter": (("run", "--filters", ""), ("filter ''",)),
    "kind of occlusion": (("run", "--occlusion", "early:20"), ("'early:20'", "mid:20")),
    "length of occlusion": (("run", "--occlusion", "mid:-1"), ("'mid:-1'", "KIND:LENGTH")),
    "occlusion of a year": (
        ("run", "--occlusion", "mid:315360000"),
        ("'mid:315360000'", "at most 100000"),
    ),
    "gaps of one that has one": (
        ("run", "--occlusion", "late:9:gaps=2"),
        ("'late:9:gaps=2'", "mid and switch alone"),
    ),
    "occlusion to detect with": (
        ("detect", "{made}/trace.parquet", "--occlusion", "mid:x", *OUT),
        ("'mid:x'",),
    ),
    "unknown detector": (
        ("run", "--detector", "pointrcn"),
        ("'pointrcn'", "did you mean 'pointrcnn'?"),
    ),
    "unknown detector to detect with": (
        ("detect", "{made}/trace.parquet", "--detector", "lidar", *OUT),
        ("'lidar'", "known detectors: casa"),
    ),
    "detector file that is not there": (
        ("detect", "{made}/trace.parquet", "--detector", "own.yaml", *OUT),
        ("own.yaml",),
    ),
    "unknown settings": (("run", "--settings", "pointrcn"), ("'pointrcn'", "pvrcnn")),
    "unknown convention": (("run", "--gap-truth", "drop"), ("'drop'", "keep or ignore")),
    "no seeds": (("run", "--seeds", 0), ("--seeds", "1")),
    "seeds that are no number": (("run", "--seeds", "many"), ("--seeds", "integer")),
    "negative seed": (("simulate", "bus_stop", "--seed", -1, *OUT), ("--seed", "0")),
    "seed beyond SUMO's": (("simulate", "bus_stop", "--seed", 2**31, *OUT), ("2147483647",)),
    "no workers": (("run", "--workers", 0), ("--workers",)),
    "unknown option": (("run", "--seed", 3), ("--seed",)),
    "unknown command": (("simulat", "bus_stop"), ("'simulat'",)),
    "nothing to write to": (("simulate", "bus_stop"), ("--out",)),
    "an unknown rule of the tracker": (
        ("track", "{made}/seen.parquet", "--set", "gates=3", *OUT),
        ("gates=3", "NAME=VALUE with one of: gate, validity"),
    ),
    "a rule without a value": (
        ("track", "{made}/seen.parquet", "--set", "gate", *OUT),
        ("'gate', expected NAME=VALUE",),
    ),
    "a rule that is no number": (
        ("track", "{made}/seen.parquet", "--set", "gate=wide", *OUT),
        ("gate: Input should be a valid number",),
    ),
    "a rule that cannot be": (
        ("track", "{made}/seen.parquet", "--set", "gate=-1", *OUT),
        ("gate is -1.0, expected a number above 0",),
    ),
    "a rule that is not a number": (
        ("track", "{made}/seen.parquet", "--set", "validity=nan", *OUT),
        ("validity is nan, expected a number",),
    ),
    "nothing to track": (("track", *OUT), ("Missing argument",)),
    "trace that is not there": (("detect", "gone.parquet", *OUT), ("gone.parquet: no such file",)),
    "truncated trace": (
        ("detect", "{made}/truncated.parquet", *OUT),
        ("truncated.parquet", "not a readable Parquet file"),
    ),
    "text for a trace": (("detect", "{made}/text.parquet", *OUT), ("text.parquet",)),
    "foreign Parquet file": (
        ("detect", "{made}/foreign.parquet", *OUT),
        ("foreign.parquet", "not one of mdkf's tables"),
    ),
    "folder for a trace": (("detect", "{made}", *OUT), ("{made}", "is a folder")),
    "detections for a trace": (
        ("detect", "{made}/seen.parquet", *OUT),
        ("seen.parquet", "holds Detections, expected Trace"),
    ),
    "trace for detections": (
        ("track", "{made}/trace.parquet", *OUT),
        ("trace.parquet", "holds Trace, expected Detections"),
    ),
    "tracks and trace swapped": (
        ("score", "{made}/tracks.parquet", "{made}/trace.parquet"),
        ("tracks.parquet", "holds Tracks, expected Trace"),
    ),
    "tracks of another trace": (
        ("score", "{made}/other-trace.parquet", "{made}/tracks.parquet"),
        ("another trace",),
    ),
    "folder that is not there": (
        ("detect", "{made}/trace.parquet", "--out", "no/such/out.parquet"),
        ("no/such", "No such file or directory"),
    ),
    "folder for an output file": (
        ("detect", "{made}/trace.parquet", "--out", "{made}"),
        ("{made}", "directory"),
    ),
    "file for an output folder": (
        ("run", "bus_stop", "--out", "{made}/text.parquet"),
        ("text.parquet", "File exists"),
    ),
    "output folder below a file": (
        ("run", "bus_stop", "--out", "{made}/text.parquet/out"),
        ("text.parquet", "Not a directory"),
    ),
}


@pytest.mark.parametrize("case", BAD_ARGUMENTS)
def test_bad_arguments_are_one_line_and_status_2(
    mdkf_command: Mdkf, made: Path, tmp_path: Path, case: str
) -> None:
    """The line says what was given and what was expected; nothing is written."""
    arguments, parts = BAD_ARGUMENTS[case]
    before = {path: path.stat().st_mtime_ns for path in made.rglob("*")}
    filled = [str(a).replace("{made}", str(made)) for a in arguments]
    answer = mdkf_command(*filled)
    assert_refused(answer, tmp_path, *(part.replace("{made}", str(made)) for part in parts))
    assert {path: path.stat().st_mtime_ns for path in made.rglob("*")} == before


def swap(old: str, new: str) -> Callable[[str], str]:
    def apply(text: str) -> str:
        assert old in text
        return text.replace(old, new, 1)

    return apply


BAD_SCENARIOS: dict[str, tuple[dict[str, Callable[[str], str]], tuple[str, ...]]] = {
    "unknown key": (
        {"scenario": swap("ego: ego", "ego: ego\nlanes: 2")},
        ("scenario.yaml", "lanes"),
    ),
    "missing network": (
        {"scenario": swap("network.net.xml", "lost.net.xml")},
        ("scenario.yaml", "lost.net.xml"),
    ),
    "malformed network": (
        {"network": lambda text: text[: len(text) // 2]},
        ("network.net.xml", "not well-formed"),
    ),
    "unsorted routes": (
        {"routes": swap("</routes>", '<trip id="x" depart="1" from="frontage"/></routes>')},
        ("routes.rou.xml", "trip x"),
    ),
    "network that crashes SUMO": (
        {"network": lambda text: re.sub(r'<connection from="east_in".*/>', "", text)},
        ("SUMO crashed", "network.net.xml"),
    ),
}


@pytest.mark.parametrize("case", BAD_SCENARIOS)
def test_a_users_bad_scenario_is_one_line_and_status_2(
    mdkf_command: Mdkf, tmp_path_factory: pytest.TempPathFactory, tmp_path: Path, case: str
) -> None:
    """From `run` and from `simulate`, with the user's file in the line; nothing is written."""
    changed, parts = BAD_SCENARIOS[case]
    definition = shortened(tmp_path_factory.mktemp("user") / "own", **changed)
    answer = mdkf_command("simulate", definition, *OUT)
    assert_refused(answer, tmp_path, *parts)
    answer = mdkf_command("run", definition, "--seeds", 2, "--workers", 1, "--out", "out")
    assert_refused(answer, tmp_path, *parts)


def test_bad_input_found_by_a_worker_process_is_one_line_too(
    mdkf_command: Mdkf, tmp_path_factory: pytest.TempPathFactory, tmp_path: Path
) -> None:
    """The error crosses the process pool."""
    broken = shortened(tmp_path_factory.mktemp("user") / "own", network=lambda _: "<net/>")
    answer = mdkf_command("run", broken, "--seeds", 2, "--workers", 2, "--out", "out")
    assert_refused(answer, tmp_path, "network.net.xml", "no <location>")


def test_a_process_of_its_own_ends_with_one_line_and_the_status(tmp_path: Path) -> None:
    """As a shell sees it."""
    assert_refused(in_a_process("run", "nope", folder=tmp_path), tmp_path, "'nope'")


def test_detections_of_a_users_detector_can_be_tracked(
    mdkf_command: Mdkf, made: Path, tmp_path: Path
) -> None:
    """With --settings given, the detector's name need not be known; without, the line says so."""
    shipped = Path(sim_bridge.__file__).parent / "detectors" / "pointrcnn.yaml"
    own = tmp_path / "own.yaml"
    own.write_text(shipped.read_text().replace("name: pointrcnn", "name: mine"))
    answer = mdkf_command("detect", made / "trace.parquet", "--detector", own, "--out", "s.parquet")
    assert answer.status == 0
    answer = mdkf_command("track", "s.parquet", "--settings", "pointrcnn", "--out", "t.parquet")
    assert answer.status == 0, answer.err
    answer = mdkf_command("track", "s.parquet", "--out", "u.parquet")
    assert answer.status == 2
    assert "no tracker settings for 'mine'; choose with --settings" in answer.err


def test_a_full_disk_is_one_line(made: Path, tmp_path: Path) -> None:
    """A file that cannot be written whole is not there, and the line names it."""
    code = (
        "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096));"
        "from experiments.command_line import main; main()"
    )
    command = [sys.executable, "-c", code, "detect", str(made / "trace.parquet")]
    done = subprocess.run(
        [*command, "--out", "out.parquet"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr.startswith("mdkf: out.parquet: cannot be written")
    assert done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_regular_file_is_not_replaced(
    mdkf_command: Mdkf, made: Path, tmp_path: Path
) -> None:
    """`--out /dev/null` must not turn the device into a file; a FIFO stands in for it here."""
    os.mkfifo(tmp_path / "pipe")
    answer = mdkf_command("detect", made / "trace.parquet", "--out", "pipe")
    assert answer.status == 2
    assert "pipe: is not a regular file" in answer.err
    assert (tmp_path / "pipe").is_fifo()


def test_a_missing_folder_is_named_as_the_user_wrote_it(mdkf_command: Mdkf, made: Path) -> None:
    """Not the temporary file beside it."""
    answer = mdkf_command("detect", made / "trace.parquet", "--out", "no/such/out.parquet")
    assert answer.err == "mdkf: no/such/out.parquet: No such file or directory\n"


def test_a_bad_run_leaves_no_folder(mdkf_command: Mdkf, tmp_path: Path) -> None:
    """Input that turns out bad only when it is simulated."""
    broken = shortened(tmp_path / "own", network=lambda text: "<net/>")
    answer = mdkf_command("run", broken, "--workers", 1, "--out", "fresh")
    assert answer.status == 2
    assert not (tmp_path / "fresh").exists()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('<flow id="west"', '<flwo id="west"'),
        ("<stop ", "<stpo "),
        ('departSpeed="desired"', 'departSped="desired"'),
    ],
)
def test_what_sumo_would_pass_over_in_silence_is_refused(
    mdkf_command: Mdkf, tmp_path: Path, old: str, new: str
) -> None:
    """A misspelt element or attribute: without SUMO's own schema the traffic would just be gone."""
    broken = shortened(tmp_path / "own", routes=lambda text: text.replace(old, new))
    answer = mdkf_command("simulate", broken, "--out", "trace.parquet")
    assert answer.status == 2
    assert answer.err.count("\n") == 1
    assert str(broken.with_name("routes.rou.xml")) in answer.err
    assert new.strip("< ").split()[0].split("=")[0] in answer.err
    assert not (tmp_path / "trace.parquet").exists()


def test_a_later_bad_scenario_is_found_before_the_first_world(
    mdkf_command: Mdkf, tmp_path: Path
) -> None:
    """Nothing is simulated, and no folder on the way to --out stays."""
    broken = shortened(tmp_path / "own", network=lambda text: "<net/>")
    answer = mdkf_command("run", "bus_stop", broken, "--out", "new/deep/out")
    assert answer.status == 2
    assert answer.err.count("\n") == 1
    assert not (tmp_path / "new").exists()


def test_one_command_takes_one_filter(mdkf_command: Mdkf, made: Path) -> None:
    """A list of filters is no filter's name."""
    seen = made / "seen.parquet"
    answer = mdkf_command("track", seen, "--filter", "ca,imm", "--out", "t.parquet")
    assert answer.status == 2
    assert "unknown filter 'ca,imm'" in answer.err
