"""The items of the paper by name."""

from collections.abc import Mapping
from types import MappingProxyType

from experiments.paper import (
    ablations,
    denoise,
    detector_tables,
    dynamics,
    occlusion_tables,
    range_tables,
    regime_tables,
    scene_items,
    showcase,
    speed_tables,
    switching,
)
from experiments.paper.item import Item

_ROOMS = (
    showcase,
    speed_tables,
    dynamics,
    denoise,
    detector_tables,
    range_tables,
    scene_items,
    occlusion_tables,
    regime_tables,
    switching,
    ablations,
)

_ORDER = (
    *("playback", "fig-tradeoff", "fig-dynamics", "fig-denoise"),
    *("table-models", "table-range", "table-derivative", "fig-stationary", "fig-occlusion"),
    *("fig-objects", "table-baseline", "fig-detectors", "table-idsw", "table-waymo"),
    *("fig-offscene", "fig-trajectory", "table-runtime", "table-occlusion"),
    *("regimes", "switching-error", "switching-response", "switching-gap", "ablations"),
)
"""The paper's, then what it does not ask; first of all something to look at."""

_BY_ID = {item.id: item for room in _ROOMS for item in room.ITEMS}

ITEMS: Mapping[str, Item] = MappingProxyType({name: _BY_ID[name] for name in _ORDER})
"""Items by name, in the order of the paper."""
