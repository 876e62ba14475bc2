"""Claim: what the README files tell a reader to type works as printed there."""

import os
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import pytest
import typer

from experiments.command_line import application

ROOT = Path(__file__).parents[1]
DOCUMENTS = sorted(
    path.relative_to(ROOT).as_posix()
    for folder in (".", "mdkf", "scenarios", "sim_bridge", "experiments", "experiments/*")
    for path in ROOT.glob(f"{folder}/README.md")
)
INSTALLS = ("make ", "pip install")
"""What a test cannot do to the machine that it runs on; `make test` runs the tests."""

FILE = re.compile(r"# (\S+\.\w+)\n")
"""The first line of a block that is a file, to be saved under that name."""


class Block(NamedTuple):
    """A fenced block: its language, what is in it, and whether it needs KITTI's recordings."""

    language: str
    text: str
    recorded: bool


def blocks(document: str) -> Iterator[Block]:
    """All fenced blocks of a document, in order."""
    text = (ROOT / document).read_text(encoding="utf-8")
    for found in re.finditer(r"(<!-- recorded -->\n+)?```(\w+)\n(.*?)```", text, re.DOTALL):
        yield Block(found[2], found[3], found[1] is not None)


@pytest.mark.parametrize("document", DOCUMENTS)
def test_everything_that_is_printed_runs(document: str, tmp_path: Path) -> None:
    """All blocks of a document in order, in one empty folder: files are saved, Python and commands
    are run as they stand there, each line of commands in the shell that a reader has."""
    for block in blocks(document):
        name = FILE.match(block.text)
        if name is not None:
            (tmp_path / name[1]).write_text(block.text, encoding="utf-8")
        elif block.language == "python":
            run([sys.executable, "-c", block.text], tmp_path)
        elif block.language == "sh" and not (block.recorded and "MDKF_KITTI" not in os.environ):
            lines = [line for line in block.text.splitlines() if not line.startswith(INSTALLS)]
            if lines:
                run(["bash", "-euc", "\n".join(lines)], tmp_path)


def run(command: list[str], folder: Path) -> None:
    """Run a command, and end what it left running."""
    scripts = Path(sys.executable).parent
    process = subprocess.Popen(
        command,
        cwd=folder,
        env={**os.environ, "PATH": f"{scripts}{os.pathsep}{os.environ['PATH']}"},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE if "&\n" not in command[-1] else subprocess.DEVNULL,
        text=True,
        start_new_session=True,
    )
    try:
        _, told = process.communicate(timeout=600)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    assert process.returncode == 0, f"{command[-1]}\n{told}"


@pytest.mark.parametrize("document", DOCUMENTS)
def test_every_command_that_is_named_is_one(document: str) -> None:
    """In running text as in blocks: the command exists, and so do its options."""
    group = typer.main.get_command(application())
    text = (ROOT / document).read_text(encoding="utf-8")
    inline = re.findall(r"`([^`\n]+)`", re.sub(r"```.*?```", "", text, flags=re.DOTALL))
    lines = [
        line
        for block in blocks(document)
        if block.language == "sh"
        for line in block.text.replace("\\\n", " ").splitlines()
    ]
    for line in (*inline, *lines):
        for found in re.finditer(r"(?:^|\s)mdkf ([a-z-]+)(.*)", line.partition("#")[0]):
            commands = group.commands  # type: ignore[attr-defined]
            assert found[1] in commands, line
            options = {name for p in commands[found[1]].params for name in p.opts}
            named = {word.partition("=")[0] for word in found[2].split() if word.startswith("--")}
            assert named - {"--help"} <= options, line


@pytest.mark.parametrize("document", DOCUMENTS)
def test_every_link_leads_somewhere(document: str) -> None:
    """Files and pictures of this tree, by their relative names."""
    text = re.sub(r"```.*?```", "", (ROOT / document).read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)#\s]+)\)", text):
        if not target.startswith("https://"):
            assert ((ROOT / document).parent / target).exists(), target


def test_the_makefile_has_the_two_commands() -> None:
    """`make demo` sets everything up and runs the main job, `make test` runs the tests."""
    (commands,) = (b.text for b in blocks("README.md") if b.text.startswith("make demo"))
    for line in commands.splitlines():
        target = shlex.split(line, comments=True)
        dry = subprocess.run(
            [*target, "--dry-run"], cwd=ROOT, capture_output=True, text=True, check=True
        ).stdout
        assert {"demo": "mdkf run", "test": "pytest"}[target[1]] in dry
