"""False boxes into a profile's clutter: where they are, and how long they stay.

How long follows from how often a false box has another at its place L frames later: were it a
ghost, the other would be there with probability reported exp(-L dt / life), and flashes have none.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import polars as pl
from scipy.optimize import least_squares, minimize
from scipy.spatial import cKDTree

from experiments.detectors.sightings import Sightings
from mdkf.tables import FloatArray, IntArray
from sim_bridge.clutter import effective_area, nearness
from sim_bridge.kitti import VIEW
from sim_bridge.profile import Clutter

SAME_PLACE = 1.0
"""Distance below which false boxes of different frames are taken for the same [m]."""
LEAST_SCORE = 0.01
"""Of the ghosts' mean score: flashes' is no lower, however few boxes tell."""
LAGS = (1, 2, 3, 4, 5, 6, 8, 10, 15, 20)
"""In frames."""


def fit_clutter(seen: Sightings, max_range: float, lowest: float) -> dict[str, Any]:
    """The clutter of a profile; `lowest` is the detector's lowest score.

    False boxes beyond `max_range` [m] are left out.
    """
    boxes = seen.clutter.filter(pl.col("distance") <= max_range)
    per_frame = len(boxes) / seen.n_frames
    share, life, reported = _persistence(boxes, seen.dt)
    again = reported * np.exp(-seen.dt / life)
    of_flashes, of_ghosts = _scores(boxes, lowest, share, again)
    document: dict[str, Any] = {
        **_place(boxes["distance"].to_numpy(), max_range),
        "flashes": {"density": 0.0, "score_mean": of_flashes},
        "ghosts": {
            "density": 0.0,
            "score_mean": of_ghosts,
            "life": life,
            "reported": reported,
            "jitter": _jitter(boxes),
        },
        **{
            name: {"mean": float(np.mean(values)), "deviation": float(np.std(values))}
            for name in ("length", "width", "height")
            for values in (boxes[name].to_numpy(),)
        },
    }
    _, up_to = effective_area(Clutter.model_validate(document), max_range)
    in_view = up_to[-1] * VIEW / (2.0 * np.pi)
    document["flashes"]["density"] = (1.0 - share) * per_frame / in_view
    document["ghosts"]["density"] = share * per_frame / reported / in_view
    return document


def recurrence(boxes: pl.DataFrame, lags: Sequence[int] = LAGS) -> FloatArray:
    """Share of the false boxes (lags,) that have another at their place so many frames later."""
    return np.array([(_match(boxes, lag) >= 0).mean() for lag in lags])


def _persistence(boxes: pl.DataFrame, dt: float) -> tuple[float, float, float]:
    """Share of the boxes that are ghosts', ghosts' life [s], and how often one is reported.

    A ghost seen in frames k and k + 2 was there in frame k + 1 as well: how often it was seen then
    is how often it is reported.
    """
    after = _match(boxes, 2)
    reported = float((_match(boxes, 1)[after >= 0] >= 0).mean()) if (after >= 0).any() else 1.0
    lags = np.array(LAGS, dtype=np.float64)
    again = recurrence(boxes)

    def off(p: FloatArray) -> FloatArray:
        residual: FloatArray = p[0] * np.exp(-lags * dt / p[1]) - again
        return residual

    level, life = least_squares(off, [0.5, 1.0], bounds=([0.0, 0.01], [1.0, 100.0])).x
    return min(float(level) / reported, 1.0), float(life), reported


def _scores(boxes: pl.DataFrame, lowest: float, share: float, again: float) -> tuple[float, float]:
    """Mean scores of flashes and of ghosts, above the lowest.

    What is there a frame earlier or later is a ghost. What is alone is a flash, or a ghost that
    has another neither before nor after, which has each with probability `again`.
    """
    score = boxes["score"].to_numpy() - lowest
    alone = (_match(boxes, 1) < 0) & (_match(boxes, -1) < 0)
    of_ghosts = float(score[~alone].mean()) if not alone.all() else float(score.mean())
    flashes, ghosts = 1.0 - share, share * (1.0 - again) ** 2
    if not alone.any() or flashes == 0.0:
        return of_ghosts, of_ghosts
    rest = (float(score[alone].mean()) * (flashes + ghosts) - ghosts * of_ghosts) / flashes
    return max(rest, LEAST_SCORE * of_ghosts), of_ghosts


def _place(distance: FloatArray, max_range: float) -> dict[str, float]:
    """min_range, reach and reach_width [m] under which the distances are likeliest."""
    nearest = float(np.quantile(distance, 0.001))
    distance = distance[distance >= nearest]

    def law(p: FloatArray) -> dict[str, float]:
        return {
            "min_range": nearest,
            "reach": float(np.exp(p[0])),
            "reach_width": float(np.exp(p[1])),
        }

    def loss(p: FloatArray) -> float:
        clutter = Clutter.model_construct(**law(p))  # type: ignore[arg-type]
        _, up_to = effective_area(clutter, max_range)
        density = nearness(clutter, distance) / up_to[-1]
        return -float(np.mean(np.log(density)))

    # Far beyond the range the law is flat, and a search that gets there stays there.
    limits = np.log([(0.1 * max_range, 2.0 * max_range), (0.01 * max_range, max_range)])
    bounds = [(float(low), float(high)) for low, high in limits]
    starts = np.log([(0.7 * max_range, 0.1 * max_range), (1.2 * max_range, 0.3 * max_range)])
    found = [minimize(loss, start, method="L-BFGS-B", bounds=bounds) for start in starts]
    return law(min(found, key=lambda each: each.fun).x)


def _jitter(boxes: pl.DataFrame) -> float:
    """Standard deviation of a ghost's position from frame to frame, x and y each [m]."""
    after = _match(boxes, 1)
    stays = after >= 0
    if not stays.any():
        return 0.0
    place = boxes.select("x", "y").to_numpy()
    step = np.abs(place[after[stays]] - place[stays])
    # The median is not moved by neighbours that were taken for the same.
    return float(np.median(step) / 0.6745 / np.sqrt(2.0))


def _match(boxes: pl.DataFrame, lag: int) -> IntArray:
    """For each box the row of the nearest at its place `lag` frames later, -1 for none."""
    # A third coordinate keeps frames, and a fourth sequences, further apart than any place.
    apart = 2.0 * SAME_PLACE
    sequence = boxes["sequence"].rank("dense").to_numpy().astype(np.float64)
    frame = boxes["frame"].to_numpy().astype(np.float64)
    place = boxes.select("x", "y").to_numpy()
    points = np.column_stack([place, apart * frame, apart * sequence])
    later = points + np.array([0.0, 0.0, apart * lag, 0.0])
    distance, row = cKDTree(points).query(later, distance_upper_bound=SAME_PLACE)
    return np.where(np.isfinite(distance), row, -1).astype(np.int64)
