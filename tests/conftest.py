"""Before any test: no compiled kernel is older than the sources.

numba keeps compiled kernels beside the sources and does not see a change in a kernel of another
file that was compiled into them (`mdkf.compiled`).
"""

from pathlib import Path

import mdkf

SOURCES = Path(mdkf.__file__).parent


def pytest_configure() -> None:
    """Discard compiled kernels that may not be what the sources say."""
    newest = max(source.stat().st_mtime for source in SOURCES.glob("*.py"))
    for compiled in SOURCES.glob("__pycache__/*.nb[ci]"):
        if compiled.stat().st_mtime < newest:
            compiled.unlink(missing_ok=True)
