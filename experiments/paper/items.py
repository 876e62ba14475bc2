"""The items of the paper by name."""

from collections.abc import Mapping
from types import MappingProxyType

from experiments.paper import detector_tables, occlusion_tables, range_tables
from experiments.paper.item import Item

ITEMS: Mapping[str, Item] = MappingProxyType(
    {
        item.id: item
        for module in (detector_tables, range_tables, occlusion_tables)
        for item in module.ITEMS
    }
)
"""Items by name, in the order of the paper."""
