"""The `mdkf` command: every step of the flow, from file to file, and the main job.

Exit status 0 done, 1 the work failed, 2 bad input, 130 interrupted; errors are one line.
"""

import errno
import json
import shlex
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, NoReturn

import typer
from rich.console import Console
from typer.exceptions import TyperException

import mdkf
import scenarios
import sim_bridge
from experiments import run as runs
from experiments import terminal
from experiments.engine import RunFailed
from experiments.foreign import told_of
from experiments.options import (
    Detector,
    GapTruth,
    Json,
    NoCache,
    Occlusion,
    Setting,
    Settings,
    Workers,
    busy,
    chosen_filters,
    chosen_gap_truth,
    chosen_occlusion,
    chosen_parameters,
    chosen_rules,
    chosen_settings,
    counting,
    simulated,
)
from experiments.sources import VERSIONS
from experiments.sweeps.sweep import SweepError
from mdkf import Detections, TableError, Trace, Tracker, TrackerSettings, Tracks

COMMANDS = {
    "run": ("command_line:run", "bus_stop --seeds 20 --occlusion mid:20 --out out"),
    "simulate": ("command_line:simulate", "bus_stop --seed 7 --set speed=11 --out trace.parquet"),
    "detect": ("command_line:detect", "trace.parquet --occlusion mid:20 --out seen.parquet"),
    "track": ("command_line:track", "seen.parquet --filter md --set gate=3 --out tracks.parquet"),
    "score": ("score_command:score", "trace.parquet tracks.parquet --by phase --by range,level"),
    "scenarios": ("worlds.command:list_scenarios", "bus_stop --picture bus_stop.png"),
    "cache": ("worlds.cache_command:show_cache", "--clear"),
    "fit-detector": (
        "detectors.command:fit_detector",
        "--root KITTI --detections KITTI/detections/pointrcnn",
    ),
    "check-detector": ("detectors.command:check_detector", "pointrcnn --root KITTI --split val"),
    "kitti": ("kitti.command:kitti", "--root KITTI --filters ca,md --out out"),
    "export": ("exchange.command:export", "stop_and_go --seeds 3 --format kitti --out worlds"),
    "import": (
        "exchange.command:import_results",
        "0000.txt --trace worlds/worlds/0000/trace.parquet --out tracks.parquet",
    ),
    "paper": ("paper.command:paper", "regimes --scale full --out out"),
    "sweep": ("sweeps.command:sweep", "lengths.yaml --out out --workers 2"),
    "search": (
        "search.command:search",
        "--filter md --against imm --scenario stop_and_go --out worst",
    ),
    "view": ("view.command:view", "out/worlds/bus_stop-0 --out bus_stop.rrd"),
    "bench": ("bench.command:bench", "--only filter,tracker --json"),
}
"""Where each command is, and what follows it in an example."""

BAD_INPUT = (
    scenarios.ScenarioError,
    sim_bridge.SimulationError,
    sim_bridge.ProfileError,
    sim_bridge.KittiError,
    SweepError,
    TableError,
)
INTERRUPTED = 130
DEFAULT_SEEDS = 6
OUT = Path("mdkf-out")

Seed = Annotated[int, typer.Option(help="Seed of the random numbers.", min=0)]
OutFile = Annotated[Path, typer.Option("--out", help="Parquet file to write.", dir_okay=False)]


def main() -> NoReturn:
    """Run the command line; turns bad input into one line and an exit status."""
    asked = sys.argv[1] if len(sys.argv) > 1 else ""
    try:
        # Typer returns the status of an exit that it was asked for, 130 after Ctrl-C included.
        status = application(asked)(standalone_mode=False)
    except TyperException as error:
        _fail(error.format_message(), 2)
    except BAD_INPUT as error:
        _fail(str(error), 2)
    except RunFailed as error:
        _fail(str(error), 1)
    except OSError as error:
        full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EIO)
        _fail(f"{error.filename or 'file'}: {error.strerror or error}", 1 if full else 2)
    except KeyboardInterrupt:
        status = INTERRUPTED
    if status == INTERRUPTED:
        _fail("interrupted", INTERRUPTED)
    sys.exit(status or 0)


def application(asked: str = "") -> typer.Typer:
    """The command line with the command that is asked for, or with all of them if that is none:
    nobody waits for what other commands import."""
    app = typer.Typer(
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode="rich",
        help="Which filter survives this occlusion, and how sure are we? Simulated traffic with"
        " exact truth, LiDAR-like detections, CA / IMM / MD filters, scores.",
    )
    app.callback(invoke_without_command=True)(_mdkf)
    for name in [asked] if asked in COMMANDS else COMMANDS:
        place, example = COMMANDS[name]
        module, _, function = place.partition(":")
        command = getattr(import_module(f"experiments.{module}"), function)
        app.command(name=name, epilog=f"Example: mdkf {name} {example}")(command)
    return app


def _mdkf(
    context: typer.Context,
    show_version: Annotated[
        bool, typer.Option("--version", help="Print versions and exit.", is_eager=True)
    ] = False,
) -> None:
    if show_version:
        for package in ("mdkf", *VERSIONS):
            print(package, version(package))
    elif context.invoked_subcommand is None:
        print(context.get_help())


def run(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[SCENARIO]...",
            help="Names, YAML files, SUMO configurations (.sumocfg) or CommonRoad files (.xml);"
            f" {' and '.join(runs.SCENARIOS)} if none is given.",
        ),
    ] = None,
    seeds: Annotated[int, typer.Option(help="How many seeds, from 0.", min=1)] = DEFAULT_SEEDS,
    filters: Annotated[
        str,
        typer.Option(
            help=f"Comma-separated; known: {', '.join(mdkf.estimator_names())};"
            " or a built-in NAME-retuned."
        ),
    ] = ",".join(runs.FILTERS),
    occlusion: Occlusion = "mid:20",
    detector: Detector = "pointrcnn",
    settings: Settings = None,
    gap_truth: GapTruth = "keep",
    out: Annotated[Path, typer.Option(help="Folder for results and report.")] = OUT,
    workers: Workers = None,
    no_cache: NoCache = False,
    as_json: Json = False,
) -> None:
    """Simulate, detect, occlude, track with each filter, score: a table and a report."""
    plan = runs.Plan(
        scenarios=_scenarios(names or list(runs.SCENARIOS)),
        seeds=tuple(range(seeds)),
        filters=chosen_filters(filters),
        detector=detector,
        settings=chosen_settings(settings or sim_bridge.detector_name(detector)),
        occlusion=chosen_occlusion(occlusion),
        gap_truth=chosen_gap_truth(gap_truth),
        cache=None if no_cache else sim_bridge.user_cache(),
    )
    with _made(out), counting("worlds") as progress:
        of = len(plan.worlds(out))
        progress(0, of)
        results = runs.run(plan, out, workers, lambda done: progress(done, of))
    console = Console(stderr=True)
    for reason in results.refused:
        console.print(f"refused: {reason}", style="yellow", highlight=False, markup=False)
    # Workers import this module too, and draw nothing: they do not wait for matplotlib.
    from experiments.report import write_report

    page = write_report(plan, results, out, shlex.join(["mdkf", *sys.argv[1:]]))
    if as_json:
        document = {
            "rows": results.table.to_dicts(),
            "differences": results.differences.to_dicts(),
            "refused": list(results.refused),
            "report": str(page),
        }
        print(json.dumps(document, allow_nan=False))
    else:
        shown = Console() if Console().is_terminal else Console(width=terminal.FULL_WIDTH)
        wide = shown.width >= terminal.FULL_WIDTH
        shown.print(terminal.results_table(results.table, intervals=wide))
        if not results.differences.is_empty():
            shown.print(terminal.difference_table(results.differences, wide))
        print(f"report: {page}")
    if results.interrupted:
        raise KeyboardInterrupt
    if results.failure is not None:
        raise RunFailed(results.failure)


def simulate(
    name: Annotated[
        str,
        typer.Argument(
            help="A scenario's name, YAML file, SUMO configuration (.sumocfg) or CommonRoad file"
            " (.xml)."
        ),
    ],
    out: OutFile,
    seed: Seed = 0,
    parameters: Setting = None,
    dt: Annotated[float, typer.Option(help="Time between frames in seconds.")] = sim_bridge.DT,
    no_cache: NoCache = False,
) -> None:
    """Simulate a scenario: exact truth of every object in every frame."""
    with busy(f"simulating {name}"):
        trace = simulated(scenarios.load(name, **chosen_parameters(parameters)), seed, no_cache, dt)
    _write(trace, out)


def detect(
    trace: Annotated[Path, typer.Argument(help="A trace's Parquet file.")],
    out: OutFile,
    detector: Detector = "pointrcnn",
    seed: Seed = 0,
    occlusion: Occlusion = "none",
) -> None:
    """Detect a trace's objects; optionally hide some by the occlusion protocol."""
    protocol = chosen_occlusion(occlusion)
    truth = sim_bridge.read_table(trace, Trace)
    detections = sim_bridge.detect(truth, detector, seed)
    _write(detections if protocol.kind == "none" else protocol.apply(detections, truth), out)


def track(
    detections: Annotated[Path, typer.Argument(help="A detection table's Parquet file.")],
    out: OutFile,
    name: Annotated[
        str,
        typer.Option(
            "--filter",
            help=f"One of: {', '.join(mdkf.estimator_names())}; or a built-in NAME-retuned.",
        ),
    ] = "md",
    settings: Settings = None,
    rules: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME=VALUE",
            help=f"A rule of the tracker ({', '.join(f.name for f in fields(TrackerSettings))});"
            " repeatable.",
        ),
    ] = None,
) -> None:
    """Track detections with one filter."""
    try:
        chosen = mdkf.estimator(name)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None
    table = sim_bridge.read_table(detections, Detections)
    base = chosen_settings(settings or table.provenance.get("detector", "pointrcnn"))
    tracker = Tracker(chosen, chosen_rules(base, rules or []))
    with told_of(chosen):
        tracks = tracker.run(table)
    _write(tracks, out)


def _scenarios(names: list[str] | None) -> tuple[scenarios.Scenario, ...]:
    chosen = tuple(scenarios.load(name) for name in names or scenarios.list())
    known = [scenario.name for scenario in chosen]
    if len(set(known)) < len(known):
        raise typer.BadParameter(f"a scenario is named twice: {', '.join(known)}")
    return chosen


@contextmanager
def _made(folder: Path) -> Iterator[None]:
    """The folder is there; what was made for it goes again if the block meets bad input."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    try:
        yield
    except BAD_INPUT:
        if missing:
            shutil.rmtree(missing[-1], ignore_errors=True)
        raise


def _write(table: Trace | Detections | Tracks, out: Path) -> None:
    sim_bridge.write_table(table, out)
    print(f"{out}: {table!r}", file=sys.stderr)


def _fail(message: str, status: int) -> NoReturn:
    print(f"mdkf: {' '.join(message.split())}", file=sys.stderr)
    sys.exit(status)
