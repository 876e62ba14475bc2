"""Golden worlds: short pieces of simulated traffic, committed with the package.

They are read from files, so that a baseline of them depends on no simulator and on no machine. What
stands under a name never changes; other worlds get another name or version. Remade with

    python -m experiments.regression

which simulates each piece and writes what the current code makes of it.
"""

import json
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

import scenarios
from mdkf import Detections, EgoPath, Trace
from scenarios import ScenarioError
from sim_bridge import detect, read_table, simulate

PREFIX = "golden:"
VERSION = "v1"
DETECTOR = "pointrcnn"
"""Of the committed detections, which have seed 0."""

FOLDER = Path(__file__).resolve().parent / VERSION
MANIFEST = FOLDER / "manifest.json"

_MAKERS = ("libsumo", "highway-env", "gymnasium", "numpy", "scipy", "numba")
"""Packages whose versions decide the bits of a world."""


@dataclass(frozen=True)
class Piece:
    """A part of a scenario's world with seed 0: frames first..first + frames - 1, some objects.

    The objects are hidden by everything that hid them in the whole world."""

    scenario: str
    first: int
    frames: int
    objects: tuple[int, ...]

    def cut(self, trace: Trace, name: str) -> Trace:
        """The piece of a trace, its frames counted from 0."""
        there = np.isin(trace.object_id, self.objects)
        rows = trace.take(there).between(self.first, self.first + self.frames)
        ego = trace.ego.between(self.first, self.first + self.frames)
        common: dict[str, Any] = {
            "n_frames": self.frames,
            "dt": trace.dt,
            "provenance": {**trace.provenance, "golden": name},
        }
        columns, path = (
            {**table.columns(), "frame": table.frame - self.first} for table in (rows, ego)
        )
        return Trace.from_columns(columns, ego=EgoPath.from_columns(path, **common), **common)


PIECES: Mapping[str, Piece] = MappingProxyType(
    {
        # SUMO: queues before a signal, cars and a truck pull away.
        f"{VERSION}/stop_and_go": Piece("stop_and_go", 400, 100, (104, 110, 118, 125, 126)),
        # SUMO: a bus passes and hides standing cars.
        f"{VERSION}/bus_stop": Piece("bus_stop", 330, 100, (15, 167, 168, 169, 194)),
        # highway-env: overtaking on a two-way road, 30 to 140 m away.
        f"{VERSION}/overtaking": Piece("overtaking", 90, 100, (3, 5, 6, 7, 37)),
        # Closed form: one car drives, speeds up, brakes, stands.
        f"{VERSION}/journey": Piece("journey", 0, 200, (0,)),
    }
)
"""By name, as `golden:v1/stop_and_go` without what stands before the colon."""


def golden_names() -> tuple[str, ...]:
    """Names of the golden worlds, as the fixtures take them."""
    return tuple(f"{PREFIX}{name}" for name in PIECES)


@cache
def golden_trace(name: str) -> Trace:
    """The trace of `golden:v1/NAME`; `ScenarioError` with the known names for any other."""
    return read_table(golden_file(name, "trace"), Trace)


@cache
def golden_detections(name: str) -> Detections:
    """What `pointrcnn` with seed 0 detects of it, nothing hidden."""
    return read_table(golden_file(name, "detections"), Detections)


def made(piece: Piece, name: str) -> tuple[Trace, Detections]:
    """What the current code makes of a piece."""
    trace = piece.cut(simulate(scenarios.load(piece.scenario), 0), name)
    return trace, detect(trace, DETECTOR, 0)


def manifest() -> dict[str, Any]:
    """What was written when the golden worlds were made: command, versions, content hashes."""
    told: dict[str, Any] = json.loads(MANIFEST.read_text(encoding="utf-8"))
    return told


def makers() -> dict[str, str]:
    """Versions of what decides the bits of a world, here and now."""
    return {
        **{package: version(package) for package in _MAKERS},
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}",
    }


def golden_file(name: str, kind: str) -> Path:
    """Where the `trace` or the `detections` of `golden:v1/NAME` are."""
    piece = name.removeprefix(PREFIX)
    if not name.startswith(PREFIX) or piece not in PIECES:
        raise ScenarioError(
            f"no golden world {name!r}, expected one of: {', '.join(golden_names())}"
        )
    return FOLDER.parent / f"{piece}.{kind}.parquet"
