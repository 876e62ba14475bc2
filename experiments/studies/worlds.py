"""Simulated traffic into rows of scores: every scenario in which a simulator drives, with each
detector and occlusion that an item asks for."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any

import polars as pl

import scenarios
import sim_bridge
from experiments.bins import EVERYTHING
from experiments.drift import drift
from experiments.jobs import ROWS, as_rows
from experiments.occlusion import Gaps, OcclusionProtocol
from experiments.score import score
from experiments.studies.scale import Scale
from mdkf import DETECTORS, Detections, Estimator, Trace, Tracker, estimator
from mdkf.tables import REGIMES

STUDY = "worlds"

ORDER_2 = ("ca", "imm", "imm-zero", "md")
ORDER_3 = ("cj", "imm3", "imm3-zero", "md3")
FILTERS = (*ORDER_2, *ORDER_3)
RETUNED = tuple(f"{name}-retuned" for name in FILTERS)

PROFILES = {"casa-waymo": "casa"}
"""Detectors whose simulated boxes are another profile's: the tracker's settings differ alone."""


@dataclass(frozen=True)
class Setting:
    """What a world is tracked with. detector: name of the tracker's settings. occlusion: as
    `OcclusionProtocol.parse` takes it. groups: of `experiments.breakdown`."""

    detector: str
    occlusion: str = "none"
    filters: tuple[str, ...] = FILTERS
    groups: tuple[str, ...] = ()


@dataclass(frozen=True)
class World:
    """One seed of a scenario, simulated, detected and occluded once, tracked by every filter."""

    scenario: str
    seed: int
    setting: Setting

    @property
    def group(self) -> str:
        """All settings of one seed share its simulation."""
        return group(self.scenario, self.seed)

    def key(self) -> Mapping[str, Any]:
        """All that decides the rows."""
        own = self.setting
        return {
            "study": STUDY,
            "scenario": identity(self.scenario),
            "seed": self.seed,
            "detector": own.detector,
            "occlusion": own.occlusion,
            "filters": own.filters,
            "groups": own.groups,
        }

    def rows(self) -> pl.DataFrame:
        """The scores of `experiments.score` by name, `drift` [m], and the scores by bin; none if
        the seed was refused. `drift` by bin: regime, as the gap begins, and second of the gap."""
        try:
            trace = simulated(self.scenario, self.seed)
        except sim_bridge.SeedRefused:
            return pl.DataFrame(schema=ROWS)
        profile = PROFILES.get(self.setting.detector, self.setting.detector)
        protocol = OcclusionProtocol.parse(self.setting.occlusion)
        occluded = protocol.apply(detected(self.scenario, self.seed, profile))
        measured = [
            {"filter": name, **one}
            for name in self.setting.filters
            for one in self._scores(name, trace, occluded, protocol)
        ]
        return as_rows(
            measured,
            study=STUDY,
            scenario=self.scenario,
            seed=self.seed,
            detector=self.setting.detector,
            occlusion=self.setting.occlusion,
        )

    def _scores(
        self, name: str, trace: Trace, occluded: Detections, protocol: OcclusionProtocol
    ) -> list[dict[str, Any]]:
        """bin, metric, value and what is behind it, of one filter."""
        settings = DETECTORS[self.setting.detector]
        tracks = Tracker(_filter(name), settings).run(occluded)
        scores = score(trace, tracks, protocol)
        whole = {**scores.summary(), "assre": 100 * scores.hota.assre_mean}
        found = [_row("all", *one, len(trace)) for one in whole.items()]
        for one in scores.by(*self.setting.groups).to_dicts() if self.setting.groups else ():
            if one["group"] != EVERYTHING:
                found.append(_row(one["bin"], one["score"], one["value"], one["n"]))
        if len(scores.gaps):
            alone = drift(trace, occluded, scores.gaps, _filter(name), settings)
            found += drifts(trace, alone, scores.gaps, protocol.length)
        return found


def jobs(scale: Scale, settings: Sequence[Setting]) -> list[World]:
    """Every scenario and seed of a scale with each of the settings, seeds first: an interrupted run
    has a few seeds of all scenarios."""
    return [
        World(name, seed, setting)
        for seed in range(scale.worlds)
        for name in traffic()
        for setting in settings
    ]


def group(scenario: str, seed: int) -> str:
    """Of all jobs that are done with one seed of a scenario."""
    return f"{scenario}, seed {seed}"


@cache
def identity(scenario: str) -> str:
    """All that decides a scenario, as text: a run of many jobs asks for it thousands of times."""
    return scenarios.load(scenario).identity()


@cache
def traffic() -> tuple[str, ...]:
    """The population: every scenario of the catalogue in which a simulator drives."""
    known = (name for name in scenarios.list() if not name.startswith("kitti-"))
    driven = ("sumo", "highway-env")
    return tuple(name for name in known if scenarios.load(name).source in driven)


_profile = cache(sim_bridge.load_profile)


@lru_cache(maxsize=1)
def simulated(scenario: str, seed: int) -> Trace:
    """The trace of a scenario's seed; the last one asked for is kept. Raises `SeedRefused`."""
    cache = sim_bridge.user_cache()
    make = sim_bridge.simulate if cache is None else cache.simulate
    return make(scenarios.load(scenario), seed)


@lru_cache(maxsize=1)
def detected(scenario: str, seed: int, profile: str) -> Detections:
    """Its detections, by a profile's name; the last ones asked for are kept."""
    return sim_bridge.detect(simulated(scenario, seed), _profile(profile), seed)


@cache
def _filter(name: str) -> Estimator:
    """Looked up once: `estimator` asks all installed packages each time."""
    return estimator(name)


def drifts(trace: Trace, alone: pl.DataFrame, gaps: Gaps, length: int) -> list[dict[str, Any]]:
    """Mean drift in the first `length` frames of the gaps [m]: of all, by the true regime as the
    gap begins, and by frame of the gap, counted from 1."""
    pairs = list(zip(gaps.object_id.tolist(), gaps.start.tolist(), strict=True))
    begun = pl.DataFrame(
        {
            "object_id": gaps.object_id,
            "start": gaps.start,
            "regime": [_regime(trace, *pair) for pair in pairs],
        }
    )
    both = alone.join(begun, on="object_id").with_columns(nth=pl.col("frame") - pl.col("start") + 1)
    own = both.filter(pl.col("nth").is_between(1, length))
    parts = [(EVERYTHING, own)]
    parts += [
        (f"regime {name}", part) for (name,), part in own.group_by("regime", maintain_order=True)
    ]
    parts += [(f"frame {nth}", part) for (nth,), part in own.group_by("nth", maintain_order=True)]
    return [_row(name, "drift", part["drift"].mean(), len(part)) for name, part in parts]


def _regime(trace: Trace, object_id: int, frame: int) -> str | None:
    """The object's true regime in a frame."""
    rows = trace.rows_of(object_id)
    at = rows[trace.frame[rows] == frame]
    return REGIMES[trace.regime[at[0]]].replace("_", " ") if len(at) else None


def _row(name: str, metric: str, value: Any, n: int) -> dict[str, Any]:
    return {"bin": name, "metric": metric, "value": value, "n": n}
