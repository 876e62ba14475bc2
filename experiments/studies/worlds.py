"""Simulated traffic into rows of scores: every scenario in which a simulator drives, with each
detector and occlusion that an item asks for."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import polars as pl

from experiments.bins import EVERYTHING
from experiments.drift import drift, with_drift
from experiments.named import filter_named
from experiments.occlusion import OcclusionProtocol
from experiments.scoring import score
from experiments.studies.scale import Scale
from experiments.studies.seeds import SeedJob, of_traffic
from mdkf import DETECTORS, Detections, Trace, Tracker

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
class World(SeedJob):
    """One seed of a scenario, simulated, detected and occluded once, tracked by every filter."""

    setting: Setting

    @property
    def labels(self) -> Mapping[str, str]:
        """Of the setting."""
        own = self.setting
        return {"study": STUDY, "detector": own.detector, "occlusion": own.occlusion}

    @property
    def decisions(self) -> Mapping[str, Any]:
        """Of the setting."""
        return {"filters": self.setting.filters, "groups": self.setting.groups}

    def measured(self, trace: Trace) -> Iterator[dict[str, Any]]:
        """The scores of `experiments.score` by name, `drift` [m], and the scores by bin. `drift` by
        bin: regime, as the gap begins, and frame of the gap."""
        profile = PROFILES.get(self.setting.detector, self.setting.detector)
        protocol = OcclusionProtocol.parse(self.setting.occlusion)
        occluded = protocol.apply(self.detected(profile))
        for name in self.setting.filters:
            for one in self._scores(name, trace, occluded, protocol):
                yield {"filter": name, **one}

    def _scores(
        self, name: str, trace: Trace, occluded: Detections, protocol: OcclusionProtocol
    ) -> list[dict[str, Any]]:
        """bin, metric, value and what is behind it, of one filter."""
        settings = DETECTORS[self.setting.detector]
        tracks = Tracker(filter_named(name), settings).run(occluded)
        scores = score(trace, tracks, protocol)
        whole = {**scores.summary(), "assre": 100 * scores.hota.assre_mean}
        found = [_row("all", *one, len(trace)) for one in whole.items()]
        for one in scores.by(*self.setting.groups).to_dicts() if self.setting.groups else ():
            if one["group"] != EVERYTHING:
                found.append(_row(one["bin"], one["score"], one["value"], one["n"]))
        if len(scores.gaps):
            alone = drift(trace, occluded, scores.gaps, filter_named(name), settings)
            found += drifts(scores.errors, alone, protocol.length)
        return found


def jobs(scale: Scale, settings: Sequence[Setting]) -> list[World]:
    """Every scenario and seed of a scale with each of the settings."""
    return [World(*one, setting) for one in of_traffic(scale.worlds) for setting in settings]


def drifts(errors: pl.DataFrame, alone: pl.DataFrame, length: int) -> Iterator[dict[str, Any]]:
    """Mean drift in the first `length` frames of the gaps [m]: of all, by the true regime as the
    gap begins, and by frame of the gap, counted from 1.

    errors, alone: of `experiments.phases.gap_errors` and of `experiments.drift.drift`.
    """
    both = with_drift(errors, alone, length).filter(phase="gap").drop_nulls("drift")
    regime = pl.col("regime").str.replace_all("_", " ")
    own = both.with_columns(regime=regime, nth=pl.col("offset") + 1)
    parts = [(EVERYTHING, own)]
    for label, column in (("regime", "regime"), ("frame", "nth")):
        for (name,), part in own.group_by(column, maintain_order=True):
            parts.append((f"{label} {name}", part))
    for name, part in parts:
        yield _row(name, "drift", part["drift"].mean(), len(part))


def _row(name: str, metric: str, value: Any, n: int) -> dict[str, Any]:
    return {"bin": name, "metric": metric, "value": value, "n": n}
