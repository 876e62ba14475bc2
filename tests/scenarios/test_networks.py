"""Claims about the committed networks: they are what their sources say, on any machine."""

import re
from pathlib import Path

import pytest

from scenarios.build_networks import NETWORK, build, netconvert_path, source_folders

FOLDERS = source_folders()


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_no_committed_file_names_a_machine(folder: Path) -> None:
    """No absolute path, no time stamp and no comment of netconvert's remains."""
    for path in sorted(folder.iterdir()):
        text = path.read_text(encoding="utf-8")
        assert "generated on" not in text
        assert not re.search(r"\"(/\w|[A-Z]:\\)", text), path
    assert len(FOLDERS) >= 2


@pytest.mark.skipif(netconvert_path() is None, reason="netconvert (eclipse-sumo) is not installed")
@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_rebuilding_gives_the_committed_bytes(folder: Path) -> None:
    """The network in the repository is the one its plain-XML sources describe."""
    assert build(folder) == (folder / NETWORK).read_bytes()
