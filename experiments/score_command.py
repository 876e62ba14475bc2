"""`mdkf score`: every score of a track table, and its breakdowns, from the files alone."""

import json
from pathlib import Path
from typing import Annotated, Any, get_args

import typer
from rich.console import Console

import sim_bridge
from experiments import terminal
from experiments.bins import GROUPS, check_group
from experiments.exchange.results import read_results
from experiments.matched import Similarity
from experiments.options import GapTruth, Json, chosen_gap_truth
from experiments.scoring import score as score_tracks
from experiments.statistics import told
from mdkf import Trace, Tracks


def score(
    trace: Annotated[Path, typer.Argument(help="A trace's Parquet file.")],
    tracks: Annotated[
        Path,
        typer.Argument(
            help="A track table's Parquet file; or another tracker's results (.txt), KITTI's or"
            " MOTChallenge's, of a world that was exported."
        ),
    ],
    detections: Annotated[
        Path | None,
        typer.Option(help="Of another tracker: the detections it was given, which tell the gaps."),
    ] = None,
    gap_truth: GapTruth = "keep",
    by: Annotated[
        list[str] | None,
        typer.Option(
            metavar="|".join(GROUPS),
            help="Also by bins of these; with commas for their products, as range,level;"
            " repeatable.",
        ),
    ] = None,
    similarity: Annotated[
        str,
        typer.Option(
            help="Of HOTA, CLEAR and Identity: centre distance, or overlap of boxes from above"
            " (bird) or in space (box).",
            metavar="|".join(get_args(Similarity)),
        ),
    ] = "centre",
    as_json: Json = False,
) -> None:
    """Score tracks against the truth; the gaps are read from the tracks' own file.

    What another tracker's file does not tell (velocities, covariances) is not scored.
    """
    rules = {"gap_truth": chosen_gap_truth(gap_truth), "similarity": _similarity(similarity)}
    groups = list(dict.fromkeys(_group(text) for text in by or []))
    truth = sim_bridge.read_table(trace, Trace)
    estimate = _estimate(tracks, truth, detections)
    result = score_tracks(truth, estimate, **rules)
    if as_json:
        document: dict[str, Any] = {name: told(value) for name, value in result.summary().items()}
        if groups:
            document["breakdown"] = result.by(*groups).to_dicts()
        print(json.dumps(document, allow_nan=False))
        return
    shown = Console() if Console().is_terminal else Console(width=terminal.FULL_WIDTH)
    shown.print(terminal.score_table(result))
    binned = result.by(*groups)
    for group in groups:
        wide = shown.width >= terminal.BREAKDOWN_WIDTH
        shown.print(terminal.breakdown_table(binned, group, wide))
    shown.print(terminal.CORRELATED, style="dim", highlight=False)


def _estimate(path: Path, truth: Trace, detections: Path | None) -> Tracks:
    """A table of tracks, or what another tracker's results tell of them."""
    if path.suffix.lower() == ".txt":
        return read_results(path, truth, detections)
    if detections is not None:
        raise typer.BadParameter("--detections is for another tracker's results (.txt)")
    return sim_bridge.read_table(path, Tracks)


def _similarity(text: str) -> Any:
    if text not in get_args(Similarity):
        known = ", ".join(get_args(Similarity))
        raise typer.BadParameter(f"similarity {text!r}, expected one of {known}")
    return text


def _group(text: str) -> str:
    group = text.replace(" ", "")
    try:
        check_group(group)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None
    return group
