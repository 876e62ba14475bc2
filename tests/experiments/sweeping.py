"""Small sweeps for the tests, and what they leave behind."""

from pathlib import Path
from typing import Any

import polars as pl

from experiments.sweeps import Sweep, crossed
from experiments.sweeps.dataset import Dataset
from experiments.sweeps.task import GROWN, RUNS

MEASURED = ("ms_per_frame", "seconds")
"""Columns that no two runs have alike."""

FILE = """
scenarios:
  - constant_velocity
  - {name: stationary, parameters: {y: [8, 20]}}
seeds: 8
occlusions: [none, "mid:10"]
filters: [ca, md]
"""
"""48 runs of a few milliseconds."""


def small(**changed: Any) -> Sweep:
    """A sweep of 12 runs: three worlds of two seeds each, two filters."""
    given: dict[str, Any] = {
        "scenarios": [*crossed("constant_velocity"), *crossed("stationary", y=[8, 20])],
        "filters": ["ca", "md"],
        "seeds": 2,
        "occlusions": ["mid:10"],
    }
    return Sweep.of(**{**given, **changed})


def kept(folder: Path, kind: str = "runs") -> pl.DataFrame:
    """All rows in a folder but what was measured of the machine, in an order of their own."""
    rows = pl.concat([pl.read_parquet(path) for path in folder.glob(f"{kind}/*/*.parquet")])
    assert rows.schema == {"runs": RUNS, "growth": GROWN}[kind]
    own = rows.drop(MEASURED, strict=False)
    return own.sort(own.columns)


def whole(folder: Path) -> bool:
    """Whether nothing in a folder is half done or damaged."""
    found, damaged = Dataset(folder).finished()
    names = [path.name for path in folder.rglob("*") if path.is_file()]
    return bool(found) and not damaged and not any(name.endswith(".part") for name in names)
