"""Before any test: no compiled kernel is older than the sources, and no world is from a cache.

numba keeps compiled kernels beside the sources and does not see a change in a kernel of another
file that was compiled into them (`mdkf.compiled`).
"""

import os
from pathlib import Path

import mdkf

SOURCES = Path(mdkf.__file__).parent


def pytest_configure() -> None:
    """Discard compiled kernels that may not be what the sources say; simulate every world."""
    os.environ["MDKF_CACHE"] = "off"
    newest = max(source.stat().st_mtime for source in SOURCES.glob("*.py"))
    for compiled in SOURCES.glob("__pycache__/*.nb[ci]"):
        if compiled.stat().st_mtime < newest:
            compiled.unlink(missing_ok=True)
