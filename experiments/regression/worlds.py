"""Worlds by name, for tests: golden ones from files, others simulated once in a session."""

from pathlib import Path

from experiments.occlusion import OcclusionProtocol
from experiments.regression.golden import DETECTOR, PREFIX, golden_detections, golden_trace
from mdkf import Detections, Trace
from scenarios import Scenario, ScenarioError, load
from sim_bridge import detect, simulate, user_cache


class Worlds:
    """Traces and detections, each made once. Tables cannot be changed: tests may share them."""

    def __init__(self) -> None:
        self._traces: dict[tuple[str, int], Trace] = {}
        self._detections: dict[tuple[str, str, int], Detections] = {}

    def trace(self, world: str | Path | Scenario, /, seed: int = 0, **parameters: float) -> Trace:
        """The trace of a golden world (`golden:v1/stop_and_go`), or of a scenario of the catalogue,
        a scenario file or a `Scenario`, simulated with a seed or taken from the user's cache.

        Errors are those of `scenarios.load` and `sim_bridge.simulate`; a golden world has neither
        another seed nor parameters.
        """
        if isinstance(world, str) and world.startswith(PREFIX):
            if seed or parameters:
                raise ScenarioError(
                    f"{world} is as it was made: expected no seed and no parameters"
                )
            return golden_trace(world)
        if isinstance(world, Scenario):
            if parameters:
                raise ScenarioError(
                    f"scenario {world.name}: has its parameters, expected none beside it"
                )
            scenario = world
        else:
            scenario = load(world, **parameters)
        key = (scenario.identity(), seed)
        if key not in self._traces:
            cache = user_cache()
            make = simulate if cache is None else cache.simulate
            self._traces[key] = make(scenario, seed)
        return self._traces[key]

    def detections(
        self,
        world: str | Path | Scenario,
        /,
        seed: int = 0,
        detector: str | Path = DETECTOR,
        occlusion: str = "mid:20",
        **parameters: float,
    ) -> Detections:
        """What a detector sees of a world, without what the occlusion protocol hides
        (KIND:LENGTH[:WARMUP], or `none`). seed: the world's and the detector's; of a golden world
        the detector's alone."""
        is_golden = isinstance(world, str) and world.startswith(PREFIX)
        trace = self.trace(world, 0 if is_golden else seed, **parameters)
        key = (trace.content_hash(), str(detector), seed)
        if key not in self._detections:
            committed = is_golden and (detector, seed) == (DETECTOR, 0)
            self._detections[key] = (
                golden_detections(str(world)) if committed else detect(trace, detector, seed)
            )
        return OcclusionProtocol.parse(occlusion).apply(self._detections[key], trace)
