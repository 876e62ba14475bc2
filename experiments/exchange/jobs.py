"""What is to be exported into jobs, each of which makes one world: of tables, or of scenarios."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from experiments.exchange.worlds import World
from experiments.foreign import told_of
from experiments.occlusion import OcclusionProtocol
from experiments.options import simulated
from mdkf import Detections, TableError, Trace, Tracker, TrackerSettings, Tracks, estimator
from mdkf.settings import tracker_settings
from mdkf.tables import Table
from scenarios import Scenario
from sim_bridge import detect, detector_name

Job = Callable[[], World]
"""Makes a world; `SeedRefused` where its seed gives no valid truth."""


def of_scenarios(
    chosen: Sequence[Scenario],
    seeds: int,
    detector: str,
    occlusion: OcclusionProtocol,
    filters: Sequence[str],
    no_cache: bool,
) -> list[Job]:
    """Every scenario with every seed: simulated, detected, occluded and tracked with each filter.

    Raises `ValueError` for a detector whose tracker settings are not known, if there are filters.
    """
    settings = tracker_settings(detector_name(detector)) if filters else None

    def job(scenario: Scenario, seed: int) -> World:
        trace = simulated(scenario, seed, no_cache)
        found = detect(trace, detector, seed)
        if occlusion.kind != "none":
            found = occlusion.apply(found, trace)
        if settings is None:
            return World(trace, found)
        return World(trace, found, {name: _tracks(name, settings, found) for name in filters})

    return [partial(job, scenario, seed) for scenario in chosen for seed in range(seeds)]


def _tracks(name: str, settings: TrackerSettings, found: Detections) -> Tracks:
    filter = estimator(name)
    with told_of(filter):
        return Tracker(filter, settings).run(found)


def of_tables(named: Sequence[tuple[Path, Table]]) -> list[Job]:
    """Every trace with the detections and tracks of it, which are named as their files are.

    Raises `TableError` for a table that is neither, or whose trace is not there, and for several
    of a trace that would be written to one place.
    """
    traces = {table.content_hash(): table for _, table in named if isinstance(table, Trace)}
    detections: dict[str, Detections] = {}
    tracks: dict[str, dict[str, Tracks]] = {key: {} for key in traces}
    for path, table in named:
        if isinstance(table, Trace):
            continue
        if not isinstance(table, Detections | Tracks):
            raise TableError(
                f"{path}: holds {type(table).__name__}, expected Trace, Detections or Tracks"
            )
        key = table.provenance.get("trace", "")
        if key not in traces:
            name = table.provenance.get("scenario", "no known scenario")
            raise TableError(
                f"{path}: the table is of {name}, whose trace is not given: expected its table too"
            )
        if isinstance(table, Detections):
            if key in detections:
                raise TableError(f"{path}: a second table of detections of one trace, expected one")
            detections[key] = table
        else:
            if path.stem in tracks[key]:
                raise TableError(f"{path}: a second table of tracks {path.stem} of one trace")
            tracks[key][path.stem] = table
    return [partial(World, t, detections.get(key), tracks[key]) for key, t in traces.items()]
