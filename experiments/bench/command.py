"""The command `mdkf bench`: what things cost, as ratios within one run."""

import difflib
import json
import platform
from dataclasses import asdict, replace
from importlib.metadata import version
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from experiments.bench.parts import PARTS, run
from experiments.bench.plan import QUICK, Plan
from experiments.bench.tables import tables
from experiments.bench.targets import PAPER_RATIOS, Target, targets
from experiments.options import Json

WIDTH = 120
"""Characters that the tables need: they get them where there is no terminal."""


def bench(
    only: Annotated[
        str | None,
        typer.Option(help=f"Comma-separated parts; all if not given: {', '.join(PARTS)}."),
    ] = None,
    rounds: Annotated[
        int | None,
        typer.Option(
            help=f"Interleaved rounds; {Plan.rounds} if not given, {QUICK.rounds} with --quick.",
            min=1,
        ),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Short measurements in few rounds: a first look.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Measure what filters, tracker, scoring, sensing and simulation cost, as ratios in one run.

    CPU time of one thread, all cases interleaved; medians over rounds with
    their 10th and 90th percentiles; ratios are formed within each round.

    In the JSON document, `ratio` says how many times as fast a row is as
    `ratio_to`; where `what` ends in -ratio, `name` is A/B, and `median` and
    `ratio` are the cost of A over that of B.

    Targets are shown beside; they do not decide the exit status.
    """
    names = _parts(only)
    plan = QUICK if quick else Plan()
    if rounds is not None:
        plan = replace(plan, rounds=rounds, processes=min(rounds, plan.processes))
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    # A bar that refreshes itself would do so in a thread, on the clock.
    bars = Progress(*columns, console=console, disable=not console.is_terminal, auto_refresh=False)
    with bars:
        tasks = {name: bars.add_task(name, total=1.0) for name in names}

        def show(name: str, done: float) -> None:
            bars.update(tasks[name], completed=done)
            bars.refresh()

        results = run(plan, names, show)
    rows, reached = results.rows(), targets(results)
    setting = _setting(plan)
    if as_json:
        document = {
            "rows": [asdict(row) for row in rows],
            "targets": [_document(target) for target in reached],
            "paper": PAPER_RATIOS,
            "setting": setting,
        }
        print(json.dumps(document, allow_nan=False))
        return
    shown = Console() if Console().is_terminal else Console(width=WIDTH)
    shown.print(
        f"CPU time of one thread, {plan.rounds} interleaved rounds; medians ± half of the range"
        " from the 10th to the 90th percentile; ratios are formed within rounds.",
        highlight=False,
    )
    shown.print(escape(", ".join(f"{k} {v}" for k, v in setting.items())), highlight=False)
    for table in tables(rows, reached):
        shown.print(table, highlight=False)


def _parts(text: str | None) -> list[str]:
    """Parts by name, each once, in their own order; all if there is no text."""
    given = list(PARTS) if text is None else [name.strip() for name in text.split(",")]
    for name in given:
        if name not in PARTS:
            close = difflib.get_close_matches(name, PARTS, n=1)
            hint = f" (did you mean {close[0]!r}?)" if close else ""
            raise typer.BadParameter(
                f"unknown part {name!r}{hint}; known parts: {', '.join(PARTS)}"
            )
    return [name for name in PARTS if name in given]


def _setting(plan: Plan) -> dict[str, str | int]:
    """What the numbers were measured with."""
    packages = {name: version(name) for name in ("mdkf", "numpy", "numba", "filterpy")}
    python = platform.python_version()
    return {**packages, "python": python, "machine": platform.machine(), "rounds": plan.rounds}


def _document(target: Target) -> dict[str, Any]:
    return {**asdict(target), "met": target.met, "clear": target.clear}
