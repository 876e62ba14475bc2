"""What several commands share: options and what they mean, a spinner and a bar, and simulated
worlds."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import TypeAdapter, ValidationError
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

import mdkf
import sim_bridge
from experiments.occlusion import FORM, OcclusionProtocol
from mdkf import DETECTORS, Trace, TrackerSettings
from mdkf.settings import FOLDERS
from scenarios import Scenario

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document instead of tables.")]

Root = Annotated[
    Path | None,
    typer.Option(
        help="KITTI's tracking data: label_02, calib, pose, detections. By default where the"
        " environment variable MDKF_KITTI says."
    ),
]

NoCache = Annotated[
    bool, typer.Option("--no-cache", help="Simulate anew, and keep nothing for the next time.")
]

Workers = Annotated[
    int | None,
    typer.Option(help="Processes, all cores if not given; 1 works in this one.", min=1),
]

GapTruth = Annotated[
    str, typer.Option(help="Truth in the gaps: keep (it counts) or ignore.", metavar="keep|ignore")
]

OCCLUSIONS = f"{FORM} in frames: mid:20, late:10:35, switch:20:start=-5, natural:20"
"""What an occlusion protocol may be."""

Setting = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="A parameter of the scenario; repeatable."),
]
Occlusion = Annotated[
    str,
    typer.Option(help=f"{OCCLUSIONS}; or none."),
]
Detector = Annotated[
    str,
    typer.Option(
        help="A detector profile's name, or its YAML file (then give --settings); or"
        " recorded:NAME, for recorded scenarios."
    ),
]
Settings = Annotated[
    str | None,
    typer.Option(help=f"Tracker settings ({', '.join(DETECTORS)}); the detector's by default."),
]


def chosen_gap_truth(text: str) -> Any:
    """What `GapTruth` was given; bad input if it is neither."""
    if text not in ("keep", "ignore"):
        raise typer.BadParameter(f"gap truth {text!r}, expected keep or ignore")
    return text


def chosen_filters(text: str) -> tuple[str, ...]:
    """Names of filters from a comma-separated list, each once; refuses what is none."""
    names = tuple(dict.fromkeys(name.strip() for name in text.split(",")))
    for name in names:
        try:
            mdkf.estimator(name)
        except ValueError as error:
            raise typer.BadParameter(str(error)) from None
    return names


def chosen_settings(name: str) -> str:
    """The name of a tracker's settings: as the user chose, or the detector's own."""
    name = FOLDERS.get(name, name)
    if name not in DETECTORS:
        known = ", ".join(DETECTORS)
        raise typer.BadParameter(
            f"no tracker settings for {name!r}; choose with --settings one of: {known}"
        )
    return name


def chosen_rules(name: str, given: Sequence[str]) -> TrackerSettings:
    """A detector's tracker settings, some of them replaced by NAME=VALUE; refuses what is none."""
    rules = asdict(DETECTORS[name])
    for text in given:
        rule, separator, value = text.partition("=")
        if rule not in rules or not separator:
            known = ", ".join(rules)
            raise typer.BadParameter(f"{text!r}, expected NAME=VALUE with one of: {known}")
        rules[rule] = None if value == "none" else value
    try:
        return TypeAdapter(TrackerSettings).validate_python(rules)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"][:1]))
        told = first["msg"].removeprefix("Value error, ")
        raise typer.BadParameter(f"{where}: {told}" if where else told) from None


def chosen_parameters(given: Sequence[str] | None) -> Mapping[str, float]:
    """A scenario's parameters from NAME=VALUE; refuses what is none."""
    parsed: dict[str, float] = {}
    for text in given or ():
        name, separator, value = text.partition("=")
        try:
            if not separator:
                raise ValueError
            parsed[name] = float(value)
        except ValueError:
            raise typer.BadParameter(f"{text!r}, expected NAME=NUMBER") from None
    return parsed


def chosen_occlusion(text: str) -> OcclusionProtocol:
    """The occlusion protocol of a text; refuses what is none."""
    try:
        return OcclusionProtocol.parse(text)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None


def simulated(scenario: Scenario, seed: int, no_cache: bool, dt: float = sim_bridge.DT) -> Trace:
    """A world, from the user's cache if it is there and may be."""
    cache = None if no_cache else sim_bridge.user_cache()
    make = sim_bridge.simulate if cache is None else cache.simulate
    return make(scenario, seed, dt)


def busy(what: str) -> Any:
    """A context in which a terminal shows that something is being done."""
    console = Console(stderr=True)
    return console.status(what) if console.is_terminal else nullcontext()


def progress_bar(console: Console) -> Progress:
    """What is done, a bar, how many of how many, and the time that it took; on a terminal."""
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn())
    return Progress(*columns, TimeElapsedColumn(), console=console, disable=not console.is_terminal)


@contextmanager
def progress_of(total: int, begin: str) -> Iterator[Callable[[str], None]]:
    """A bar moved on by telling what was done last."""
    with progress_bar(Console(stderr=True)) as bar:
        task = bar.add_task(begin, total=total)
        yield lambda done: bar.update(task, advance=1, description=done)


@contextmanager
def counting(what: str) -> Iterator[Callable[[int, int], None]]:
    """A bar moved on by telling how many are done, of how many."""
    with progress_bar(Console(stderr=True)) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, of: bar.update(task, completed=done, total=of)
