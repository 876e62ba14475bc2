"""Truth and tracks into scores: HOTA, CLEAR, Identity, GOSPA, state errors, errors around gaps."""

from dataclasses import dataclass
from functools import cached_property

import polars as pl

from experiments.breakdown import breakdown
from experiments.gaps import Gaps
from experiments.matched import Matched, Similarity, matched
from experiments.metrics import ClearScores, HotaScores, IdentityScores, clear_of, hota, identity
from experiments.occlusion import OcclusionProtocol
from experiments.phases import gap_errors
from experiments.population import GapTruth
from experiments.states import GospaScores, StateErrors
from mdkf.summary import ORIGIN, as_html, facts
from mdkf.tables import Trace, Tracks

PHASES = ("before", "gap", "after")
_HEADLINE = ("hota", "mota", "idf1", "idsw", "error_gap", "lost")


@dataclass(frozen=True, eq=False, repr=False)
class Scores:
    """Scores of one sequence.

    errors: `experiments.phases.gap_errors`, one row for each gap and frame, however far away.
    """

    hota: HotaScores
    clear: ClearScores
    identity: IdentityScores
    matched: Matched
    errors: pl.DataFrame

    def __repr__(self) -> str:
        told = self.summary()
        return "Scores(" + ", ".join(f"{name}={told[name]:.4g}" for name in _HEADLINE) + ")"

    def _repr_html_(self) -> str:
        """What notebooks show: where the tracks come from, and the scores that have a value."""
        origin = facts(self.matched.tracks)
        told = {name: f"{value:.4g}" for name, value in self.summary().items() if value == value}
        return as_html("Scores", {name: origin[name] for name in origin if name in ORIGIN} | told)

    def to_polars(self) -> pl.DataFrame:
        """The summary as a frame of one row, null where there is no value."""
        return pl.DataFrame([self.summary()]).fill_nan(None)

    @property
    def gaps(self) -> Gaps:
        """The gaps that the tracks tell of."""
        return self.matched.gaps

    @property
    def gospa(self) -> GospaScores:
        """GOSPA of the rows that count."""
        return self.matched.gospa

    @cached_property
    def states(self) -> StateErrors:
        """Errors of all tracks' rows that are on truth that counts, up to 2 m away."""
        every = self.matched.states
        return every.take(self.matched.kept.truth[every.truth_row])

    def by(self, *groups: str) -> pl.DataFrame:
        """Scores by bin (`experiments.breakdown`): `phase`, `regime`, `range`, `level`, or the
        products of several, as `range,level`.

        Raises `ValueError` for an unknown group, and for a product that names one twice.
        """
        return breakdown(self.matched, groups)

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
        by_gap = followed.group_by("object_id", "gap_start").agg(
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

    Raises `TableError` if the tracks cannot belong to the trace or come from another protocol, and
    `ValueError` for an unknown convention or similarity.
    """
    whole = matched(trace, tracks, occlusion, gap_truth, similarity)
    return Scores(
        hota(whole.sequence),
        clear_of(whole.sequence, whole.clear),
        identity(whole.sequence),
        whole,
        gap_errors(trace, tracks, whole.gaps),
    )


def _value(aggregate: object) -> float:
    """What polars aggregated; NaN where there was nothing."""
    return float("nan") if aggregate is None else float(aggregate)  # type: ignore[arg-type]
