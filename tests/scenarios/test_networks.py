"""Claims about the committed networks: they are what their sources say, on any machine."""

import re
from pathlib import Path

import pytest

from scenarios.build_networks import CONFIGURATIONS, NETWORK, build, source_folders, tool_path

FOLDERS = source_folders()
INSTALLED = all(tool_path(tool) is not None for tool in CONFIGURATIONS.values())


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_no_committed_file_names_a_machine(folder: Path) -> None:
    """No absolute path, no time stamp and no comment of the tool's remains."""
    for path in sorted(folder.iterdir()):
        text = path.read_text(encoding="utf-8")
        assert "generated on" not in text
        assert not re.search(r"\"(/\w|[A-Z]:\\)", text), path
    assert len(FOLDERS) >= 2


@pytest.mark.skipif(not INSTALLED, reason="netconvert and netgenerate (eclipse-sumo) are missing")
@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_rebuilding_gives_the_committed_bytes(folder: Path) -> None:
    """The network in the repository is the one its sources describe."""
    assert build(folder) == (folder / NETWORK).read_bytes()
