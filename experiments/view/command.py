"""The command `mdkf view`: worlds to be played in space by rerun."""

import json
import os
import shlex
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from experiments.engine import RunFailed
from experiments.options import Json, busy
from experiments.view.scene import Scene, read_files, read_folder, world_folders
from sim_bridge.parquet import replacing

SUFFIX = ".rrd"
"""What the names of rerun's recordings end in."""

PATIENCE = 30.0
"""Longest wait for the viewer to take a recording [s]."""


def view(
    run: Annotated[
        Path,
        typer.Argument(
            metavar="RUN",
            help="An output folder of mdkf run, one of its worlds/SCENARIO-SEED, or a trace's"
            " Parquet file.",
        ),
    ],
    detections: Annotated[
        Path | None, typer.Option(help="With a trace's file: detections of it.")
    ] = None,
    tracks: Annotated[
        list[Path] | None,
        typer.Option(help="With a trace's file: tracks of it; repeatable."),
    ] = None,
    filters: Annotated[
        str | None,
        typer.Option(help="With a folder: comma-separated; all that were run if not given."),
    ] = None,
    focus: Annotated[
        int | None,
        typer.Option(
            "--object",
            help="Whose gap is looked at and plotted; by default the one nearest to the sensor.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Recording to write (.rrd); without it, the viewer opens.", dir_okay=False
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Play worlds in space: truth, detections, tracks, their uncertainty, what is hidden.

    Without --out the viewer opens, or where there is no display each world's recording is written
    beside its tables. Needs rerun: pip install 'mdkf[view]'.
    """
    _require_rerun()
    if out is not None and out.suffix != SUFFIX:
        raise typer.BadParameter(f"--out {out}: expected a name that ends in {SUFFIX}")
    scenes = _scenes(run, detections, tracks or [], filters, out)
    to_viewer = out is None and _has_display()
    rows = []
    for scene in scenes:
        place = None if to_viewer else out or _beside(scene.source)
        with busy(f"recording {scene.name}"):
            rows.append(_record(scene, focus, place))
    if as_json:
        print(json.dumps({"rows": rows}))
        return
    for row in rows:
        print(row["recording"] or f"{row['name']}: in the viewer")
    files = [row["recording"] for row in rows if row["recording"]]
    if files:
        print(f"to open: {shlex.join(['rerun', *files])}", file=sys.stderr)


def _require_rerun() -> None:
    """Bad input where rerun is not installed; mistakes in what it is given become errors."""
    try:
        import rerun
    except ImportError:
        raise typer.BadParameter(
            "mdkf view needs rerun, which is not installed: pip install 'mdkf[view]'"
        ) from None
    rerun.set_strict_mode(True)


def _scenes(
    run: Path,
    detections: Path | None,
    tracks: list[Path],
    filters: str | None,
    out: Path | None,
) -> list[Scene]:
    """What is to be shown, all of it read and checked."""
    if not run.is_dir():
        if filters is not None:
            raise typer.BadParameter(f"--filters: {run} is no folder; name files with --tracks")
        return [read_files(run, detections, tracks)]
    if detections is not None or tracks:
        raise typer.BadParameter(
            f"--detections and --tracks go with a trace's file; {run} is a folder"
        )
    folders = world_folders(run)
    if out is not None and len(folders) > 1:
        known = ", ".join(map(str, folders))
        raise typer.BadParameter(f"--out takes one world; {run} holds {len(folders)}: {known}")
    chosen = None if filters is None else [name.strip() for name in filters.split(",")]
    return [read_folder(folder, chosen) for folder in folders]


def _has_display() -> bool:
    """Whether there is a screen for the viewer's window."""
    shown = "DISPLAY" in os.environ or "WAYLAND_DISPLAY" in os.environ
    return shown or sys.platform in ("darwin", "win32")


def _beside(trace: Path) -> Path:
    """Where the recording of a trace is written by default."""
    return trace.with_suffix(SUFFIX)


def _record(scene: Scene, object_id: int | None, place: Path | None) -> dict[str, Any]:
    """Record a scene into a file, or into the viewer that is there; what was recorded."""
    import rerun

    from experiments.view.recording import record, stream_of

    focus = scene.focus(object_id)
    stream = stream_of(scene)
    if place is None:
        stream.spawn(hide_welcome_screen=True)  # or it takes the viewer that is open already
        record(scene, stream, focus)
        _flush(stream)
    else:
        written = rerun.binary_stream(stream)
        record(scene, stream, focus)
        content = written.read() or b""
        with replacing(place) as temporary:
            temporary.write_bytes(content)
    return {
        "name": scene.name,
        "recording": None if place is None else str(place),
        "frames": scene.trace.n_frames,
        "filters": list(scene.tracks),
        "gaps": len(scene.gaps),
        "object": None if focus is None else focus[0],
    }


def _flush(stream: Any) -> None:
    """Wait until the viewer has everything. Raises `RunFailed` if it does not take it."""
    try:
        stream.flush(timeout_sec=PATIENCE)
    except RuntimeError as error:
        raise RunFailed(f"the viewer does not take the recording: {error}") from None
