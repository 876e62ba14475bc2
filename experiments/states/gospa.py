"""Places of truth and of tracks into GOSPA: one distance between two sets, and its three parts.

    GOSPA^p = sum over pairs d^p  +  c^p / 2 (missed + false)        (alpha = 2)

over the one-to-one assignment of pairs closer than c that makes it smallest. Rahmathullah,
Garcia-Fernandez and Svensson, Generalized optimal sub-pattern assignment metric, FUSION 2017. Only
with alpha = 2 is an object that is not assigned simply missed, and a track simply false.
"""

from dataclasses import dataclass, replace

import numpy as np

from experiments.pairing import UNASSIGNED, assigned
from experiments.population import MATCH_DISTANCE
from experiments.states.value import NO_VALUE, Value
from mdkf.tables import BoolArray, FloatArray, IntArray

CUTOFF = MATCH_DISTANCE
"""c [m]: where a track has nothing to do with an object in every other score either. One missed
object costs as much as a position error of c / 2^(1/p), 1.4 m for p = 2."""

POWER = 2.0
"""p: squares, as in the root mean square error that GOSPA is where nothing is missed or false."""


@dataclass(frozen=True, eq=False)
class GospaScores:
    """GOSPA row by row, so that frames and parts of it are sums over rows.

    truth_frame (n,), distance (n,) [m]: of every object, NaN where it is missed. track_frame (m,),
    false (m,): of every track, whether it is on nothing.
    """

    truth_frame: IntArray
    distance: FloatArray
    track_frame: IntArray
    false: BoolArray
    n_frames: int
    cutoff: float
    power: float

    def of(self, truth: BoolArray, tracks: BoolArray) -> "GospaScores":
        """The share of some objects (n,) and, of the tracks on nothing, of some (m,). The pairs
        stay what they are: the shares' p-th powers add up."""
        false = np.flatnonzero(self.false & tracks)
        return replace(
            self,
            truth_frame=self.truth_frame[truth],
            distance=self.distance[truth],
            track_frame=self.track_frame[false],
            false=np.ones(len(false), dtype=np.bool_),
        )

    def frames(self) -> FloatArray:
        """GOSPA of every frame (n_frames,) [m]; of two empty sets it is 0."""
        localisation, missed, false = self._costs()
        total: FloatArray = (localisation + missed + false) ** (1 / self.power)
        return total

    def values(self) -> dict[str, Value]:
        """gospa, and its parts gospa_localisation, gospa_missed, gospa_false [m], each as the
        p-th root of the mean p-th power over the frames with any object or track: the parts' p-th
        powers add up to that of the whole."""
        occupied = np.zeros(self.n_frames, dtype=np.bool_)
        occupied[self.truth_frame] = occupied[self.track_frame] = True
        n = int(occupied.sum())
        localisation, missed, false = (float(cost.sum()) for cost in self._costs())
        sums = {
            "gospa": localisation + missed + false,
            "gospa_localisation": localisation,
            "gospa_missed": missed,
            "gospa_false": false,
        }
        return {
            name: Value((cost / n) ** (1 / self.power), n) if n else NO_VALUE
            for name, cost in sums.items()
        }

    def _costs(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """What pairs, missed objects and false tracks cost in every frame (n_frames,) [m^p]."""
        alone = self.cutoff**self.power / 2
        missed = np.isnan(self.distance)
        pairs = np.where(missed, 0.0, self.distance) ** self.power
        counted = (
            (self.truth_frame, pairs),
            (self.truth_frame, alone * missed),
            (self.track_frame, alone * self.false),
        )
        localisation, lost, false = (
            np.bincount(frame, cost, self.n_frames).astype(np.float64) for frame, cost in counted
        )
        return localisation, lost, false


def gospa(
    truth_frame: IntArray,
    truth_xy: FloatArray,
    track_frame: IntArray,
    track_xy: FloatArray,
    n_frames: int,
    cutoff: float = CUTOFF,
    power: float = POWER,
) -> GospaScores:
    """GOSPA of every frame.

    truth_frame (n,), track_frame (m,): ascending, in 0..n_frames-1. truth_xy (n, 2), track_xy
    (m, 2) [m]. cutoff: c [m]; power: p, at least 1.

    Raises `ValueError` for another cutoff or power, or rows that do not ascend by frame.
    """
    if not (np.isfinite(cutoff) and cutoff > 0.0):
        raise ValueError(f"cutoff is {cutoff} m, expected a distance above 0")
    if not (np.isfinite(power) and power >= 1.0):
        raise ValueError(f"power is {power}, expected a number of at least 1")
    for name, frame in (("truth_frame", truth_frame), ("track_frame", track_frame)):
        if len(frame) and not (
            (np.diff(frame) >= 0).all() and frame[0] >= 0 and frame[-1] < n_frames
        ):
            raise ValueError(f"{name}: expected frames of 0..{n_frames - 1}, ascending")
    row = assigned(truth_frame, truth_xy, track_frame, track_xy, n_frames, cutoff, power)
    pair = np.flatnonzero(row != UNASSIGNED)
    distance = np.full(len(truth_frame), np.nan)
    error = truth_xy[row[pair]] - track_xy[pair]
    distance[row[pair]] = np.hypot(error[:, 0], error[:, 1])
    false = row == UNASSIGNED
    return GospaScores(truth_frame, distance, track_frame, false, n_frames, cutoff, power)
