"""Turns the plain-XML sources of every scenario into its committed `network.net.xml`.

Run `python -m scenarios.build_networks`. Needs netconvert (`pip install eclipse-sumo`), which users
of the built networks do without.
"""

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

CONFIGURATION = "network.netccfg"
NETWORK = "network.net.xml"
TIMEOUT = 120.0  # s
_FOLDER = Path(__file__).resolve().parent


def netconvert_path() -> str | None:
    """netconvert beside this Python or on PATH; None if it is not installed."""
    beside = shutil.which("netconvert", path=str(Path(sys.executable).parent))
    return beside or shutil.which("netconvert")


def source_folders() -> tuple[Path, ...]:
    """Folders of the catalogue that have network sources, sorted."""
    return tuple(sorted(path.parent for path in _FOLDER.glob(f"*/{CONFIGURATION}")))


def build(folder: Path) -> bytes:
    """The network of one scenario folder, byte for byte reproducible.

    Raises `RuntimeError` if netconvert is missing or fails.
    """
    netconvert = netconvert_path()
    if netconvert is None:
        raise RuntimeError("netconvert is not installed: pip install eclipse-sumo")
    with tempfile.TemporaryDirectory() as scratch:
        for source in folder.glob("*.xml"):
            if source.name != NETWORK:
                shutil.copy(source, scratch)
        shutil.copy(folder / CONFIGURATION, scratch)
        process = subprocess.run(
            [netconvert, "--configuration-file", CONFIGURATION],
            cwd=scratch,
            capture_output=True,
            text=True,
            timeout=TIMEOUT,
            check=False,
        )
        messages = process.stderr.strip()
        if process.returncode != 0 or messages:
            raise RuntimeError(f"netconvert, {folder.name}: {messages or process.returncode}")
        built = Path(scratch, NETWORK).read_text(encoding="utf-8")
    # The header comment holds a time stamp, and paths of the machine.
    return re.sub(r"<!--.*?-->\s*", "", built, count=1, flags=re.DOTALL).encode()


def main() -> None:
    """Rebuild every network in place."""
    for folder in source_folders():
        (folder / NETWORK).write_bytes(build(folder))
        print(f"built {folder.name}/{NETWORK}")


if __name__ == "__main__":
    main()
