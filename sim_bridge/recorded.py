"""Recorded worlds and detectors behind the names that simulated ones have.

A scenario `kitti-0001` gives the recorded trace; the detector `recorded:NAME` gives what the
detector NAME reported of such a trace. Neither has anything to do with a seed.
"""

from dataclasses import replace
from pathlib import Path

from mdkf.tables import Detections, Trace
from scenarios import KittiScenario, Scenario
from scenarios.kitti import FRAME_TIME, PREFIX, VARIABLE, kitti_scenario
from sim_bridge.kitti import kitti_detections, kitti_trace
from sim_bridge.network_check import SimulationError
from sim_bridge.profile import ProfileError, load_profile

RECORDED = "recorded:"
"""What the name of a recorded detector begins with."""


def recorded_trace(scenario: KittiScenario, seed: int, dt: float) -> Trace:
    """The recorded trace; seed: only noted, so that what is drawn later may depend on it.

    Raises `SimulationError` for a time between frames that is not the recording's.
    """
    if dt != FRAME_TIME:
        raise SimulationError(f"dt is {dt} s, expected {FRAME_TIME} s: {scenario.name} is recorded")
    trace = kitti_trace(scenario.root, scenario.sequence, dt)
    provenance = {**trace.provenance, "parameters": "{}", "seed": str(seed)}
    return replace(trace, ego=replace(trace.ego, provenance=provenance), provenance=provenance)


def is_recorded(detector: str | Path) -> bool:
    """Whether it is the name of a recorded detector."""
    return str(detector).startswith(RECORDED)


def recorded_detections(trace: Trace, detector: str) -> Detections:
    """What the detector `recorded:NAME` reported of a recorded trace.

    Raises `ProfileError` for a trace that was not recorded, or that is not the one in the folder of
    recordings, `KittiError` for an unknown NAME or bad files, `ScenarioError` without recordings.
    """
    source, name = trace.provenance.get("source"), trace.provenance.get("scenario", "")
    if source != "kitti":
        raise _only_for_recordings(detector, name or "this trace", source)
    scenario = kitti_scenario(name)
    found = kitti_detections(
        scenario.root, detector.removeprefix(RECORDED), scenario.sequence, trace.dt
    )
    if found.provenance["trace"] != trace.content_hash():
        raise ProfileError(
            f"detector {detector!r}: the trace is not {name} of {scenario.root} ({VARIABLE})"
        )
    return replace(found, provenance={**trace.provenance, **found.provenance})


def check_detector(detector: str | Path, scenario: Scenario) -> None:
    """Raise `ProfileError` for a detector that cannot detect a scenario, without simulating."""
    if is_recorded(detector) and not isinstance(scenario, KittiScenario):
        raise _only_for_recordings(detector, scenario.name, scenario.source)


def detector_name(detector: str | Path) -> str:
    """The detector's own name, which its tracker settings have too; `ProfileError` as `detect`."""
    if is_recorded(detector):
        return str(detector).removeprefix(RECORDED)
    return load_profile(detector).name


def _only_for_recordings(detector: str | Path, name: str, source: str | None) -> ProfileError:
    return ProfileError(
        f"detector {str(detector)[:60]!r}: {name} has source {source or 'unknown'}, expected a"
        f" recorded scenario ({PREFIX}SSSS)"
    )
