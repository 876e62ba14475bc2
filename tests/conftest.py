"""Before any test: no compiled kernel is older than the sources, and no world is from a cache.

numba keeps compiled kernels beside the sources and does not see a change in a kernel of another
file that was compiled into them (`mdkf.compiled`).
"""

import os
from pathlib import Path

import experiments
import mdkf
import sim_bridge

PACKAGES = [Path(package.__file__).parent for package in (mdkf, sim_bridge, experiments)]
"""Those with kernels; others' kernels are compiled into those of the last two."""


def pytest_configure() -> None:
    """Discard compiled kernels that may not be what the sources say; simulate every world."""
    os.environ["MDKF_CACHE"] = "off"
    for k, package in enumerate(PACKAGES):
        sources = (source for used in PACKAGES[: k + 1] for source in used.rglob("*.py"))
        newest = max(source.stat().st_mtime for source in sources)
        for compiled in package.glob("**/__pycache__/*.nb[ci]"):
            if compiled.stat().st_mtime < newest:
                compiled.unlink(missing_ok=True)
