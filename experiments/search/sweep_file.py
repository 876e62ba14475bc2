"""A worst case into a sweep file: exactly the worlds in which it was confirmed."""

from pathlib import Path
from typing import Any

import yaml

import scenarios
from experiments.search.plan import Plan
from experiments.search.space import Point
from sim_bridge import detector_name
from sim_bridge.parquet import replacing


def sweep_document(plan: Plan, point: Point) -> dict[str, Any]:
    """The sweep of a point's fresh seeds, as YAML takes it; files by whole paths, so that they are
    found from wherever it is run."""
    name = plan.space.scenario
    own = name in scenarios.list()
    profile = Path(plan.detector)
    parameters = {**plan.space.fixed, **point}
    document: dict[str, Any] = {
        "scenarios": [
            {"name": name if own else str(Path(name).resolve()), "parameters": parameters}
        ],
        "seeds": list(plan.fresh_seeds),
        "detectors": [str(profile.resolve()) if profile.is_file() else plan.detector],
        "occlusions": [str(plan.occlusion)],
        "filters": list(plan.goal.filters),
        "gap_truth": plan.gap_truth,
    }
    if plan.settings != detector_name(plan.detector):
        document["tracker"] = {"settings": plan.settings}
    return document


def write_sweep(plan: Plan, point: Point, path: Path) -> None:
    """Write it, whole or not at all."""
    text = yaml.safe_dump(sweep_document(plan, point), sort_keys=False, default_flow_style=None)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
