"""Truth and tracks into scores: HOTA, CLEAR, Identity, GOSPA, state errors, errors around gaps."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import polars as pl

from experiments.metrics import (
    COLUMNS,
    ClearScores,
    HotaScores,
    IdentityScores,
    Sequence,
    clear,
    hota,
    identity,
    sequence_from_rows,
)
from experiments.occlusion import Gaps, OcclusionProtocol, recorded_gaps
from experiments.phases import gap_errors
from experiments.population import GapTruth, population
from experiments.states import GospaScores, StateErrors, gospa, state_errors
from mdkf.tables import TableError, Trace, Tracks

Similarity = Literal["centre", "bird", "box"]
"""What HOTA, CLEAR and Identity compare (`experiments.metrics.boxes`): centres from above by
max(0, 1 - d / 2 m), or boxes by intersection over union, from above or in space."""

PHASES = ("before", "gap", "after")


@dataclass(frozen=True, eq=False)
class Scores:
    """Scores of one sequence.

    states: errors of all tracks' rows that are on truth that counts, up to 2 m away. errors:
    `experiments.phases.gap_errors`, one row for each gap and frame, however far away.
    """

    hota: HotaScores
    clear: ClearScores
    identity: IdentityScores
    gospa: GospaScores
    states: StateErrors
    gaps: Gaps
    errors: pl.DataFrame

    def summary(self) -> dict[str, float]:
        """Scores by name; NaN is "no value".

        hota, deta, assa, mota, motp, idf1, miss_rate (of the truth rows) in percent; idsw, fp, fn,
        gaps, followed are counts. gospa and its parts: `GospaScores.values`; position_error to
        nis: `StateErrors.values`.
        error_before, error_gap, error_after: mean position error over the frames of all followed
        gaps [m], as long as the track lives; gap_median: its median in the gap. captured: percent
        of followed gaps in which another detection took the track; deleted: in which it ended;
        lost: percent of those with a reappearing object whose track is not with it afterwards.
        """
        followed = self.errors.filter(pl.col("track_id") >= 0)
        by_gap = followed.group_by("object_id").agg(
            pl.col("captured", "deleted", "recovered").first(),
            (pl.col("phase") == "after").any().alias("reappears"),
        )
        in_gap = followed.filter(pl.col("phase") == "gap")
        lost = by_gap.filter("reappears").select(~pl.col("recovered"))
        return {
            "hota": 100 * self.hota.hota_mean,
            "deta": 100 * self.hota.deta_mean,
            "assa": 100 * self.hota.assa_mean,
            "mota": 100 * self.clear.mota,
            "motp": 100 * self.clear.motp,
            "idf1": 100 * self.identity.idf1,
            "idsw": float(self.clear.idsw),
            "fp": float(self.clear.fp),
            "fn": float(self.clear.fn),
            "miss_rate": 100 * (1 - self.clear.recall),
            **{name: value.value for name, value in self.gospa.values().items()},
            **{name: value.value for name, value in self.states.values().items()},
            **{
                f"error_{phase}": _value(followed.filter(pl.col("phase") == phase)["error"].mean())
                for phase in PHASES
            },
            "gap_median": _value(in_gap["error"].median()),
            "captured": 100 * _value(by_gap["captured"].mean()),
            "deleted": 100 * _value(by_gap["deleted"].mean()),
            "lost": 100 * _value(lost["recovered"].mean()),
            "gaps": float(len(self.gaps)),
            "followed": float(len(by_gap)),
        }


def score(
    trace: Trace,
    tracks: Tracks,
    occlusion: OcclusionProtocol | None = None,
    gap_truth: GapTruth = "keep",
    similarity: Similarity = "centre",
) -> Scores:
    """Score tracks against the truth.

    The gaps are those that the tracks' provenance tells of; `occlusion`, if given, must be the
    protocol they came from. gap_truth: whether truth in the gaps is kept (a track that coasts
    well is right there) or ignored. similarity: of HOTA, CLEAR (from 0.5 on) and Identity (from
    0.5 on); all else is by distance.

    Raises `TableError` if the tracks cannot belong to the trace, and `ValueError` for an unknown
    convention or similarity.
    """
    gaps = hidden_gaps(trace, tracks, occlusion)
    kept = population(trace, tracks, gaps, gap_truth)
    truth, estimate = trace.take(kept.truth), tracks.take(kept.tracks)
    sequence = sequence_of(truth, estimate, similarity)
    return Scores(
        hota(sequence),
        clear(sequence),
        identity(sequence),
        gospa_of(truth, estimate),
        state_errors(trace, tracks, *kept.pairs()),
        gaps,
        gap_errors(trace, tracks, gaps),
    )


def hidden_gaps(trace: Trace, tracks: Tracks, occlusion: OcclusionProtocol | None = None) -> Gaps:
    """The gaps that the tracks tell of.

    Raises `TableError` if the tracks cannot belong to the trace, or come from another protocol.
    """
    if (trace.n_frames, trace.dt) != (tracks.n_frames, tracks.dt):
        raise TableError(
            f"the tracks have {tracks.n_frames} frames of {tracks.dt} s, the trace"
            f" {trace.n_frames} of {trace.dt} s"
        )
    told = tracks.provenance.get("trace")
    if told is not None and told != trace.content_hash():
        raise TableError("the tracks come from another trace (its content hash differs)")
    return recorded_gaps(tracks, occlusion)


def sequence_of(truth: Trace, tracks: Tracks, similarity: Similarity) -> Sequence:
    """What HOTA, CLEAR and Identity see of the rows of two tables, all of which count."""
    if similarity not in get_args(Similarity):
        raise ValueError(f"similarity {similarity!r}, expected one of {get_args(Similarity)}")
    boxes = (
        np.column_stack([getattr(table, name) for name in COLUMNS[similarity]])
        for table in (truth, tracks)
    )
    return sequence_from_rows(
        truth.frame,
        truth.object_id,
        next(boxes),
        tracks.frame,
        tracks.track_id,
        next(boxes),
        truth.n_frames,
        similarity,
    )


def gospa_of(truth: Trace, tracks: Tracks) -> GospaScores:
    """GOSPA of the rows of two tables, all of which count."""
    return gospa(
        truth.frame,
        np.column_stack([truth.x, truth.y]),
        tracks.frame,
        np.column_stack([tracks.x, tracks.y]),
        truth.n_frames,
    )


def _value(aggregate: object) -> float:
    """What polars aggregated; NaN where there was nothing."""
    return float("nan") if aggregate is None else float(aggregate)  # type: ignore[arg-type]
