"""Traces that were simulated before, from files: a hit has the bytes that simulating would give.

A file is named by the SHA-256 of all that decides a trace: the scenario's identity, the seed, the
time between frames, the sources that make traces and the versions of what they call. Nothing has to
be declared stale: what has changed has another name, and what nobody uses any more is evicted.
"""

import hashlib
import json
import operator
import os
import platform
import re
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import mdkf
import scenarios
from mdkf.tables import TableError, Trace
from scenarios import HighwayScenario, Scenario, SumoScenario
from sim_bridge.parquet import read_table, write_table
from sim_bridge.simulate import DT, simulate

VARIABLE = "MDKF_CACHE"
"""Environment variable: the folder of the cache, or `OFF`."""

OFF = "off"
MAX_BYTES = 2**30
"""Size of a cache: some 400 minutes of dense traffic [bytes]."""

_ENTRY = re.compile(r"[0-9a-f]{64}\.parquet")
_ABANDONED = 3600.0
"""Age from which a temporary file is one whose writer died [s]: writing takes under a second."""

_PACKAGES = ("libsumo", "highway-env", "gymnasium", "numpy", "scipy", "numba")


@dataclass(frozen=True)
class TraceCache:
    """Simulated traces in a folder, of at most `max_bytes` in all; the longest unused go first.

    Any number of processes may use one folder at once. A folder that cannot be read or written
    makes nothing fail: there is nothing in it then.
    """

    folder: Path
    max_bytes: int = MAX_BYTES

    def simulate(self, scenario: Scenario, seed: int, dt: float = DT) -> Trace:
        """What `sim_bridge.simulate` gives, and raises, from a file if it was made before.

        Only what a simulator makes is kept: formulas and recordings are as quick as a file.
        """
        if not isinstance(scenario, SumoScenario | HighwayScenario):
            return simulate(scenario, seed, dt)
        seed, identity = operator.index(seed), scenario.identity()
        path = self.folder / f"{_digest(identity, seed, float(dt), _makers())}.parquet"
        trace = _read(path, hashlib.sha256(identity.encode()).hexdigest(), seed, dt)
        if trace is None:
            trace = simulate(scenario, seed, dt)
            # A full or read-only disk costs the next run its time, and this one nothing.
            with suppress(OSError):
                self.folder.mkdir(parents=True, exist_ok=True)
                write_table(trace, path)
                self._evict()
        return trace

    def size(self) -> tuple[int, int]:
        """How many traces it holds, and their size [bytes]."""
        sizes = [status.st_size for path, status in self._files() if _ENTRY.fullmatch(path.name)]
        return len(sizes), sum(sizes)

    def clear(self) -> int:
        """Delete all traces; returns how many. `OSError` if one cannot be deleted."""
        entries = [path for path, _ in self._files()]
        for path in entries:
            path.unlink(missing_ok=True)
        return sum(_ENTRY.fullmatch(path.name) is not None for path in entries)

    def _evict(self) -> None:
        files = sorted(self._files(), key=lambda file: file[1].st_mtime)
        total = sum(status.st_size for _, status in files)
        for path, status in files:
            dead = path.suffix == ".part" and time.time() - status.st_mtime > _ABANDONED
            if dead or (total > self.max_bytes and path.suffix == ".parquet"):
                path.unlink(missing_ok=True)
                total -= status.st_size

    def _files(self) -> Iterator[tuple[Path, os.stat_result]]:
        """The cache's own files, temporary ones among them; whatever else is there is let be."""
        for path in self.folder.glob("*"):
            name = path.name.removeprefix(".")
            if _ENTRY.match(name) and path.suffix in (".parquet", ".part"):
                with suppress(OSError):  # another process was quicker
                    yield path, path.stat()


def user_cache() -> TraceCache | None:
    """The cache of whoever runs this: `MDKF_CACHE`, or `mdkf` in the user's folder of caches.

    None with `MDKF_CACHE=off`, and for a user without a home.
    """
    chosen = os.environ.get(VARIABLE)
    if chosen:
        return None if chosen == OFF else TraceCache(Path(chosen) / "traces")
    # Relative paths are invalid there, by the XDG Base Directory Specification.
    caches = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if not caches.is_absolute():
        try:
            caches = Path.home() / ".cache"
        except RuntimeError:
            return None
    return TraceCache(caches / "mdkf" / "traces")


def _read(path: Path, identity: str, seed: int, dt: float) -> Trace | None:
    """The trace in a file; None if there is none, or something else."""
    try:
        trace = read_table(path, Trace)
    except (TableError, OSError):  # a folder that may not be searched is the latter
        return None
    told = trace.provenance
    if (told.get("identity"), told.get("seed"), trace.dt) != (identity, str(seed), dt):
        return None
    with suppress(OSError):
        os.utime(path)  # it has been used
    return trace


@cache
def _makers() -> str:
    """The sources that decide what a trace is, and the versions of what they call."""
    tables = [Path(mdkf.__file__).with_name(name) for name in ("table.py", "tables.py")]
    rooms = (Path(package).parent for package in (scenarios.__file__, __file__))
    sources = [*tables, *(path for room in rooms for path in sorted(room.rglob("*.py")))]
    return _digest(
        {path.parent.name + "/" + path.name: _digest(path.read_text("utf-8")) for path in sources},
        {package: _version(package) for package in _PACKAGES},
        [platform.python_version(), platform.system(), platform.machine()],
    )


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _digest(*parts: object) -> str:
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()
