"""The parameters of a scenario that are searched, within bounds; the others are fixed."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import scenarios
from scenarios import ParameterSpec, Scenario, ScenarioError
from scenarios.scenario import format_number

Point = Mapping[str, float]
"""A value for each axis of a space."""

DIGITS = 3
"""Of an axis' width: what is finer is rounded away, so that a worst case can be read."""


@dataclass(frozen=True)
class Space:
    """scenario: as `scenarios.load` takes it. fixed: parameters that are not searched and not at
    their defaults. axes: what is searched, the specs' bounds narrowed to those of the search."""

    scenario: str
    fixed: Mapping[str, float] = field(hash=False)
    axes: tuple[ParameterSpec, ...]

    @property
    def defaults(self) -> Scenario:
        """The scenario with nothing changed but what is fixed: the control."""
        return scenarios.load(self.scenario, **self.fixed)

    def at(self, point: Point) -> Scenario:
        """The scenario at a point."""
        return scenarios.load(self.scenario, **self.fixed, **point)

    def point(self, unit: Sequence[float]) -> dict[str, float]:
        """The point at places between 0 and 1 along the axes, rounded."""
        return {
            axis.name: _rounded(axis, axis.minimum + place * (axis.maximum - axis.minimum))
            for axis, place in zip(self.axes, unit, strict=True)
        }

    def distance(self, a: Point, b: Point) -> float:
        """The largest difference along an axis, of its width."""
        return max(
            abs(a[axis.name] - b[axis.name]) / (axis.maximum - axis.minimum) for axis in self.axes
        )


def space_of(
    scenario: str, fixed: Mapping[str, float], bounds: Mapping[str, tuple[float, float]]
) -> Space:
    """The space between bounds (name: lowest, highest); without any, all parameters that are not
    fixed, within their declared bounds.

    Raises `ScenarioError` for what is no parameter, for bounds that are not within the declared
    ones, for a parameter that is fixed and searched, and if nothing is left to search.
    """
    chosen = scenarios.load(scenario, **fixed)
    specs = {spec.name: spec for spec in chosen.parameter_specs}
    for name, ends in bounds.items():
        for end in ends:
            scenarios.load(scenario, **{name: end})  # tells what is no parameter, or out of bounds
        if name in fixed:
            raise ScenarioError(f"scenario {chosen.name}: parameter {name} is fixed and has bounds")
        if not ends[0] < ends[1]:
            low, high = map(format_number, ends)
            raise ScenarioError(
                f"scenario {chosen.name}: bounds of {name} are {low}:{high}, expected LOW < HIGH;"
                " fix a parameter with --set"
            )
    free = (name for name in specs if name not in fixed)
    searched = bounds or {name: (specs[name].minimum, specs[name].maximum) for name in free}
    axes = tuple(
        replace(specs[name], minimum=low, maximum=high)
        for name, (low, high) in searched.items()
        if low < high
    )
    if not axes:
        raise ScenarioError(
            f"scenario {chosen.name}: nothing to search, expected a parameter that is not fixed"
            f" (declared: {', '.join(specs) or 'none'})"
        )
    return Space(scenario, dict(fixed), axes)


def _rounded(axis: ParameterSpec, value: float) -> float:
    if axis.integer:
        return round(value)
    decimals = DIGITS - math.floor(math.log10(axis.maximum - axis.minimum))
    return min(max(round(value, decimals), axis.minimum), axis.maximum)
