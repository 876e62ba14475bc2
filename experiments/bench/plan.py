"""How much is measured: the sizes, and how long and how often."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Plan:
    """All that decides how long a benchmark takes.

    rounds: interleaved measurements of each case; processes: of each start of a process.
    shortest: CPU time of a measurement, at least [s].
    tracks: numbers of tracks of the filters; reference: those at which filterpy and numpy run,
    one track at a time: their cost per track is the same for any number.
    steps: of a run, frame by frame; updates: of all tracks together in a compiled run, which has
    at least `passes` steps: a pass also starts the tracks and makes room for the estimates.
    objects: numbers of objects of the whole tracker; frames: of its sequence.
    crowds: numbers of objects whose tracks are scored; scored: frames of each.
    boxes: in view of the sensor.
    simulated: of dense traffic, for a trace [s].
    seeds: of each closed form of a sweep. driven: scenarios of traffic of another, so many drives.
    """

    rounds: int = 7
    processes: int = 3
    shortest: float = 0.02
    tracks: tuple[int, ...] = (1, 10, 50, 200, 1000, 10_000)
    reference: tuple[int, ...] = (1, 10)
    steps: int = 20
    updates: int = 100_000
    passes: int = 50
    objects: tuple[int, ...] = (10, 50, 200, 1000)
    frames: int = 100
    crowds: tuple[int, ...] = (20, 200)
    scored: int = 1000
    boxes: int = 200
    simulated: float = 60.0
    seeds: int = 25
    driven: tuple[str, ...] = (
        *("bus_stop", "stop_and_go", "green_wave", "parked_row", "passing_van"),
        *("off_scene", "roundabout", "mixed_traffic", "emergency_braking", "motorway"),
    )
    drives: int = 3


QUICK = Plan(
    rounds=3,
    processes=1,
    shortest=0.002,
    updates=20_000,
    frames=50,
    scored=200,
    seeds=1,
    driven=("stop_and_go",),
    drives=1,
)
"""A look at all sizes in some seconds."""
