"""The items of the paper by name."""

from collections.abc import Mapping
from types import MappingProxyType

from experiments.paper import denoise, dynamics, occlusion_tables
from experiments.paper.item import Item

ITEMS: Mapping[str, Item] = MappingProxyType(
    {
        item.id: item
        for module in (
            dynamics,
            denoise,
            occlusion_tables,
        )
        for item in module.ITEMS
    }
)
"""Items by name, in the order of the paper."""
