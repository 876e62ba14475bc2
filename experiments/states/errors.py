"""Pairs of truth rows and track rows into errors of position, velocity and heading, NEES and NIS.

    NEES = e' P^-1 e, e the error of the position and P its covariance, both the filter's
    NIS = y' S^-1 y, y the innovation and S its covariance, as the estimator tells it

Both are expected to be 2, the numbers in e and y, if the covariances are true.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np

from experiments.states.value import Value, consistency, mean, root_mean_square
from mdkf.tables import BoolArray, FloatArray, IntArray, Trace, Tracks

DEGREES = 2
"""Numbers in a position, and in an innovation."""

NIS_COLUMN = "nis"
"""The column of an estimator's diagnostics that holds its NIS."""


@dataclass(frozen=True, eq=False)
class StateErrors:
    """Errors of n estimates, each of its own object's state: all (n,), NaN is "no value".

    truth_row, track_row: where the pairs are in the trace and the tracks. position [m], velocity
    [m/s]: distances; heading: angle in [0, pi] [rad]; nees, nis: normalised squares.
    """

    truth_row: IntArray
    track_row: IntArray
    position: FloatArray
    velocity: FloatArray
    heading: FloatArray
    nees: FloatArray
    nis: FloatArray

    def __len__(self) -> int:
        return len(self.truth_row)

    def take(self, rows: BoolArray) -> "StateErrors":
        """The errors of some pairs."""
        return StateErrors(*(getattr(self, f.name)[rows] for f in fields(self)))

    def values(self) -> Mapping[str, Value]:
        """Scores by name.

        position_error, velocity_error, heading_error: means [m, m/s, rad]; position_rmse,
        velocity_rmse: roots of the mean squares; backwards: percent of headings more than a
        quarter turn off, as a box has that is taken for its own back; nees, nis: averages.
        """
        back = (self.heading > np.pi / 2).astype(np.float64)
        backwards = mean(np.where(np.isnan(self.heading), np.nan, back))
        return {
            "position_error": mean(self.position),
            "position_rmse": root_mean_square(self.position),
            "velocity_error": mean(self.velocity),
            "velocity_rmse": root_mean_square(self.velocity),
            "heading_error": mean(self.heading),
            "backwards": Value(100.0 * backwards.value, backwards.n),
            "nees": consistency(self.nees, DEGREES),
            "nis": consistency(self.nis, DEGREES),
        }


def state_errors(
    trace: Trace, tracks: Tracks, truth_row: IntArray, track_row: IntArray
) -> StateErrors:
    """Errors of the tracks' rows, each towards the truth row beside it: both (n,) row numbers.

    NEES needs the filter's own position: where the tracker reports the detection instead (its
    provenance says so) it has no value. Nor has NIS if the estimator does not tell
    it, nor the velocity where the trace has none, nor whatever the tracks do not know.
    """
    i, j = truth_row, track_row
    ex, ey = tracks.x[j] - trace.x[i], tracks.y[j] - trace.y[i]
    xx, xy, yy = tracks.cov_xx[j], tracks.cov_xy[j], tracks.cov_yy[j]
    nees = (yy * ex**2 - 2 * xy * ex * ey + xx * ey**2) / (xx * yy - xy**2)
    if tracks.provenance.get("position") == "measurement":
        nees[~tracks.coasted[j]] = np.nan
    turned = np.mod(tracks.yaw[j] - trace.yaw[i], 2 * np.pi)
    nis = tracks.diagnostics.get(NIS_COLUMN)
    return StateErrors(
        i,
        j,
        np.hypot(ex, ey),
        np.hypot(tracks.vx[j] - trace.vx[i], tracks.vy[j] - trace.vy[i]),
        np.minimum(turned, 2 * np.pi - turned),
        nees,
        np.full(len(j), np.nan) if nis is None else nis[j],
    )
