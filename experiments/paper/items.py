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

ITEMS: Mapping[str, Item] = MappingProxyType(
    {item.id: item for room in _ROOMS for item in room.ITEMS}
)
"""Items by name, in the order of the paper."""
