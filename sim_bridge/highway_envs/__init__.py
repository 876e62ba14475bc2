"""Environments of our own for highway-env: gentle drivers, vehicles of several sizes, scenes.

`drivers` holds who drives along lanes, `route_drivers` who drives along a route and gives way;
each of the other modules a kind of road. They import highway-env, which takes a second; this one
only tells gymnasium where they are.
"""

ENVIRONMENTS = {
    "mdkf/motorway-v0": "motorway:Motorway",
    "mdkf/stop-and-go-wave-v0": "motorway:StopAndGoWave",
    "mdkf/merge-v0": "motorway:Merge",
    "mdkf/roundabout-v0": "junctions:Roundabout",
    "mdkf/intersection-v0": "junctions:Intersection",
    "mdkf/parked-truck-v0": "two_way:Street",
    "mdkf/overtaking-v0": "two_way:Overtaking",
}


def register() -> None:
    """Make these environments known to gymnasium, once."""
    import gymnasium

    for name, entry in ENVIRONMENTS.items():
        if name not in gymnasium.registry:
            gymnasium.register(id=name, entry_point=f"{__name__}.{entry}")
