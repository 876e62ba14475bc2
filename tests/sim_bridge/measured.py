"""What a detector makes of a convoy, and profiles changed for one claim.

Nothing here comes from the code under test but the profile's schema and the tables themselves.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy import integrate
from scipy.special import expit

import sim_bridge
from mdkf.tables import CLUTTER, Detections, FloatArray, Trace
from sim_bridge import Profile
from tests.sim_bridge.worlds import SIZE

POINTRCNN = Path(sim_bridge.__file__).with_name("detectors") / "pointrcnn.yaml"


def document() -> dict[str, Any]:
    """The numbers of pointrcnn.yaml."""
    numbers: dict[str, Any] = yaml.safe_load(POINTRCNN.read_text(encoding="utf-8"))
    return numbers


def errors_of(numbers: dict[str, Any]) -> dict[str, dict[str, float]]:
    """The law of every error by its name."""
    names = ("radial", "lateral", "vertical", "yaw")
    return {**{name: numbers[name] for name in names}, **numbers["size"]}


LAW = document()
ERRORS = errors_of(LAW)
MAX_RANGE: float = LAW["max_range"]  # m


def changed(change: Callable[[dict[str, Any]], None]) -> Profile:
    """The pointrcnn profile with a change."""
    numbers = document()
    change(numbers)
    return Profile.model_validate(numbers)


def quiet(numbers: dict[str, Any]) -> None:
    """No errors, no clutter, and all detected that has a return and is not hidden."""
    for error in errors_of(numbers).values():
        error |= {"bias_per_range": 0.0, "constant": 0.0, "near": 0.0, "per_range_squared": 0.0}
    numbers["detection"] |= {"range": 1e6, "half_points": 0.0}
    numbers["flip"]["constant"] = -1000.0
    numbers["clutter"]["flashes"]["density"] = 0.0
    numbers["clutter"]["ghosts"]["density"] = 0.0


def clutter_area(up_to: float = MAX_RANGE) -> float:
    """Around the sensor [m2], every part counted with sigmoid((reach - r) / reach_width)."""
    law = LAW["clutter"]

    def ring(r: float) -> float:
        return float(2 * np.pi * r * expit((law["reach"] - r) / law["reach_width"]))

    return float(integrate.quad(ring, law["min_range"], up_to)[0])


def dense(trace: Trace, detections: Detections) -> dict[str, FloatArray]:
    """Errors of every object (rows) in every frame (columns) of a convoy; NaN where missed."""
    true = detections.source != CLUTTER
    source, frame = detections.source[true], detections.frame[true]
    row = frame * len(trace.ids()) + source
    error = {
        name: getattr(detections, name)[true] - getattr(trace, name)[row]
        for name in ("x", "y", "z", "yaw", *SIZE)
    }
    x, y = trace.x[row] - trace.ego.x[frame], trace.y[row] - trace.ego.y[frame]
    r = np.hypot(x, y)
    values = {
        **error,
        "radial": (error["x"] * x + error["y"] * y) / r,
        "lateral": (error["y"] * x - error["x"] * y) / r,
        "vertical": error["z"],
        # The axis of a box is the same backwards; errors of a quarter turn do not happen here.
        "yaw": np.angle(np.exp(2j * error["yaw"])) / 2,
        "flip": np.cos(error["yaw"]) < 0.0,
        "score": detections.score[true],
        "seen": np.ones(len(row)),
    }
    shape = (len(trace.ids()), trace.n_frames)
    table = {name: np.full(shape, np.nan) for name in values}
    for name, column in values.items():
        table[name][source, frame] = column
    table["seen"] = np.nan_to_num(table["seen"])
    return table


def autocorrelation(errors: FloatArray, lag: int) -> float:
    """Of errors (objects, frames) with a known mean of zero, over pairs without a NaN."""
    return float(
        np.nanmean(errors[:, lag:] * errors[:, : errors.shape[1] - lag]) / np.nanmean(errors**2)
    )


def with_columns(trace: Trace, **columns: FloatArray) -> Trace:
    """The trace with some columns replaced."""
    return Trace.from_columns(
        trace.columns() | columns,
        n_frames=trace.n_frames,
        dt=trace.dt,
        ego=trace.ego,
        provenance=trace.provenance,
    )
