"""Turns the sources of every scenario's network into its committed `network.net.xml`.

Run `python -m scenarios.build_networks`. Sources are plain XML for netconvert, or settings for
netgenerate; both tools come with `pip install eclipse-sumo`, which users of the built networks do
without.
"""

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

CONFIGURATIONS = {"network.netccfg": "netconvert", "network.netgcfg": "netgenerate"}
"""Which tool builds a network from which configuration file."""

NETWORK = "network.net.xml"
TIMEOUT = 120.0  # s
_FOLDER = Path(__file__).resolve().parent


def tool_path(tool: str) -> str | None:
    """netconvert or netgenerate, beside this Python or on PATH; None if it is not installed."""
    beside = shutil.which(tool, path=str(Path(sys.executable).parent))
    return beside or shutil.which(tool)


def source_folders() -> tuple[Path, ...]:
    """Folders of the catalogue that have network sources, sorted."""
    found = (path.parent for name in CONFIGURATIONS for path in _FOLDER.glob(f"*/{name}"))
    return tuple(sorted(found))


def build(folder: Path) -> bytes:
    """The network of one scenario folder, byte for byte reproducible.

    Raises `RuntimeError` if the tool that builds it is missing or fails.
    """
    (configuration,) = (name for name in CONFIGURATIONS if (folder / name).is_file())
    tool = CONFIGURATIONS[configuration]
    path = tool_path(tool)
    if path is None:
        raise RuntimeError(f"{tool} is not installed: pip install eclipse-sumo")
    with tempfile.TemporaryDirectory() as scratch:
        for source in folder.glob("*.xml"):
            if source.name != NETWORK:
                shutil.copy(source, scratch)
        shutil.copy(folder / configuration, scratch)
        process = subprocess.run(
            [path, "--configuration-file", configuration],
            cwd=scratch,
            capture_output=True,
            text=True,
            timeout=TIMEOUT,
            check=False,
        )
        messages = process.stderr.strip()
        if process.returncode != 0 or messages:
            raise RuntimeError(f"{tool}, {folder.name}: {messages or process.returncode}")
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
