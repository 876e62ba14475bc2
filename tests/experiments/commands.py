"""Running `mdkf` in the tests, and the files it is given."""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import scenarios

BUS_STOP = scenarios.load("bus_stop").definition.parent
COLOURING = ("FORCE_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE")
"""With these in the environment, rich takes anything for a terminal and draws progress."""
MDKF = (sys.executable, "-c", "from experiments.command_line import main; main()")
"""The command `mdkf` for another process."""


class Answer(NamedTuple):
    """What a command did."""

    status: int
    out: str
    err: str


Mdkf = Callable[..., Answer]


def plain() -> dict[str, str]:
    """The environment, with nothing in it that makes a file a terminal."""
    return {name: value for name, value in os.environ.items() if name not in COLOURING}


def in_a_process(
    *arguments: str, folder: Path | None = None, environment: Mapping[str, str] | None = None
) -> Answer:
    """`mdkf ARGUMENTS...` in a process of its own, wherever it is installed."""
    done = subprocess.run(
        [*MDKF, *arguments],
        cwd=folder,
        env=plain() if environment is None else environment,
        capture_output=True,
        text=True,
        check=False,
    )
    return Answer(done.returncode, done.stdout, done.stderr)


def answered(answer: Answer) -> dict[str, Any]:
    """The document that a command with `--json` printed."""
    assert answer.status == 0, answer.err
    document: dict[str, Any] = json.loads(answer.out)
    return document


def shortened(folder: Path, **changed: Callable[[str], str]) -> Path:
    """A user's copy of bus_stop, 10 s long, in `folder`; `changed` edits network, routes or
    scenario."""
    shutil.copytree(BUS_STOP, folder)
    edits: dict[str, Callable[[str], str]] = {"scenario": lambda text: text, **changed}
    files = {"network": "network.net.xml", "routes": "routes.rou.xml", "scenario": "scenario.yaml"}
    for key, edit in edits.items():
        path = folder / files[key]
        path.write_text(edit(path.read_text()))
    definition = folder / "scenario.yaml"
    text = definition.read_text()
    assert "duration: 60.0" in text
    definition.write_text(text.replace("duration: 60.0", "duration: 10.0"))
    return definition


def assert_refused(answer: Answer, folder: Path, *parts: str) -> None:
    """Status 2, one line on stderr that holds all parts, nothing on stdout, no file written."""
    assert answer.status == 2, answer
    assert answer.out == ""
    assert re.fullmatch(r"mdkf: [^\n]+\n", answer.err), answer.err
    assert "Traceback" not in answer.err
    for part in parts:
        assert part in answer.err
    assert [p for p in folder.rglob("*") if p.is_file()] == []
