"""Claim: what the README tells a reader to type works as printed there."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

README = Path(__file__).parents[1] / "README.md"


def blocks(language: str) -> list[str]:
    """The fenced code blocks of a language."""
    return re.findall(rf"```{language}\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.parametrize("example", blocks("python"), ids=lambda code: code.strip().split("\n")[-1])
def test_the_python_examples_run(tmp_path: Path, example: str) -> None:
    """Each in a fresh interpreter, from another folder; the one that scores prints the scores."""
    ran = subprocess.run(
        [sys.executable, "-c", example], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stderr
    assert "'hota': " in ran.stdout or "experiments.score" not in example


def test_the_steps_run_from_file_to_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every `mdkf` line of the step-by-step block, in order, in an empty folder."""
    from experiments.command_line import main

    (steps,) = (block for block in blocks("sh") if "mdkf simulate" in block)
    monkeypatch.chdir(tmp_path)
    for line in steps.strip().splitlines():
        monkeypatch.setattr(sys, "argv", shlex.split(line))
        with pytest.raises(SystemExit) as stop:
            main()
        assert stop.value.code == 0, (line, capsys.readouterr().err)
    assert "hota" in capsys.readouterr().out
    assert {path.name for path in tmp_path.iterdir()} == {
        "trace.parquet",
        "seen.parquet",
        "tracks.parquet",
    }


def test_every_command_in_the_readme_exists() -> None:
    """Names after `mdkf` in code are commands of the program."""
    from experiments.command_line import app

    known = {c.name or c.callback.__name__ for c in app.registered_commands if c.callback}
    text = "\n".join(re.findall(r"`([^`\n]+)`", README.read_text(encoding="utf-8")))
    assert set(re.findall(r"\bmdkf ([a-z-]+)", text + "\n".join(blocks("sh")))) <= known
