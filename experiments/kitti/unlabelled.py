"""Which rows of tracks are of labelled cars in frames in which they have no label any more or yet.

A detector sees cars that people have not labelled yet, or no longer. By KITTI's rules such a row is
a false track, though the car is there. A simulated detector is given such cars as well, but only as
far as labels tell of them (`sim_bridge.beyond_labels`): scores without these rows tell the rest.
"""

import numpy as np

from mdkf import Trace, Tracks
from mdkf.tables import BoolArray, IntArray
from sim_bridge.kitti import GATE


def without_label(trace: Trace, tracks: Tracks) -> BoolArray:
    """Which rows (rows,) of the tracks lie before the first or after the last frame of the object
    that the track is of: the one that it is nearest to, within `GATE`, in most frames."""
    track, object_id = _nearest_objects(trace, tracks)
    first, last = (np.full(len(tracks), k, dtype=np.int64) for k in (0, trace.n_frames))
    for identifier in np.unique(track):
        of, frames = np.unique(object_id[track == identifier], return_counts=True)
        lived = trace.frame[trace.rows_of(int(of[np.argmax(frames)]))]
        rows = tracks.rows_of(int(identifier))
        first[rows], last[rows] = lived[0], lived[-1]
    return (tracks.frame < first) | (tracks.frame > last)


def _nearest_objects(trace: Trace, tracks: Tracks) -> tuple[IntArray, IntArray]:
    """Tracks and the objects nearest to them, of all frames in which one is within `GATE`."""
    parts = [(np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64))]
    for k in range(trace.n_frames):
        truth, mine = trace.frame_rows(k), tracks.frame_rows(k)
        if truth.start == truth.stop or mine.start == mine.stop:
            continue
        dx = tracks.x[mine][:, None] - trace.x[truth]
        dy = tracks.y[mine][:, None] - trace.y[truth]
        apart = np.hypot(dx, dy)
        near = apart.min(axis=1) < GATE
        nearest = trace.object_id[truth][apart.argmin(axis=1)]
        parts.append((tracks.track_id[mine][near], nearest[near]))
    track, object_id = (np.concatenate(column) for column in zip(*parts, strict=True))
    return track, object_id
