"""The items of the paper by name."""

from collections.abc import Mapping
from types import MappingProxyType

from experiments.paper import occlusion_tables, scene_items
from experiments.paper.item import Item

ITEMS: Mapping[str, Item] = MappingProxyType(
    {item.id: item for module in (occlusion_tables, scene_items) for item in module.ITEMS}
)
"""Items by name, in the order of the paper."""
