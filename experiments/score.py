"""Truth and tracks into scores: HOTA, CLEAR, Identity, and position errors around gaps."""

from dataclasses import dataclass

import numpy as np
import polars as pl

from experiments.metrics import (
    ClearScores,
    HotaScores,
    IdentityScores,
    clear,
    hota,
    identity,
    sequence_from_rows,
)
from experiments.occlusion import Gaps, OcclusionProtocol, recorded_gaps
from experiments.phases import gap_errors
from experiments.population import GapTruth, population
from mdkf.tables import TableError, Trace, Tracks

PHASES = ("before", "gap", "after")


@dataclass(frozen=True, eq=False)
class Scores:
    """Scores of one sequence by bird's-eye centre similarity max(0, 1 - d / 2 m).

    errors: `experiments.phases.gap_errors`, one row for each gap and frame.
    """

    hota: HotaScores
    clear: ClearScores
    identity: IdentityScores
    gaps: Gaps
    errors: pl.DataFrame

    def summary(self) -> dict[str, float]:
        """Scores by name; NaN is "no value".

        hota, deta, assa, mota, motp, idf1 in percent; idsw, fp, fn, gaps, followed are counts.
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
) -> Scores:
    """Score tracks against the truth.

    The gaps are those that the tracks' provenance tells of; `occlusion`, if given, must be the
    protocol they came from. gap_truth: whether truth in the gaps is kept (a track that coasts
    well is right there) or ignored.

    Raises `TableError` if the tracks cannot belong to the trace.
    """
    if (trace.n_frames, trace.dt) != (tracks.n_frames, tracks.dt):
        raise TableError(
            f"the tracks have {tracks.n_frames} frames of {tracks.dt} s, the trace"
            f" {trace.n_frames} of {trace.dt} s"
        )
    told = tracks.provenance.get("trace")
    if told is not None and told != trace.content_hash():
        raise TableError("the tracks come from another trace (its content hash differs)")
    gaps = recorded_gaps(tracks, occlusion)
    kept = population(trace, tracks, gaps, gap_truth)
    truth, estimate = trace.take(kept.truth), tracks.take(kept.tracks)
    sequence = sequence_from_rows(
        truth.frame,
        truth.object_id,
        np.column_stack([truth.x, truth.y]),
        estimate.frame,
        estimate.track_id,
        np.column_stack([estimate.x, estimate.y]),
        trace.n_frames,
    )
    return Scores(
        hota(sequence),
        clear(sequence),
        identity(sequence),
        gaps,
        gap_errors(trace, tracks, gaps),
    )


def _value(aggregate: object) -> float:
    """What polars aggregated; NaN where there was nothing."""
    return float("nan") if aggregate is None else float(aggregate)  # type: ignore[arg-type]
