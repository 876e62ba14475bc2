"""What several commands share: options and what they mean, a spinner, and simulated worlds."""

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

import mdkf
import sim_bridge
from experiments.occlusion import OcclusionProtocol
from mdkf import Trace
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

GapTruth = Annotated[
    str, typer.Option(help="Truth in the gaps: keep (it counts) or ignore.", metavar="keep|ignore")
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


def chosen_occlusion(text: str) -> OcclusionProtocol:
    """The occlusion protocol KIND:LENGTH[:WARMUP]; refuses what is none."""
    try:
        return OcclusionProtocol.parse(text)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None


def simulated(scenario: Scenario, seed: int, no_cache: bool, dt: float = 0.1) -> Trace:
    """A world, from the user's cache if it is there and may be."""
    cache = None if no_cache else sim_bridge.user_cache()
    make = sim_bridge.simulate if cache is None else cache.simulate
    return make(scenario, seed, dt)


def busy(what: str) -> Any:
    """A context in which a terminal shows that something is being done."""
    console = Console(stderr=True)
    return console.status(what) if console.is_terminal else nullcontext()
