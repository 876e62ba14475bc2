"""The table of raw simulator samples, between a simulator and smoothing.

`sim_bridge.sumo` makes it from a scenario, and smoothing makes a trace from it.
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.int64]
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """What a simulator reported, one row per vehicle and step, sorted by (vehicle, time_index).

    `step` [s]. Rows, all `(n_rows,)`: `vehicle` indexes the per-vehicle fields; `time_index` counts
    steps from the start of the recording; `x`, `y` [m] of the **front bumper**; `heading` [rad]
    counter-clockwise from x; `speed` [m/s]. Vehicles, all `(n_vehicles,)`, sorted by name: `names`,
    `kinds`, `length`, `width`, `height` [m]. `simulator` is its name and version.
    """

    step: float
    vehicle: Integers
    time_index: Integers
    x: Floats
    y: Floats
    heading: Floats
    speed: Floats
    names: tuple[str, ...]
    kinds: tuple[str, ...]
    length: Floats
    width: Floats
    height: Floats
    simulator: str

    def rows_of(self, vehicle: int) -> slice:
        """Rows of one vehicle, in the order of time."""
        first, last = np.searchsorted(self.vehicle, [vehicle, vehicle + 1])
        return slice(int(first), int(last))

    def same_as(self, other: "Recording") -> bool:
        """Whether every number and name is the same, to the last bit."""
        return all(
            np.array_equal(getattr(self, field.name), getattr(other, field.name))
            for field in fields(self)
        )
