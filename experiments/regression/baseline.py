"""Baseline files: what a tracker scored in one world, as JSON that a person reviews in a diff.

One metric a line, with its unit and how far it may be off. What is within that distance stays as
it is written: accepting a change rewrites what has changed, and many small changes do not add up
unseen.
"""

import json
import math
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from experiments.regression.metrics import METRICS
from mdkf import Detections, Trace
from sim_bridge.parquet import replacing

SCHEMA = 1
_KEYS = ("schema", "mdkf", "machine", "world", "metrics", "position_error_by_second")

Seconds = Mapping[str, list[float | None]]
"""Mean position error by object and second [m]."""


class BaselineError(ValueError):
    """A baseline cannot be compared with: its file is malformed, or of another world."""


@dataclass(frozen=True)
class Pin:
    """A pinned value, NaN for "no value", and its tolerance: a number in the metric's unit, or a
    share of the value, as `1 %`."""

    value: float
    tolerance: str | float

    def allowed(self) -> float:
        """How far a value may be off, in the metric's unit."""
        if isinstance(self.tolerance, str):
            return abs(self.value) * float(self.tolerance.removesuffix("%")) / 100
        return float(self.tolerance)


@dataclass(frozen=True)
class Baseline:
    """What a file says. world: where the tracks come from, with the content hashes of `trace` and
    `detections`. seconds: `experiments.regression.metrics.error_by_second`."""

    world: Mapping[str, str]
    pins: Mapping[str, Pin]
    seconds: Seconds
    mdkf: str
    machine: str


def checked_tolerance(where: str, given: object) -> str | float:
    """A tolerance as `Pin` has it; `BaselineError` for anything else."""
    number = given
    if isinstance(given, str) and given.endswith("%"):
        try:
            number = float(given.removesuffix("%"))
        except ValueError:
            number = None
    is_number = isinstance(number, int | float) and not isinstance(number, bool)
    if not is_number or not (math.isfinite(number) and number >= 0):  # type: ignore[arg-type,operator]
        raise BaselineError(
            f"{where}: tolerance is {given!r}, expected a number in the metric's unit, or a share"
            " as '1 %', not below 0"
        )
    return given  # type: ignore[return-value]


def world_of(trace: Trace, detections: Detections) -> dict[str, str]:
    """Where tracks come from, as a baseline tells it."""
    told = detections.provenance
    occlusion = json.loads(told["occlusion"])["protocol"] if "occlusion" in told else "none"
    names = ("golden", "scenario", "parameters", "seed", "simulator", "detector", "detector_seed")
    return {
        **{name: told[name] for name in names if name in told},
        "occlusion": occlusion,
        "trace": trace.content_hash(),
        "detections": detections.content_hash(),
    }


def read(path: Path) -> Baseline:
    """The baseline in a file; `BaselineError` names what is wrong with it."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BaselineError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise BaselineError(f"{path}: expected JSON: {error}") from None
    if not isinstance(document, dict) or document.get("schema") != SCHEMA:
        raise BaselineError(f"{path}: expected a baseline of schema {SCHEMA}")
    for key in _KEYS:
        kind = int if key == "schema" else str if key in ("mdkf", "machine") else dict
        if not isinstance(document.get(key), kind):
            raise BaselineError(f"{path}: key {key}: expected {kind.__name__}")
    pins = {name: _pin(path, name, entry) for name, entry in document["metrics"].items()}
    if not pins:
        raise BaselineError(f"{path}: key metrics: expected at least one")
    for identifier, errors in document["position_error_by_second"].items():
        if not isinstance(errors, list) or not all(
            error is None or isinstance(error, int | float) for error in errors
        ):
            raise BaselineError(
                f"{path}: key position_error_by_second.{identifier}: expected a list of numbers"
            )
    return Baseline(
        document["world"],
        pins,
        document["position_error_by_second"],
        document["mdkf"],
        document["machine"],
    )


def write(path: Path, world: Mapping[str, str], pins: Mapping[str, Pin], seconds: Seconds) -> None:
    """Write a baseline, whole or not at all; its folder is made."""
    head = {
        "schema": SCHEMA,
        "mdkf": version("mdkf"),
        "machine": f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
        "world": dict(world),
    }
    metrics = {
        name: {
            "value": None if math.isnan(pin.value) else pin.value,
            "unit": METRICS[name].unit,
            "better": METRICS[name].better,
            "tolerance": pin.tolerance,
        }
        for name, pin in pins.items()
    }
    text = json.dumps(head, indent=2, ensure_ascii=False).removesuffix("\n}")
    text += f',\n  "metrics": {_lines(metrics)}'
    text += f',\n  "position_error_by_second": {_lines(seconds)}\n}}\n'
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _lines(entries: Mapping[str, Any]) -> str:
    """A JSON object, one entry a line."""
    lines = [
        f"    {json.dumps(name)}: {json.dumps(entry, ensure_ascii=False, allow_nan=False)}"
        for name, entry in entries.items()
    ]
    return "{\n" + ",\n".join(lines) + "\n  }" if lines else "{}"


def _pin(path: Path, name: str, entry: Any) -> Pin:
    where = f"{path}: key metrics.{name}"
    if name not in METRICS:
        raise BaselineError(f"{where}: no such metric, expected one of: {', '.join(METRICS)}")
    if not isinstance(entry, dict) or not {"value", "tolerance"} <= entry.keys():
        raise BaselineError(f"{where}: expected an object with value and tolerance")
    value = entry["value"]
    if value is not None and (isinstance(value, bool) or not isinstance(value, int | float)):
        raise BaselineError(f"{where}: value is {value!r}, expected a number or null")
    tolerance = checked_tolerance(where, entry["tolerance"])
    return Pin(math.nan if value is None else float(value), tolerance)
