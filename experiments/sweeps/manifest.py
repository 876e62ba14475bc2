"""What a folder of results is of, in `manifest.json`: the sweep, the command, the versions and the
machine that made it, and the SHA-256 of every file."""

import hashlib
import json
import os
import platform
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from experiments.engine import cores
from experiments.sources import VERSIONS
from experiments.sweeps.sweep import Sweep, SweepError
from experiments.sweeps.task import sources
from sim_bridge.parquet import replacing

NAME = "manifest.json"


def check(folder: Path) -> None:
    """Raise `SweepError` if the results in a folder were made by other sources or versions: they
    cannot be gone on with."""
    path = folder / NAME
    if not path.exists():
        if any(folder.glob("runs/*/*.parquet")):
            raise SweepError(f"{path}: is missing, so nobody knows what made {folder / 'runs'}")
        return
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        made_by = str(told["sources"]), str(told["versions"]["mdkf"])
    except (ValueError, TypeError, KeyError):
        raise SweepError(f"{path}: is not a manifest of a sweep") from None
    if made_by[0] != sources():
        raise SweepError(
            f"{folder}: its results are of other sources or versions (mdkf {made_by[1]}, sources"
            f" {made_by[0][:12]}; now {sources()[:12]}): give another folder, or --fresh to begin"
            " anew"
        )


def begin(folder: Path, sweep: Sweep, command: Sequence[str], workers: str) -> dict[str, Any]:
    """Write the manifest of a sweep that begins, and give it."""
    described = describe(sweep)
    text = json.dumps(described, sort_keys=True)
    told = {
        "state": "running",
        "command": list(command),
        "began": _now(),
        "ended": None,
        "sweep": described,
        "sweep_sha256": hashlib.sha256(text.encode()).hexdigest(),
        "sources": sources(),
        "versions": {package: version(package) for package in ("mdkf", "polars", *VERSIONS)},
        "machine": {
            "system": platform.platform(),
            "processor": platform.machine(),
            "python": platform.python_version(),
            "cores": cores(),
            "memory_bytes": os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"),
        },
        "workers": workers,
    }
    _write(folder, told)
    return told


def end(
    folder: Path,
    told: Mapping[str, Any],
    state: str,
    runs: Mapping[str, int],
    files: Mapping[str, str],
) -> None:
    """Write it anew when the sweep ends: how (`finished`, `incomplete` after a preview,
    `interrupted`, or `failed` for a full disk or a lost cluster), with how many runs of each
    status, in what files."""
    _write(folder, {**told, "state": state, "ended": _now(), "runs": runs, "files": files})


def describe(sweep: Sweep) -> dict[str, Any]:
    """A sweep as JSON holds it."""
    return {
        "scenarios": [
            {
                "name": scenario.name,
                "parameters": dict(scenario.parameters),
                "identity_sha256": hashlib.sha256(scenario.identity().encode()).hexdigest(),
            }
            for scenario in sweep.scenarios
        ],
        "seeds": list(sweep.seeds),
        "detectors": list(sweep.detectors),
        "occlusions": [str(one) for one in sweep.occlusions],
        "filters": {one.name: repr(one.estimator) for one in sweep.filters},
        "tracker": [dict(one.changed) for one in sweep.tracker],
        "gap_truth": sweep.gap_truth,
    }


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _write(folder: Path, told: Mapping[str, Any]) -> None:
    with replacing(folder / NAME) as temporary:
        temporary.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
