"""Claim: what is told of this version is of this version."""

import re
from importlib.metadata import version
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[1]


def test_the_citation_is_of_this_version() -> None:
    """CITATION.cff has what its format asks for, and names the paper of the filter."""
    told = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message", "title", "authors"} <= told.keys()
    assert told["version"] == version("mdkf")
    assert "Motion Dynamics Kalman Filter" in told["references"][0]["title"]
    assert all({"type", "title", "authors"} <= one.keys() for one in told["references"])


def test_the_changelog_begins_with_this_version() -> None:
    """Its first section, with a date that the citation has too."""
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    first = re.search(r"^## ([\d.]+) \((.+)\)$", text, re.MULTILINE)
    assert first is not None
    assert first[1] == version("mdkf")
    released = str(yaml.safe_load((ROOT / "CITATION.cff").read_text())["date-released"])
    year, _, day = released.split("-")
    assert first[2].startswith(f"{int(day)} ")
    assert first[2].endswith(year)
