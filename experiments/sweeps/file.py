"""A sweep's YAML file into a `Sweep`.

    scenarios:                       # names, files, or names with parameters; lists are crossed
      - bus_stop
      - {name: stop_and_go, parameters: {speed: [8, 11], traffic: 0.3}}
    seeds: 20                        # so many from 0, or a list
    detectors: [pointrcnn]
    occlusions: [none, "mid:20", {kind: [mid, late], length: [5, 10], gaps: 1}]
    filters: [ca, imm, md, {name: md, as: md-wide, options: {window: 20}}]
    tracker: {gate: [3, 4]}          # rules in place of the detector's own
    gap_truth: keep

An option whose value is a list is crossed over it; one that is a list itself stands in another.
Files of scenarios and detectors are relative to the sweep's own.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, fields
from itertools import product
from math import prod
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, ConfigDict, Discriminator, Field, Tag, model_validator

from experiments.occlusion import Kind, OcclusionProtocol
from experiments.sweeps.sweep import SEEDS, Filter, Rules, Sweep, SweepError, crossed
from scenarios import Scenario
from scenarios.settings import Settings, read_settings

MAX_RUNS = 1_000_000
"""More runs than a million are taken for a mistake."""

_Text = Annotated[str, Field(pattern=r"^[^\r\n]+$", max_length=300)]
_Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.+-]*$", max_length=60)]
_Key = Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_]*$", max_length=64)]
_Seed = Annotated[int, Field(ge=0, lt=2**63)]
_Seeds = Annotated[
    Annotated[int, Field(ge=1), Tag("[number]")] | Annotated[list[_Seed], Tag("[list]")],
    Discriminator(lambda given: "[list]" if isinstance(given, list) else "[number]"),
]


def _listed(value: Any) -> Any:
    """One value is a list of one."""
    return value if isinstance(value, list) else [value]


_KEYS = {"n_gaps": "gaps"}
"""Fields of a protocol that have another name in a file, as in its text."""
_FIELDS = {key: name for name, key in _KEYS.items()}

_Choices = Annotated[list[Any], BeforeValidator(_listed)]
"""What an option is crossed over; the filter, or the tracker, says what it takes."""


class ScenarioEntry(Settings):
    """One entry under `scenarios`: a name or file, and parameters, each a number or a list."""

    name: _Text
    parameters: dict[_Key, Annotated[list[float], BeforeValidator(_listed)]] = Field(
        default_factory=dict
    )

    @model_validator(mode="before")
    @classmethod
    def _name_alone(cls, given: Any) -> Any:
        return {"name": given} if isinstance(given, str) else given


class FilterEntry(Settings):
    """One entry under `filters`: a name, options, and another name for the results."""

    name: _Text
    called: _Name | None = Field(default=None, alias="as")
    options: dict[_Key, _Choices] = Field(default_factory=dict)

    @model_validator(mode="before")
    @classmethod
    def _name_alone(cls, given: Any) -> Any:
        return {"name": given} if isinstance(given, str) else given


class OcclusionEntry(Settings):
    """One entry under `occlusions`: the fields of `OcclusionProtocol`, each a value or a list."""

    model_config = ConfigDict(extra="allow")

    kind: Annotated[list[Kind], BeforeValidator(_listed)]

    @model_validator(mode="before")
    @classmethod
    def _text(cls, given: Any) -> Any:
        if not isinstance(given, str):
            return given
        fields_of = asdict(OcclusionProtocol.parse(given))
        return {_KEYS.get(name, name): value for name, value in fields_of.items()}

    @model_validator(mode="after")
    def _known(self) -> "OcclusionEntry":
        known = [_KEYS.get(f.name, f.name) for f in fields(OcclusionProtocol)]
        for name, value in (self.model_extra or {}).items():
            if name not in known:
                raise ValueError(f"unknown key {name}; expected one of: {', '.join(known)}")
            for one in _listed(value):
                if isinstance(one, bool) or not isinstance(one, int):
                    raise ValueError(f"{name}: expected a number of frames, or a list of them")
        return self


class SweepFile(Settings):
    """A sweep's file."""

    scenarios: Annotated[list[ScenarioEntry], Field(min_length=1)]
    filters: Annotated[list[FilterEntry], Field(min_length=1)]
    seeds: _Seeds = SEEDS
    detectors: Annotated[list[_Text], Field(min_length=1)] = Field(default=["pointrcnn"])
    occlusions: Annotated[list[OcclusionEntry], Field(min_length=1)] = Field(
        default=["mid:20"], validate_default=True
    )
    tracker: dict[_Key, _Choices] = Field(default_factory=dict)
    gap_truth: Literal["keep", "ignore"] = "keep"


def read_sweep(path: Path) -> Sweep:
    """The sweep of a YAML file.

    Raises `SweepError`, one line with the file and the key, for a file that says something else
    than it may, and for more than `MAX_RUNS` runs.
    """
    given = read_settings(path, lambda document: SweepFile, SweepError)
    if (runs := _n_runs(given)) > MAX_RUNS:
        raise SweepError(f"{path}: {runs} runs, expected at most {MAX_RUNS}")
    seeds = range(given.seeds) if isinstance(given.seeds, int) else given.seeds
    folder = path.resolve().parent
    try:
        loaded = tuple(one for entry in given.scenarios for one in _scenarios(entry, folder))
        filters = tuple(one for entry in given.filters for one in _filters(entry))
        protocols = tuple(one for entry in given.occlusions for one in _protocols(entry))
        rules = tuple(Rules(one) for one in _crossed(given.tracker))
        detectors = tuple(_beside(name, folder) for name in given.detectors)
        return Sweep(loaded, filters, tuple(seeds), detectors, protocols, rules, given.gap_truth)
    except ValueError as error:
        raise SweepError(f"{path}: {error}") from None


def _n_runs(given: SweepFile) -> int:
    """How many runs a file asks for, before any of them takes memory."""
    crossed_over: Sequence[Iterable[Mapping[str, Any]]] = (
        [entry.parameters for entry in given.scenarios],
        [entry.options for entry in given.filters],
        [{"kind": entry.kind, **(entry.model_extra or {})} for entry in given.occlusions],
        [given.tracker],
    )
    runs = len(given.detectors)
    runs *= given.seeds if isinstance(given.seeds, int) else len(given.seeds)
    for entries in crossed_over:
        runs *= sum(prod(len(_listed(one)) for one in entry.values()) for entry in entries)
    return runs


def _scenarios(entry: ScenarioEntry, folder: Path) -> tuple[Scenario, ...]:
    return crossed(_beside(entry.name, folder), **entry.parameters)


def _beside(name: str, folder: Path) -> str:
    """A name as it is; a file beside the sweep's by its path."""
    path = folder / name
    return str(path) if path.suffix and path.is_file() else name


def _filters(entry: FilterEntry) -> Iterator[Filter]:
    every = [Filter.of(entry.name, **options) for options in _crossed(entry.options)]
    for one in every:
        if entry.called is None:
            yield one
        else:
            # The options that tell crossed ones apart stay with the name.
            rest = one.name.removeprefix(entry.name) if len(every) > 1 else ""
            yield Filter(entry.called + rest, one.estimator)


def _protocols(entry: OcclusionEntry) -> Iterator[OcclusionProtocol]:
    for options in _crossed({"kind": entry.kind, **(entry.model_extra or {})}):
        yield OcclusionProtocol(**{_FIELDS.get(key, key): one for key, one in options.items()})


def _crossed(options: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Every choice of one value for each option."""
    for row in product(*map(_listed, options.values())):
        yield dict(zip(options, row, strict=True))
