"""The command `mdkf scenarios`: the catalogue, or one scenario described and drawn."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

import scenarios
import sim_bridge
from experiments import terminal
from experiments.figures import write_figure
from experiments.options import Json, NoCache, busy, simulated
from experiments.worlds.describe import Description, describe
from experiments.worlds.figure import catalogue_figure, world_figure
from mdkf import Trace

DRAWN = ("sumo", "highway-env", "closed-form", "kitti")
"""Sources in the order of the catalogue's picture; recordings are left out."""
SEEDS = 5
"""Tried for a world of the catalogue's picture."""


def list_scenarios(
    name: Annotated[
        str | None,
        typer.Argument(
            help="A scenario's name, YAML file, SUMO configuration or CommonRoad file, to describe."
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the world that is described.", min=0)] = 0,
    picture: Annotated[
        Path | None, typer.Option(help="PNG file to draw it into, or all of them.", dir_okay=False)
    ] = None,
    no_cache: NoCache = False,
    as_json: Json = False,
) -> None:
    """List the scenarios, or describe one: parameters, objects, regimes, natural occlusions."""
    if name is None:
        catalogue = tuple(scenarios.load(known) for known in scenarios.list())
        if as_json:
            print(json.dumps({"rows": [_row(scenario) for scenario in catalogue]}))
        else:
            Console().print(terminal.scenario_table(catalogue))
        if picture is not None:
            drawn = sorted(catalogue, key=lambda scenario: DRAWN.index(scenario.source))
            own = [scenario for scenario in drawn if scenario.source != "kitti"]
            write_figure(catalogue_figure(list(_worlds(own, seed, no_cache))), picture)
        return
    scenario = scenarios.load(name)
    with busy(f"simulating {scenario.name}"):
        trace = simulated(scenario, seed, no_cache)
    told = describe(trace)
    if picture is not None:
        write_figure(world_figure(scenario, trace), picture)
    if as_json:
        print(
            json.dumps({"rows": [{**_row(scenario), "seed": seed, **asdict(told), **_own(trace)}]})
        )
        return
    console = Console()
    console.print(terminal.parameter_table(scenario))
    console.print(_table(told, trace.provenance))
    if picture is not None:
        print(picture)


def _worlds(
    catalogue: Sequence[scenarios.Scenario], seed: int, no_cache: bool
) -> Iterator[tuple[scenarios.Scenario, Trace]]:
    """A world of each scenario, of the first seed from `seed` on that is not refused."""
    for scenario in catalogue:
        with busy(f"simulating {scenario.name}"):
            for own in range(seed, seed + SEEDS):
                try:
                    yield scenario, simulated(scenario, own, no_cache)
                    break
                except sim_bridge.SeedRefused:
                    continue


def _row(scenario: scenarios.Scenario) -> dict[str, Any]:
    return {
        "name": scenario.name,
        "source": scenario.source,
        "purpose": scenario.purpose,
        "duration": scenario.duration,
        "parameters": [asdict(spec) for spec in scenario.parameter_specs],
    }


def _own(trace: Trace) -> dict[str, Any]:
    """What only the trace of a user's own SUMO configuration or CommonRoad file tells."""
    told = trace.provenance
    return {"ego": told["ego"], "left_out": int(told["left_out"])} if "ego" in told else {}


def _table(told: Description, provenance: Mapping[str, str]) -> Table:
    table = Table(
        title=f"seed {provenance['seed']}, within 60 m of the sensor",
        title_justify="left",
        show_header=False,
    )
    objects = ", ".join(f"{count} {kind}" for kind, count in told.objects.items()) or "none"
    standing = "" if told.standing is None else f"; {told.standing} never move"
    regimes = [f"{share:.0%} {name.replace('_', ' ')}" for name, share in told.regimes.items()]
    hidden = [f"{count} of {length}" for length, count in told.occlusions.items() if count]
    for key, value in (
        ("objects", objects + standing),
        ("regimes, of the frames seen", ", ".join(regimes) or "none"),
        ("turning", "–" if told.turning is None else f"{told.turning:.0%}"),
        ("occlusions, by frames", ", ".join(hidden) or "none"),
    ):
        table.add_row(escape(key), escape(value))
    if "ego" in provenance:
        table.add_row("sensor", escape(f"on vehicle {provenance['ego']}"))
        table.add_row("left out", f"{provenance['left_out']}: they drive through others")
    return table
