"""The commands `mdkf fit-detector` and `mdkf check-detector`."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

import sim_bridge
from experiments.detectors.compare import Row, compare, distances
from experiments.detectors.figure import figure
from experiments.detectors.fit import fit_profile
from experiments.detectors.profile_file import profile_yaml
from experiments.detectors.recordings import SPLITS, recorded, sequences_of, simulated
from experiments.detectors.sightings import Sightings
from experiments.detectors.tables import comparison_table, distance_line, evidence_table
from experiments.figures import write_figure
from experiments.options import Json, Root, busy
from scenarios.kitti import kitti_root
from sim_bridge import KittiError, Profile
from sim_bridge.parquet import replacing

Seeds = Annotated[int, typer.Option(help="Simulations of every sequence.", min=1)]
Folder = Annotated[
    Path | None, typer.Option(help="Recorded detections; by default the root's of this name.")
]


def fit_detector(
    detections: Annotated[
        Path, typer.Option(help="Folder of recorded detections, SSSS.txt each, in KITTI's format.")
    ],
    root: Root = None,
    name: Annotated[
        str | None, typer.Option(help="The profile's name; the folder's if not given.")
    ] = None,
    split: Annotated[
        str, typer.Option(help="Sequences to fit: train (all but val), val or all.")
    ] = "train",
    seeds: Seeds = 5,
    out: Annotated[Path, typer.Option(help="Folder to write into.", file_okay=False)] = Path(),
    as_json: Json = False,
) -> None:
    """Fit a detector profile to recorded detections, and check it on sequences held out.

    Writes NAME.yaml and NAME.png.
    """
    base, name = root or kitti_root(), name or detections.name
    sequences = _split(base, split)
    with busy(f"reading {len(sequences)} sequences"):
        seen = recorded(base, detections, sequences)
    with busy(f"fitting {name}"):
        profile = _fitted(name, seen, detections.name)
    held_out = _split(base, "val") if split == "train" else sequences
    with busy(f"simulating {len(held_out)} sequences"):
        real, made = _both(base, detections, profile, held_out, seeds)
    rows, apart = compare(real, made), distances(real, made)
    out.mkdir(parents=True, exist_ok=True)
    file, picture = out / f"{name}.yaml", out / f"{name}.png"
    where = "the val sequences, held out" if split == "train" else "the sequences it was fitted to"
    with replacing(file) as temporary:
        made_by = f"A LiDAR car detector, fitted by `mdkf fit-detector` (--split {split})."
        temporary.write_text(profile_yaml(profile, made_by), encoding="utf-8")
    write_figure(figure(f"{name} on {where}", real, made), picture)
    if as_json:
        print(json.dumps({"profile": profile.model_dump(), **_document({name: (rows, apart)})}))
        return
    console = Console()
    console.print(evidence_table(profile))
    console.print(comparison_table(f"{name} on {where}", rows))
    console.print(distance_line(apart))
    console.print(f"{file}\n{picture}", highlight=False)


def check_detector(
    names: Annotated[
        list[str] | None, typer.Argument(help="Profiles; by default all fitted to recordings.")
    ] = None,
    root: Root = None,
    detections: Folder = None,
    split: Annotated[str, typer.Option(help="Sequences: train, val or all.")] = "val",
    seeds: Seeds = 5,
    as_json: Json = False,
) -> None:
    """Compare simulated with recorded detections of the same recorded cars."""
    base = root or kitti_root()
    profiles = [sim_bridge.load_profile(name) for name in names or _fitted_profiles()]
    sequences = _split(base, split)
    results = {}
    for profile in profiles:
        folder = detections or _recorded(base, profile)
        with busy(f"{profile.name}: simulating {len(sequences)} sequences"):
            real, made = _both(base, folder, profile, sequences, seeds)
        results[profile.name] = compare(real, made), distances(real, made)
    if as_json:
        print(json.dumps(_document(results)))
        return
    console = Console()
    for name, (rows, apart) in results.items():
        console.print(comparison_table(f"{name} on the {split} sequences", rows))
        console.print(distance_line(apart))


def _split(root: Path, split: str) -> tuple[str, ...]:
    if split not in SPLITS:
        raise typer.BadParameter(f"--split is {split!r}, expected one of {', '.join(SPLITS)}")
    return sequences_of(root, split)


def _fitted(name: str, seen: Sightings, detections: str) -> Profile:
    try:
        return fit_profile(name, seen, detections)
    except ValueError as error:
        raise KittiError(str(error)) from None


def _fitted_profiles() -> list[str]:
    """Profiles that come with the package and know what recordings they are of."""
    every = [sim_bridge.load_profile(name) for name in sim_bridge.profile_names()]
    return [profile.name for profile in every if "detections" in profile.evidence]


def _recorded(root: Path, profile: Profile) -> Path:
    folder = profile.evidence.get("detections")
    if not isinstance(folder, str):
        raise typer.BadParameter(
            f"profile {profile.name} does not say which recorded detections it is of: give"
            " --detections"
        )
    return root / "detections" / folder


def _both(
    root: Path, folder: Path, profile: Profile, sequences: Sequence[str], seeds: int
) -> tuple[Sightings, Sightings]:
    return recorded(root, folder, sequences), simulated(root, profile, sequences, seeds)


def _document(results: dict[str, tuple[list[Row], dict[str, float]]]) -> dict[str, Any]:
    return {
        "rows": [
            {"detector": name, **{k: None if v != v else v for k, v in asdict(row).items()}}
            for name, (rows, _) in results.items()
            for row in rows
        ],
        "distances": {name: apart for name, (_, apart) in results.items()},
    }
