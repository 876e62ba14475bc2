"""Truth and tracks, matched once: what every score of them is worked out from.

Whose error a track's is, the population's assignment says: by distance alone, up to 2 m. HOTA's
matches depend on a threshold, CLEAR's on the frames before and end at similarity 0.5, by which
errors would be cut off at 1 m. What is more than 2 m off has no error but is missed and false: mean
errors tell nothing without the miss rate beside them.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from experiments.gaps import Gaps
from experiments.metrics import COLUMNS, ClearMatches, Sequence, clear_matches, sequence_from_rows
from experiments.occlusion import OcclusionProtocol, recorded_gaps
from experiments.pairing import UNASSIGNED
from experiments.population import GapTruth, Population, population
from experiments.states import GospaScores, StateErrors, gospa, state_errors
from mdkf.tables import BoolArray, Detections, TableError, Trace, Tracks

Similarity = Literal["centre", "bird", "box"]
"""What HOTA, CLEAR and Identity compare (`experiments.metrics.boxes`): centres from above by
max(0, 1 - d / 2 m), or boxes by intersection over union, from above or in space."""


@dataclass(frozen=True, eq=False)
class Matched:
    """A trace and tracks of it, and what of them belongs together.

    kept: the rows that count. sequence, clear, gospa: of these, by HOTA's, CLEAR's and GOSPA's own
    rules. states: errors of all the tracks' rows that are on an object, whether it counts or not.
    """

    trace: Trace
    tracks: Tracks
    similarity: Similarity
    gaps: Gaps
    kept: Population
    sequence: Sequence
    clear: ClearMatches
    gospa: GospaScores
    states: StateErrors

    def false(self) -> BoolArray:
        """The tracks' rows (n_track_rows,) that count and that CLEAR leaves on nothing."""
        false = self.kept.tracks.copy()
        hits = self.clear.track_row[self.clear.track_row >= 0]
        false[np.flatnonzero(false)[hits]] = False
        return false


def check_origin(trace: Trace, table: Detections | Tracks) -> None:
    """Raise `TableError` unless detections or tracks can come from a trace."""
    name = type(table).__name__.lower()
    if (trace.n_frames, trace.dt) != (table.n_frames, table.dt):
        raise TableError(
            f"the {name} have {table.n_frames} frames of {table.dt} s, the trace"
            f" {trace.n_frames} of {trace.dt} s"
        )
    told = table.provenance.get("trace")
    if told is not None and told != trace.content_hash():
        raise TableError(f"the {name} come from another trace (its content hash differs)")


def matched(
    trace: Trace,
    tracks: Tracks,
    occlusion: OcclusionProtocol | None = None,
    gap_truth: GapTruth = "keep",
    similarity: Similarity = "centre",
) -> Matched:
    """Match tracks to the truth; arguments and errors are those of `experiments.score`."""
    check_origin(trace, tracks)
    if similarity not in get_args(Similarity):
        raise ValueError(f"similarity {similarity!r}, expected one of {get_args(Similarity)}")
    if similarity != "centre" and not tracks.knows_boxes():
        raise TableError(f"the tracks have no sizes: similarity {similarity!r} needs them")
    gaps = recorded_gaps(tracks, occlusion)
    kept = population(trace, tracks, gaps, gap_truth)
    sequence = sequence_of(trace, tracks, kept.truth, kept.tracks, similarity)
    on_object = np.flatnonzero(kept.object_row != UNASSIGNED)
    return Matched(
        trace,
        tracks,
        similarity,
        gaps,
        kept,
        sequence,
        clear_matches(sequence),
        gospa(
            trace.frame[kept.truth],
            np.column_stack([trace.x, trace.y])[kept.truth],
            tracks.frame[kept.tracks],
            np.column_stack([tracks.x, tracks.y])[kept.tracks],
            trace.n_frames,
        ),
        state_errors(trace, tracks, kept.object_row[on_object], on_object),
    )


def sequence_of(
    trace: Trace,
    tracks: Tracks,
    truth_rows: BoolArray,
    track_rows: BoolArray,
    similarity: Similarity,
) -> Sequence:
    """What HOTA, CLEAR and Identity see of some rows of two tables: (n_rows,) masks."""
    boxes, estimates = (
        np.column_stack([getattr(table, name)[rows] for name in COLUMNS[similarity]])
        for table, rows in ((trace, truth_rows), (tracks, track_rows))
    )
    return sequence_from_rows(
        trace.frame[truth_rows],
        trace.object_id[truth_rows],
        boxes,
        tracks.frame[track_rows],
        tracks.track_id[track_rows],
        estimates,
        trace.n_frames,
        similarity,
    )
