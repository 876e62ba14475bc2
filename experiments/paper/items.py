"""The items of the paper by name."""

from collections.abc import Mapping
from types import MappingProxyType

from experiments.paper import occlusion_tables, regime_tables, speed_tables
from experiments.paper.item import Item

_MODULES = (occlusion_tables, regime_tables, speed_tables)

ITEMS: Mapping[str, Item] = MappingProxyType(
    {item.id: item for module in _MODULES for item in module.ITEMS}
)
"""Items by name, in the order of the paper."""
