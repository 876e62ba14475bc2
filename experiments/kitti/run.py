"""Detections of recorded sequences through each filter, to scores.

A row is a filter on a detector's detections of all sequences, under one set of rules, scored as
KITTI scores class car: HOTA, CLEAR and Identity of all sequences together.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import polars as pl

from experiments.drift import drift, with_drift
from experiments.kitti.official import Judged
from experiments.kitti.recordings import DetectorFolder, Recording
from experiments.kitti.rules import Rules
from experiments.kitti.unlabelled import without_label
from experiments.metrics import (
    ClearScores,
    HotaScores,
    IdentityScores,
    clear,
    combine_clear,
    combine_hota,
    combine_identity,
    hota,
    identity,
)
from experiments.metrics.matching import Sequence as Matched
from experiments.occlusion import OcclusionProtocol, recorded_gaps
from experiments.phases import gap_errors
from experiments.statistics import told
from experiments.world import timed_tracks
from mdkf import DETECTORS, Detections, TrackerSettings, Tracks, estimator
from sim_bridge.kitti_image import PictureBoxes
from sim_bridge.kitti_writing import write_boxes

Progress = Callable[[str], None]
"""Told what is done each time that a filter is through with a detector."""


@dataclass(frozen=True)
class Plan:
    """What is done with the detections of a detector.

    options: of `TrackerSettings`, in place of the detector's own.
    """

    filters: tuple[str, ...]
    rules: tuple[Rules, ...]
    occlusion: OcclusionProtocol
    options: Mapping[str, Any] = field(default_factory=dict)

    def settings(self, detector: DetectorFolder, rules: Rules) -> TrackerSettings:
        """The tracker's settings on a detector's detections under some rules."""
        return rules.settings(replace(DETECTORS[detector.settings], **self.options))

    def folder(self, out: Path, filter_name: str, rules: Rules) -> Path:
        """Where the files of a filter are: the first rules' by its name alone, as the official
        scorer shows it."""
        name = filter_name if rules == self.rules[0] else f"{filter_name}-{rules.name}"
        return out / "tracks" / name / "data"


Row = dict[str, Any]
"""Values by name; None is "no value"."""


@dataclass(frozen=True)
class Results:
    """rows: one for each filter and rules. left_out: of each (rules, filter) `scores` without each
    of the sequences, by name. errors: `gap_errors` with columns filter, sequence and
    drift of every filter, under the first rules' settings but whatever they let be written."""

    rows: list[Row]
    left_out: Mapping[tuple[str, str], Mapping[str, Row]]
    errors: pl.DataFrame


@dataclass(frozen=True)
class _Part:
    """A sequence's scores of one kind."""

    hota: HotaScores
    clear: ClearScores
    identity: IdentityScores

    @staticmethod
    def of(sequence: Matched) -> "_Part":
        return _Part(hota(sequence), clear(sequence), identity(sequence))


@dataclass(frozen=True)
class SequenceScores:
    """A sequence scored by overlap in the picture, by distance on the ground, and by overlap
    without the rows of labelled cars in frames in which they have no label."""

    image: _Part
    ground: _Part
    labelled: _Part

    @staticmethod
    def of(recording: Recording, tracks: Tracks, boxes: PictureBoxes) -> "SequenceScores":
        """Of tracks and of their boxes in the picture."""
        judged = Judged.of(recording.labels, boxes, tracks.track_id[boxes.row])
        spared = without_label(recording.trace, tracks)[boxes.row]
        return SequenceScores(
            _Part.of(judged.sequence()),
            _Part.of(judged.sequence("ground")),
            _Part.of(judged.sequence(spared=spared)),
        )


def run(
    plan: Plan,
    detector: DetectorFolder,
    recordings: Sequence[Recording],
    detections: Sequence[Detections],
    out: Path | None = None,
    progress: Progress = lambda done: None,
) -> Results:
    """Each filter on the detections of all recordings, occluded by the plan's protocol.

    out: folder for the tracks, `tracks/FILTER/data/SSSS.txt`; None: they are not written.
    """
    occluded = [
        plan.occlusion.apply(found, recording.trace)
        for found, recording in zip(detections, recordings, strict=True)
    ]
    rows: list[Row] = []
    left_out = {}
    errors = []
    for name in plan.filters:
        by_settings: dict[TrackerSettings, tuple[list[Tracks], float]] = {}
        for rules in plan.rules:
            settings = plan.settings(detector, rules)
            if settings not in by_settings:
                by_settings[settings] = _tracked(name, settings, occluded)
            tracks, milliseconds = by_settings[settings]
            written = [
                rules.written(table, recording.camera)
                for table, recording in zip(tracks, recordings, strict=True)
            ]
            if out is not None:
                _write(plan.folder(out, name, rules), recordings, written)
            parts = [
                SequenceScores.of(recording, *each)
                for recording, each in zip(recordings, written, strict=True)
            ]
            left_out[rules.name, name] = {
                recording.sequence: scores(parts[:k] + parts[k + 1 :])
                for k, recording in enumerate(recordings)
            }
            which = {"detector": detector.name, "rules": rules.name, "filter": name}
            row = {**which, "occlusion": str(plan.occlusion), **scores(parts)}
            rows.append({**row, "ms_per_frame": milliseconds})
        if plan.occlusion.kind != "none":
            settings = plan.settings(detector, plan.rules[0])
            errors.append(
                _errors(plan, name, settings, recordings, occluded, by_settings[settings][0])
            )
        progress(f"{detector.name} {name}")
    return Results(rows, left_out, pl.concat(errors) if errors else pl.DataFrame())


def scores(sequences: Sequence[SequenceScores]) -> Row:
    """Scores of all sequences together by name.

    hota, deta, assa, assre, mota, motp, idf1 in percent and idsw, fp, fn as KITTI has them, by
    overlap in the picture; ground_hota, ground_mota, ground_idsw of the same rows by distance on
    the ground; labelled_hota, labelled_mota, labelled_fp without the rows of labelled cars in
    frames in which they have no label (`experiments.kitti.unlabelled`).
    """
    official = _overall([each.image for each in sequences])
    on_ground = _overall([each.ground for each in sequences])
    of_labelled = _overall([each.labelled for each in sequences])
    return {
        **official,
        **{f"ground_{name}": on_ground[name] for name in ("hota", "mota", "idsw")},
        **{f"labelled_{name}": of_labelled[name] for name in ("hota", "mota", "fp")},
    }


def _overall(parts: Sequence[_Part]) -> dict[str, float | None]:
    """HOTA, CLEAR and Identity of all sequences together, by name."""
    overall = combine_hota([part.hota for part in parts])
    counts = combine_clear([part.clear for part in parts])
    percent = {
        "hota": overall.hota_mean,
        "deta": overall.deta_mean,
        "assa": overall.assa_mean,
        "assre": overall.assre_mean,
        "mota": counts.mota,
        "motp": counts.motp,
        "idf1": combine_identity([part.identity for part in parts]).idf1,
    }
    return {
        **{name: told(100 * value) for name, value in percent.items()},
        **{"idsw": counts.idsw, "fp": counts.fp, "fn": counts.fn},
    }


def _tracked(
    name: str, settings: TrackerSettings, detections: Sequence[Detections]
) -> tuple[list[Tracks], float]:
    """The tracks of every sequence, and the tracker's CPU time per frame of all [ms]."""
    tracks, total = [], 0.0
    for found in detections:
        table, milliseconds = timed_tracks(estimator(name), settings, found)
        tracks.append(table)
        total += milliseconds * found.n_frames
    return tracks, total / sum(found.n_frames for found in detections)


def _write(
    folder: Path,
    recordings: Sequence[Recording],
    written: Sequence[tuple[Tracks, PictureBoxes]],
) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for recording, (tracks, boxes) in zip(recordings, written, strict=True):
        write_boxes(folder / f"{recording.sequence}.txt", tracks, boxes)


def _errors(
    plan: Plan,
    name: str,
    settings: TrackerSettings,
    recordings: Sequence[Recording],
    occluded: Sequence[Detections],
    tracks: Sequence[Tracks],
) -> pl.DataFrame:
    """Errors around the gaps of all sequences, with the filter's own drift in `length` frames."""
    parts = []
    for recording, found, table in zip(recordings, occluded, tracks, strict=True):
        gaps = recorded_gaps(table, plan.occlusion)
        followed = gap_errors(recording.trace, table, gaps)
        alone = drift(recording.trace, found, gaps, estimator(name), settings)
        labels = [pl.lit(name).alias("filter"), pl.lit(recording.sequence).alias("sequence")]
        errors = with_drift(followed, alone, plan.occlusion.length)
        parts.append(errors.select(*labels, pl.all()))
    return pl.concat(parts)
