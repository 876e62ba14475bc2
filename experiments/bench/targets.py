"""Results into targets met or not. They are shown, never a test and never an exit status."""

from collections.abc import Iterator
from dataclasses import dataclass

from experiments.bench import (
    filters,
    recordings,
    scoring,
    sensing,
    simulation,
    start_up,
    trackers,
)
from experiments.bench.measure import Summary, summary
from experiments.bench.results import Results

PAPER_LATENCY = {"ca": 1003.0, "imm": 5586.0, "md": 1847.0}
"""The paper's latencies of the whole tracker on KITTI validation [ms], table "Evaluation on KITTI
validation dataset with VirConv"."""

PAPER_RATIOS = {
    f"{first}/{second}": PAPER_LATENCY[first] / PAPER_LATENCY[second]
    for first, second in (("md", "ca"), ("imm", "md"))
}
"""MD costs 1.84 times what CA costs, IMM 3.02 times what MD costs."""

TIMES_FILTERPY = {"ca": 500.0, "md": 200.0}
TRACKS = 50
FLAT = 2.0
FEWER, MORE = 1000, 10_000
MD_OVER_CA = 1.3
OBJECTS = 10
CROWD, CROWD_FRAMES = 1000, 10.0
"""Objects, and frames a second at least."""
RECORDED_FRAMES = 200_000.0
"""A second at least, of MD on KITTI's val split; RobMOT's C++ does 14 000 to 22 000."""
WARM_START = 2.0
"""[s]"""
TIMES_TRACKEVAL = {20: 10.0, 200: 1.0}
"""By the number of objects in the crowd."""
SIGHT = {sensing.FRACTIONS: 300.0, sensing.RETURNS: 100.0}
"""At `BOXES` boxes [us per frame]."""
BOXES = 200
FLOW = {simulation.TRACE: 3.0, simulation.DETECTIONS: 1.0}
"""Of a minute of dense traffic [CPU s]."""


@dataclass(frozen=True)
class Target:
    """A target and what was measured. bound: the target's number; at_least: it is the smallest
    that meets it, otherwise the largest; low, high: 10th and 90th percentiles over rounds."""

    target: str
    tier: str
    bound: float
    at_least: bool
    median: float
    low: float
    high: float

    @property
    def met(self) -> bool:
        """Whether the median meets the target."""
        return self.median >= self.bound if self.at_least else self.median <= self.bound

    @property
    def clear(self) -> bool:
        """Whether the whole spread is on the median's side of the bound."""
        return not self.low < self.bound < self.high


def targets(results: Results) -> list[Target]:
    """The targets of what was measured."""
    known = (
        _against_filterpy,
        _flat,
        _tracker,
        _crowd,
        _recorded,
        _scoring,
        _sight,
        _flow,
        _start,
    )
    return [target for part in known for target in part(results)]


def _against_filterpy(results: Results) -> Iterator[Target]:
    for block in results.blocks:
        for case in block.cases:
            measured = (case.what, case.size) == (filters.WHAT, TRACKS)
            if measured and block.anchor and case.name in TIMES_FILTERPY:
                text = f"{case.name} at {TRACKS} tracks, times as fast as filterpy's ca"
                bound = TIMES_FILTERPY[case.name]
                faster = results.cost_ratio(block.anchor, case)
                yield Target(text, case.tier, bound, True, *faster)


def _flat(results: Results) -> Iterator[Target]:
    for tier in (filters.CALLS, filters.KERNEL):
        few = results.cases(filters.WHAT, tier, FEWER)
        many = results.cases(filters.WHAT, tier, MORE)
        growth = {name: results.cost_ratio(many[name], few[name]) for name in few if name in many}
        if growth:
            name = max(growth, key=lambda name: growth[name].median)
            text = f"cost per track, {MORE} tracks over {FEWER}; worst of all, {name}"
            yield Target(text, tier, FLAT, False, *growth[name])


def _tracker(results: Results) -> Iterator[Target]:
    cases = results.cases(trackers.WHAT, trackers.TIER, OBJECTS)
    if cases:
        cost: Summary = results.cost_ratio(cases["md"], cases["ca"])
        text = f"the whole tracker at {OBJECTS} objects, cost of md over ca"
        yield Target(text, trackers.TIER, MD_OVER_CA, False, *cost)


def _crowd(results: Results) -> Iterator[Target]:
    for name, case in results.cases(trackers.WHAT, trackers.TIER, CROWD).items():
        text = f"{name}, {CROWD} objects: frames a second"
        yield Target(text, case.tier, CROWD_FRAMES, True, *summary(1.0 / results.samples[case]))


def _recorded(results: Results) -> Iterator[Target]:
    for block in results.blocks:
        for case in block.cases:
            if (case.what, case.name) == (recordings.WHAT, "md"):
                text = f"{case.name} on KITTI's {recordings.SPLIT} split: frames a second"
                frames = summary(1.0 / results.samples[case])
                yield Target(text, case.tier, RECORDED_FRAMES, True, *frames)


def _scoring(results: Results) -> Iterator[Target]:
    for objects, bound in TIMES_TRACKEVAL.items():
        ours = results.cases(scoring.WHAT, scoring.TIER, objects).get(scoring.NAME)
        theirs = results.cases(scoring.WHAT, scoring.TRACKEVAL, objects).get(scoring.NAME)
        if ours and theirs:
            text = f"{scoring.NAME} of {objects} objects, times as fast as trackeval"
            yield Target(text, scoring.TIER, bound, True, *results.cost_ratio(theirs, ours))


def _sight(results: Results) -> Iterator[Target]:
    for name, case in results.cases(sensing.WHAT, sensing.TIER, BOXES).items():
        text = f"{name} of {BOXES} boxes [us per frame]"
        yield Target(
            text, case.tier, SIGHT[name], False, *summary(results.samples[case] * case.per_second)
        )


def _flow(results: Results) -> Iterator[Target]:
    cases = results.cases(simulation.WHAT, simulation.TIER, simulation.VEHICLES)
    for name, bound in FLOW.items():
        if name in cases:
            text = f"{name} of a minute of {simulation.VEHICLES} vehicles [CPU s]"
            measured = summary(results.samples[cases[name]])
            yield Target(text, simulation.TIER, bound, False, *measured)


def _start(results: Results) -> Iterator[Target]:
    case = results.cases(start_up.WHAT, start_up.TIER, start_up.TRACKS).get(start_up.NAME)
    if case is not None:
        text = f"fresh process, caches warm, first step of {case.name} [CPU s]"
        yield Target(text, case.tier, WARM_START, False, *summary(results.samples[case]))
