"""The command `mdkf search`: where does a filter lose most, or fail?"""

import json
import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

import sim_bridge
from experiments.engine import RunFailed
from experiments.options import (
    Detector,
    GapTruth,
    Json,
    Occlusion,
    Setting,
    Settings,
    Workers,
    chosen_filters,
    chosen_gap_truth,
    chosen_occlusion,
    chosen_parameters,
    chosen_settings,
    counting,
)
from experiments.search.goal import GOALS, LOSS, UNITS, Goal
from experiments.search.plan import CHECK_SEEDS, SEEDS, TRIALS, Plan
from experiments.search.report import write_results
from experiments.search.run import search as run_search
from experiments.search.space import space_of
from experiments.search.tables import check_rows, check_table, headline, told_missing, trial_rows

OUT = Path("mdkf-search")
WIDTH = 170
"""Characters that the table gets where there is no terminal."""


def search(
    filter: Annotated[str, typer.Option(help="The filter whose worst cases are sought.")],
    scenario: Annotated[
        str, typer.Option(help="A scenario's name, YAML file or SUMO configuration (.sumocfg).")
    ],
    against: Annotated[
        str | None, typer.Option(help="The filter that it is compared with.")
    ] = None,
    goal: Annotated[
        str,
        typer.Option(
            metavar="|".join(GOALS),
            help="What is sought: a loss against the other filter by --metric, or failures: lost"
            " tracks, identity switches, NEES far from 2; these more than at the scenario's"
            " defaults, or, with --against, more than the other filter's.",
        ),
    ] = LOSS,
    metric: Annotated[str, typer.Option(help=f"Of a loss: {', '.join(UNITS)}.")] = "drift",
    bounds: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=LOW:HIGH",
            help="A parameter to search; repeatable. By default all that are not fixed, within"
            " their declared bounds.",
        ),
    ] = None,
    fixed: Setting = None,
    trials: Annotated[int, typer.Option(help="Points that are tried.", min=1)] = TRIALS,
    seeds: Annotated[
        int, typer.Option(help="Seeds of each trial, from 0, the same for all.", min=1)
    ] = SEEDS,
    check_seeds: Annotated[
        int, typer.Option(help="Fresh seeds on which the worst are checked.", min=2)
    ] = CHECK_SEEDS,
    occlusion: Occlusion = "mid:20",
    detector: Detector = "pointrcnn",
    settings: Settings = None,
    gap_truth: GapTruth = "keep",
    sampler_seed: Annotated[
        int, typer.Option("--seed", help="Seed of the optimiser.", min=0, max=2**32 - 1)
    ] = 0,
    out: Annotated[
        Path, typer.Option(help="Folder for results and report; a second run goes on in it.")
    ] = OUT,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Look for a scenario's parameters at which a filter loses most, or fails, and check the worst
    on fresh seeds: a table, a report, and a sweep file for each that is confirmed."""
    plan = Plan(
        goal=_goal(goal, metric, filter, against),
        space=space_of(scenario, chosen_parameters(fixed), _bounds(bounds)),
        occlusion=chosen_occlusion(occlusion),
        detector=detector,
        settings=chosen_settings(settings or sim_bridge.detector_name(detector)),
        gap_truth=chosen_gap_truth(gap_truth),
        trials=trials,
        seeds=seeds,
        check_seeds=check_seeds,
        sampler_seed=sampler_seed,
    )
    with counting("worlds") as progress:
        found = run_search(plan, out, workers, progress)
    page = write_results(found, out, shlex.join(["mdkf", *sys.argv[1:]]))
    for line in told_missing(found):
        Console(stderr=True).print(line, style="yellow", highlight=False, markup=False)
    if as_json:
        confirmed = found.checks.confirmed if found.checks else ()
        document = {
            "headline": headline(found),
            "confirmed": [one.name for one in confirmed],
            "checks": check_rows(found).to_dicts(),
            "trials": trial_rows(found).to_dicts(),
            "refused": found.refused,
            "failed": found.failed,
            "report": str(page),
        }
        print(json.dumps(document, allow_nan=False))
    else:
        shown = Console() if Console().is_terminal else Console(width=WIDTH)
        shown.print(headline(found), style="bold", highlight=False, markup=False)
        if found.checks or found.proposed:
            shown.print(check_table(found), highlight=False)
        print(f"report: {page}")
    if found.interrupted:
        raise KeyboardInterrupt
    if found.failure is not None:
        raise RunFailed(found.failure)


def _goal(goal: str, metric: str, filter: str, against: str | None) -> Goal:
    """What is sought, of known filters and by a known metric."""
    if goal not in GOALS:
        raise typer.BadParameter(f"goal {goal!r}, expected one of: {', '.join(GOALS)}")
    if goal == LOSS and against is None:
        raise typer.BadParameter("a loss is against another filter: give --against NAME")
    if metric not in UNITS:
        raise typer.BadParameter(f"metric {metric!r}, expected one of: {', '.join(UNITS)}")
    if goal != LOSS:
        metric = goal
    for name in (filter, against):
        if name is not None and chosen_filters(name) != (name,):
            raise typer.BadParameter(f"filter {name!r}, expected one name")
    return Goal(metric, filter, against)


def _bounds(given: list[str] | None) -> dict[str, tuple[float, float]]:
    """Bounds by parameter from NAME=LOW:HIGH."""
    found = {}
    for text in given or []:
        name, equals, ends = text.partition("=")
        low, colon, high = ends.partition(":")
        try:
            if not (equals and colon):
                raise ValueError
            found[name] = (float(low), float(high))
        except ValueError:
            raise typer.BadParameter(f"{text!r}, expected NAME=LOW:HIGH") from None
    return found
