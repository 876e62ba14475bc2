"""Claims about a user's own scenario file: every flaw is one line with file, key, expectation."""

from collections.abc import Callable
from pathlib import Path

import pytest

import scenarios
from scenarios import ScenarioError

VALID = """\
name: mine
purpose: Nothing much.
source: sumo
duration: 10.0
warmup: 1.0
network: network.net.xml
routes: routes.rou.xml
ego: ego
parameters:
  speed: {unit: m/s, default: 9.0, minimum: 1.0, maximum: 12.0, description: speed}
  lanes: {unit: "1", default: 2, minimum: 1, maximum: 3, description: lanes, integer: true}
statics:
  - {kind: car, x: 1.0, y: 2.0, length: 4.5, width: 1.8, height: 1.5}
"""


def write(folder: Path, text: str) -> Path:
    (folder / "network.net.xml").write_text("<net/>")
    (folder / "routes.rou.xml").write_text('<routes a="${speed}" b="${lanes}"/>')
    path = folder / "mine.yaml"
    path.write_text(text)
    return path


def refusal(path: Path) -> str:
    with pytest.raises(ScenarioError) as caught:
        scenarios.load(path)
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 700
    assert str(path) in message
    return message


def test_a_valid_file_loads(tmp_path: Path) -> None:
    """The file from which all the following are made is itself accepted."""
    scenario = scenarios.load(str(write(tmp_path, VALID)), lanes=3)
    assert scenario.name == "mine"
    assert scenario.route_xml() == '<routes a="9" b="3"/>'
    assert scenario.sensor_height == 1.73
    assert scenario.statics[0].yaw == 0.0


def replace(old: str, new: str) -> Callable[[str], str]:
    def apply(text: str) -> str:
        assert old in text
        return text.replace(old, new, 1)

    return apply


FLAWS = {
    "unknown key": (replace("ego: ego", "ego: ego\negos: 1"), ("egos", "sensor_height")),
    "unknown nested key": (replace("description: speed", "descr: speed"), ("speed", "descr")),
    "unknown static key": (replace("x: 1.0", "X: 1.0"), ("statics.0.X", "length")),
    "missing key": (replace("duration: 10.0\n", ""), ("missing key duration",)),
    "wrong type": (replace("duration: 10.0", "duration: long"), ("duration", "number", "'long'")),
    "text for number": (replace("duration: 10.0", 'duration: "10"'), ("duration", "number")),
    "not finite": (replace("duration: 10.0", "duration: .inf"), ("duration",)),
    "not positive": (replace("duration: 10.0", "duration: -1.0"), ("duration", "greater than 0")),
    "wrong kind": (replace("kind: car", "kind: tank"), ("statics.0.kind", "'car'", "'tank'")),
    "wrong source": (replace("source: sumo", "source: magic"), ("source", "'sumo'")),
    "default out of bounds": (replace("default: 9.0", "default: 90.0"), ("parameters.speed",)),
    "fractional integer": (replace("default: 2", "default: 2.5"), ("parameters.lanes", "whole")),
    "bad parameter name": (replace("  speed:", "  my speed:"), ("my speed",)),
    "network that is not there": (replace("network.net.xml", "no.net.xml"), ("no.net.xml",)),
    "repeated key": (replace("ego: ego", "ego: ego\nego: two"), ("'ego' is given twice", "line")),
    "malformed": (replace("source: sumo", "source: [sumo"), ("YAML", "line")),
    "a list": (lambda _: "- 1\n- 2\n", ("mapping", "a list")),
    "empty": (lambda _: "", ("mapping", "nothing")),
    "python tag": (replace("ego: ego", "ego: !!python/object:os.system {}"), ("YAML", "tag")),
    "control character": (replace("ego: ego", "ego: \x07"), ("YAML",)),
    "impossible date": (replace("ego: ego", "ego: 2024-99-99"), ("YAML",)),
    "deep nesting": (lambda _: "[" * 20_000, ("deeply",)),
}


@pytest.mark.parametrize("flaw", FLAWS)
def test_a_flawed_file_is_refused_in_one_line(flaw: str, tmp_path: Path) -> None:
    """The message names the file, where in it, and what was expected."""
    change, expected = FLAWS[flaw]
    message = refusal(write(tmp_path, change(VALID)))
    for part in expected:
        assert part in message


def test_aliases_are_refused_before_they_expand(tmp_path: Path) -> None:
    """The "billion laughs" file is answered like any other flaw."""
    lines = ['l0: &l0 ["lol"]']
    lines += [f"l{i}: &l{i} [{', '.join([f'*l{i - 1}'] * 9)}]" for i in range(1, 12)]
    assert "aliases" in refusal(write(tmp_path, VALID + "\n".join(lines)))


def test_what_is_not_a_text_file_is_refused(tmp_path: Path) -> None:
    """A directory, a missing file, a binary file and an oversized file."""
    assert "regular file" in refusal(tmp_path)
    assert "does not exist" in refusal(tmp_path / "missing.yaml")
    binary = tmp_path / "binary.yaml"
    binary.write_bytes(bytes(range(256)))
    assert "UTF-8" in refusal(binary)
    large = tmp_path / "large.yaml"
    large.write_bytes(b"#" * 1_000_001)
    assert "larger" in refusal(large)
    with pytest.raises(ScenarioError, match="regular file"):
        scenarios.load("/dev/zero")
