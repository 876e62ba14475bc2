"""What a sweep is: scenarios, seeds, detectors, rules of the tracker, occlusions and filters, all
of them crossed.

A world is a scenario with a seed. A run is what one filter makes of a world as one detector sees
it through one occlusion. Everything here is plain data, the same whether a YAML file
(`experiments.sweeps.file`) or a script makes it.
"""

from collections import Counter
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from itertools import product
from typing import Any

import mdkf
import scenarios
import sim_bridge
from experiments.occlusion import OcclusionProtocol
from experiments.population import GapTruth
from mdkf import Estimator, TrackerSettings
from mdkf.settings import tracker_settings
from scenarios import Scenario
from scenarios.scenario import format_number

SEEDS = 6
"""Seeds of a sweep that does not say how many."""


class SweepError(ValueError):
    """A sweep that cannot be run; the message is one line."""


@dataclass(frozen=True)
class Filter:
    """An estimator, and what the results call it."""

    name: str
    estimator: Estimator = field(hash=False)

    @classmethod
    def of(cls, name: str, /, **options: Any) -> "Filter":
        """The filter of a name (`mdkf.estimator`), with some of its options replaced; the results
        call it as `md(window=20)`.

        Raises `SweepError` for an unknown name or option, and for a value that it refuses.
        """
        try:
            built: Any = mdkf.estimator(name)
        except ValueError as error:
            raise SweepError(str(error)) from None
        if not options:
            return cls(name, built)
        known = [f.name for f in fields(built) if f.init] if is_dataclass(built) else []
        for option in options:
            if option not in known:
                expected = ", ".join(known) or "none"
                raise SweepError(
                    f"filter {name!r}: unknown option {option!r}; expected one of: {expected}"
                )
        values = {key: tuple(v) if isinstance(v, list) else v for key, v in options.items()}
        try:
            return cls(_named(name, options), replace(built, **values))
        except (TypeError, ValueError) as error:
            raise SweepError(f"filter {name!r}: {error}") from None


@dataclass(frozen=True)
class Rules:
    """Rules of the tracker in place of the detector's own: fields of `TrackerSettings`, and
    `settings`, the name of another detector whose rules the others are."""

    changed: Mapping[str, Any] = field(default_factory=dict, hash=False)

    def __str__(self) -> str:
        return told(self.changed)

    def settings(self, detector: str) -> TrackerSettings:
        """The tracker's settings with a detector; `SweepError` for what they cannot be."""
        values = dict(self.changed)
        name = str(values.pop("settings", None) or sim_bridge.detector_name(detector))
        known = [f.name for f in fields(TrackerSettings)]
        for rule in values:
            if rule not in known:
                expected = ", ".join(["settings", *known])
                raise SweepError(f"tracker: unknown rule {rule!r}; expected one of: {expected}")
        try:
            return replace(tracker_settings(name), **values)
        except (TypeError, ValueError) as error:
            raise SweepError(f"tracker: {error}") from None


@dataclass(frozen=True)
class Setup:
    """All of a run but its world: how that is seen, tracked and scored."""

    detector: str
    rules: Rules
    settings: TrackerSettings
    occlusion: OcclusionProtocol
    filter: Filter
    gap_truth: GapTruth


@dataclass(frozen=True)
class Sweep:
    """Everything crossed with everything; `of` takes it as texts.

    scenarios: each with its parameters. tracker: one run for each. Raises `SweepError` where
    nothing is given or something twice, and what `sim_bridge.check_inputs` and `check_detector`
    raise for a scenario that cannot be simulated, or seen by one of the detectors.
    """

    scenarios: tuple[Scenario, ...]
    filters: tuple[Filter, ...]
    seeds: tuple[int, ...] = tuple(range(SEEDS))
    detectors: tuple[str, ...] = ("pointrcnn",)
    occlusions: tuple[OcclusionProtocol, ...] = (OcclusionProtocol(),)
    tracker: tuple[Rules, ...] = (Rules(),)
    gap_truth: GapTruth = "keep"

    def __post_init__(self) -> None:
        named: Mapping[str, Sequence[Hashable]] = {
            "scenarios": list(self.labels()),
            "filters": [one.name for one in self.filters],
            "seeds": self.seeds,
            "detectors": self.detectors,
            "occlusions": [str(one) for one in self.occlusions],
            "tracker": [str(one) for one in self.tracker],
        }
        for key, names in named.items():
            if not names:
                raise SweepError(f"{key}: expected one at least")
            name, times = Counter(names).most_common(1)[0]
            if times > 1:
                raise SweepError(f"{key}: {name} is there twice")
        if self.gap_truth not in ("keep", "ignore"):
            raise SweepError(f"gap_truth is {self.gap_truth!r}, expected keep or ignore")
        for scenario in self.scenarios:
            sim_bridge.check_inputs(scenario)
            for detector in self.detectors:
                sim_bridge.check_detector(detector, scenario)
        self.setups()

    @classmethod
    def of(
        cls,
        scenarios: Iterable[Scenario | str],
        filters: Iterable[Filter | str],
        seeds: int | Iterable[int] = SEEDS,
        detectors: Iterable[str] = ("pointrcnn",),
        occlusions: Iterable[OcclusionProtocol | str] = ("mid:20",),
        tracker: Iterable[Mapping[str, Any]] = ({},),
        gap_truth: GapTruth = "keep",
    ) -> "Sweep":
        """A sweep of names and texts as commands take them: scenarios by name or file, filters by
        name, occlusions such as `mid:20`; seeds by number or how many. Raises as the sweep does,
        and what `scenarios.load` raises."""
        numbers = range(seeds) if isinstance(seeds, int) else seeds
        return cls(
            tuple(_loaded(one) for one in scenarios),
            tuple(one if isinstance(one, Filter) else Filter.of(one) for one in filters),
            tuple(numbers),
            tuple(detectors),
            tuple(_protocol(one) for one in occlusions),
            tuple(Rules(one) for one in tracker),
            gap_truth,
        )

    def setups(self) -> tuple[Setup, ...]:
        """What is done with each world, in the order in which it shares most work."""
        return tuple(
            Setup(detector, rules, rules.settings(detector), occlusion, filter, self.gap_truth)
            for detector in self.detectors
            for occlusion in self.occlusions
            for rules in self.tracker
            for filter in self.filters
        )

    def worlds(self) -> Iterator[tuple[Scenario, int, tuple[Setup, ...]]]:
        """Every scenario with every seed, and what is done with it; seeds first: what is
        interrupted has a few seeds of all scenarios. What was recorded no seed changes, so a
        recorded detector, which sees recorded scenarios only, is there with the first alone."""
        first = self.setups()
        others = tuple(one for one in first if not sim_bridge.is_recorded(one.detector))
        for seed in self.seeds:
            if own := first if seed == self.seeds[0] else others:
                for scenario in self.scenarios:
                    yield scenario, seed, own

    def labels(self) -> tuple[str, ...]:
        """Each scenario by its name, and those of its parameters that are not everywhere at their
        defaults: `stop_and_go(speed=8)`."""
        changed: dict[str, set[str]] = {}
        for one in self.scenarios:
            defaults = {spec.name: spec.default for spec in one.parameter_specs}
            own = {name for name, value in one.parameters.items() if value != defaults.get(name)}
            changed.setdefault(one.name, set()).update(own)
        return tuple(
            _named(one.name, {k: v for k, v in one.parameters.items() if k in changed[one.name]})
            for one in self.scenarios
        )

    def __len__(self) -> int:
        """How many runs."""
        return sum(len(setups) for _, _, setups in self.worlds())


def crossed(scenario: str, **parameters: float | Iterable[float]) -> tuple[Scenario, ...]:
    """A scenario with its parameters crossed: `crossed("stop_and_go", speed=[8, 11], traffic=0.3)`
    are two. Raises what `scenarios.load` raises."""
    values = [one if isinstance(one, Iterable) else (one,) for one in parameters.values()]
    chosen = (dict(zip(parameters, row, strict=True)) for row in product(*values))
    return tuple(scenarios.load(scenario, **one) for one in chosen)


def _loaded(scenario: Scenario | str) -> Scenario:
    """A scenario, loaded if it is a name or a file; raises what `scenarios.load` raises."""
    return scenario if isinstance(scenario, Scenario) else scenarios.load(scenario)


def told(options: Mapping[str, Any]) -> str:
    """Options in one line, as `gate=3, cost=distance`."""
    return ", ".join(f"{name}={_shown(value)}" for name, value in options.items())


def _named(name: str, options: Mapping[str, Any]) -> str:
    return f"{name}({told(options)})" if options else name


def _shown(value: Any) -> str:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    return format_number(value)


def _protocol(given: OcclusionProtocol | str) -> OcclusionProtocol:
    if isinstance(given, OcclusionProtocol):
        return given
    try:
        return OcclusionProtocol.parse(given)
    except ValueError as error:
        raise SweepError(str(error)) from None
