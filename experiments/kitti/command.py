"""The command `mdkf kitti`."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from experiments.kitti.answer import Answer, document, errors_frame, results_frame
from experiments.kitti.published import PUBLISHED, VALIDATION, VALIDATION_FRAMES
from experiments.kitti.recordings import (
    Recording,
    detector_folders,
    read_recordings,
    recorded_detections,
    sequences_in,
    simulated_detections,
)
from experiments.kitti.rules import RULES, Rules
from experiments.kitti.run import Plan, run
from experiments.kitti.tables import published_table
from experiments.options import (
    OCCLUSIONS,
    Json,
    Root,
    busy,
    chosen_filters,
    chosen_occlusion,
    progress_of,
)
from experiments.terminal import FULL_WIDTH
from mdkf import DETECTORS, estimator_names
from mdkf.settings import Confirmation, Position
from scenarios.kitti import kitti_root
from sim_bridge import load_profile
from sim_bridge.parquet import write_frame


def kitti(
    root: Root = None,
    detections: Annotated[
        list[Path] | None,
        typer.Option(
            help="Folder of recorded detections, SSSS.txt each; repeatable. By default all in the"
            " root's."
        ),
    ] = None,
    split: Annotated[
        str,
        typer.Option(
            metavar="val|train|all|FILE", help="Sequences; a FILE has one at each line's begin."
        ),
    ] = "val",
    filters: Annotated[
        str, typer.Option(help="Comma-separated names; all filters if not given.")
    ] = ",".join(estimator_names()),
    detector: Annotated[
        str | None,
        typer.Option(
            help=f"Whose tracker settings: {', '.join(DETECTORS)}; by default of the folder's name."
        ),
    ] = None,
    rules: Annotated[
        str,
        typer.Option(
            help="Which rows are written and scored, comma-separated; "
            + "; ".join(f"{each.name}: {each.meaning}" for each in RULES.values())
            + "."
        ),
    ] = "robmot,paper",
    occlusion: Annotated[
        str,
        typer.Option(help=f"Detections to hide, {OCCLUSIONS}; or none."),
    ] = "none",
    position: Annotated[
        Position, typer.Option(help="What a track reports in frames with a detection.")
    ] = "measurement",
    confirmation: Annotated[
        Confirmation, typer.Option(help="Whether a track has rows from before its confirmation.")
    ] = "retrospective",
    simulated: Annotated[
        bool,
        typer.Option(
            "--simulated", help="Compare with the simulated detector on the recorded cars."
        ),
    ] = False,
    seeds: Annotated[int, typer.Option(help="Simulations of every sequence.", min=1)] = 5,
    out: Annotated[
        Path | None,
        typer.Option(
            file_okay=False,
            help="Folder for results.parquet, errors.parquet (around hidden detections) and"
            " tracks/FILTER/data/SSSS.txt; with several folders of detections, DETECTOR/tracks.",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """The filters on recorded KITTI detections, scored by KITTI's own rules."""
    base = root or kitti_root()
    options: dict[str, Any] = {"position": position, "confirmation": confirmation}
    plan = Plan(chosen_filters(filters), _rules(rules), chosen_occlusion(occlusion), options)
    folders = detector_folders(base, detections or (), detector)
    profiles = [load_profile(folder.settings) for folder in folders if simulated]
    with busy("reading the recordings"):
        sequences = sequences_in(base, split)
        recordings = read_recordings(base, sequences)
        found = [recorded_detections(base, folder.path, recordings) for folder in folders]
    published = PUBLISHED if _is_as_published(plan, recordings) else ()
    answers = []
    steps = len(folders) * len(plan.filters) * (1 + seeds * simulated)
    with progress_of(steps, "tracking") as progress:
        for k, folder in enumerate(folders):
            place = out if out is None or len(folders) == 1 else out / folder.name
            real = run(plan, folder, recordings, found[k], place, progress)
            made = []
            for seed in range(seeds) if simulated else ():
                sensed = simulated_detections(profiles[k], recordings, seed)
                made.append(run(plan, folder, recordings, sensed, None, progress))
            answers.append(Answer(plan, folder, real, made, published))
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        write_frame(results_frame(answers), out / "results.parquet")
        errors = errors_frame(answers)
        if not errors.is_empty():
            write_frame(errors, out / "errors.parquet")
    if as_json:
        print(json.dumps(document(answers), allow_nan=False))
        return
    shown = Console() if Console().is_terminal else Console(width=FULL_WIDTH)
    for answer in answers:
        for part in answer.shown(shown.width):
            shown.print(part, highlight=False)
    known = {folder.detector for folder in folders}
    others = [entry for entry in published if entry.detector not in known]
    if others and not detections:
        shown.print(published_table(others), highlight=False)
    if out is not None:
        print(out / "results.parquet")


def _rules(text: str) -> tuple[Rules, ...]:
    names = tuple(dict.fromkeys(name.strip() for name in text.split(",")))
    for name in names:
        if name not in RULES:
            raise typer.BadParameter(
                f"--rules holds {name[:40]!r}, expected some of: {', '.join(RULES)}"
            )
    return tuple(RULES[name] for name in names)


def _is_as_published(plan: Plan, recordings: Sequence[Recording]) -> bool:
    """Whether what others published is of the same recordings and the same rules of a tracker."""
    frames = sum(recording.trace.n_frames for recording in recordings)
    split = {recording.sequence for recording in recordings} == VALIDATION
    reported = plan.options == {"position": "measurement", "confirmation": "retrospective"}
    return split and frames == VALIDATION_FRAMES and reported and plan.occlusion.kind == "none"
