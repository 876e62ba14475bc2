"""Predicted tracks and detections of one frame into pairs: gate, cost, assignment.

A pair's cost is its distance in the bird's-eye view [m], or Mahalanobis' distance
sqrt(y' S^-1 y), S = P + R [standard deviations]; it must be strictly below the gate. What may be
paired forms a sparse graph, found by a sweep along x or y: in traffic the work grows with the
number of objects, not its square.

`greedy` takes the pair of least cost of all, then the least of what remains (RobMOT); of equal
costs the first track's, then the first detection's. `optimal` minimises the sum of all costs, a
track without a detection costing as much as the gate.
"""

import math
from typing import NamedTuple

import numpy as np

from mdkf.compiled import inlined
from mdkf.ordering import sort_by
from mdkf.tables import BoolArray, FloatArray, IntArray

UNMATCHED = -1

SLACK = 1e-6
"""What the sweep looks beyond the gate [m], against rounding at its edge."""


class Measure(NamedTuple):
    """How far a detection is from a prediction: the gate, and whether cost is Mahalanobis'
    distance with the detections' variances noise, along x and y [m2]."""

    gate: float
    mahalanobis: bool
    noise: tuple[float, float]


class Room(NamedTuple):
    """What one frame is worked out in: for n tracks, d detections and p pairs.

    found (2,): pairs found, also where there is no room for them, and the axis along which. Of
    tracks, (n,): kept, where those that stay were before; match, their detections, counted from
    the frame's first, or `UNMATCHED`. Of detections, (d,): free, whether a track may take it;
    sweep and spare, their order along that axis; along, their place on it. Of pairs, (p,), by
    track: track, detection, cost; by_cost and spare_pairs, their order by cost.
    """

    found: IntArray
    kept: IntArray
    match: IntArray
    free: BoolArray
    sweep: IntArray
    spare: IntArray
    along: FloatArray
    track: IntArray
    detection: IntArray
    cost: FloatArray
    by_cost: IntArray
    spare_pairs: IntArray
    paths: "Paths"

    @classmethod
    def of(cls, n: int, d: int, p: int) -> "Room":
        """Room for n tracks, d detections and p pairs."""
        tracks, detections = np.empty((2, n), dtype=np.int64), np.empty((2, d), dtype=np.int64)
        pairs = np.empty((4, p), dtype=np.int64)
        return cls(
            found=np.zeros(2, dtype=np.int64),
            kept=tracks[0],
            match=tracks[1],
            free=np.empty(d, dtype=np.bool_),
            sweep=detections[0],
            spare=detections[1],
            along=np.empty(d),
            track=pairs[0],
            detection=pairs[1],
            cost=np.empty(p),
            by_cost=pairs[2],
            spare_pairs=pairs[3],
            paths=Paths.of(n, d),
        )


class Paths(NamedTuple):
    """What `optimal` finds augmenting paths in.

    Of tracks: start (n + 1,), their first pairs; place (n,), what they hold; of_track (n,), dual
    variables. Of places, (d + n,), the detections and for each track its place without one:
    holder, back, reached, of_place (dual variables), shortest, done.
    """

    start: IntArray
    place: IntArray
    of_track: FloatArray
    holder: IntArray
    back: IntArray
    reached: IntArray
    of_place: FloatArray
    shortest: FloatArray
    done: BoolArray

    @classmethod
    def of(cls, n: int, d: int) -> "Paths":
        """For n tracks and d detections."""
        places = np.empty((3, d + n), dtype=np.int64)
        return cls(
            start=np.empty(n + 1, dtype=np.int64),
            place=np.empty(n, dtype=np.int64),
            of_track=np.empty(n),
            holder=places[0],
            back=places[1],
            reached=places[2],
            of_place=np.empty(d + n),
            shortest=np.empty(d + n),
            done=np.empty(d + n, dtype=np.bool_),
        )


@inlined
def find_pairs(
    predicted: FloatArray,
    n: int,
    position: FloatArray,
    first: int,
    d: int,
    measure: Measure,
    room: Room,
) -> None:
    """Pairs of n tracks and d detections whose cost is below the gate.

    predicted (n.., 7): the tracks' `mdkf.batch.Moments`; position (.., 2) [m]: the detections are
    the rows from `first` on, ascending by x.
    """
    axis = _sweep(position, first, d, room)
    found = 0
    for t in range(n):
        reach = measure.gate
        if measure.mahalanobis:
            reach *= math.sqrt(predicted[t, 4 + 2 * axis] + measure.noise[axis])
        reach += SLACK
        low, high = predicted[t, axis] - reach, predicted[t, axis] + reach
        i = _first_from(room.along, d, low)
        while i < d and room.along[i] <= high:
            j = room.sweep[i]
            cost = _cost(predicted, t, position, first + j, measure)
            if cost < measure.gate:
                if found < len(room.cost):
                    room.track[found], room.detection[found] = t, j
                    room.cost[found] = cost
                found += 1
            i += 1
    room.found[0], room.found[1] = found, axis


@inlined
def _sweep(position: FloatArray, first: int, d: int, room: Room) -> int:
    """Order the detections along the axis on which they lie further apart; returns the axis."""
    least, most = np.inf, -np.inf
    for j in range(d):
        room.sweep[j] = j
        least, most = min(least, position[first + j, 1]), max(most, position[first + j, 1])
    axis = 0
    if d > 0 and most - least > position[first + d - 1, 0] - position[first, 0]:
        axis = 1
        for j in range(d):
            room.along[j] = position[first + j, 1]
        sort_by(room.along, room.sweep, d, room.spare)
    for i in range(d):
        room.along[i] = position[first + room.sweep[i], axis]
    return axis


@inlined
def _first_from(along: FloatArray, d: int, low: float) -> int:
    """The first of d ascending places that is at least `low`."""
    below, above = 0, d
    while below < above:
        middle = (below + above) // 2
        if along[middle] < low:
            below = middle + 1
        else:
            above = middle
    return below


@inlined
def _cost(predicted: FloatArray, t: int, position: FloatArray, row: int, measure: Measure) -> float:
    dx, dy = position[row, 0] - predicted[t, 0], position[row, 1] - predicted[t, 1]
    if measure.mahalanobis:
        sxx, sxy = predicted[t, 4] + measure.noise[0], predicted[t, 5]
        syy = predicted[t, 6] + measure.noise[1]
        square = (syy * dx * dx - 2.0 * sxy * dx * dy + sxx * dy * dy) / (sxx * syy - sxy * sxy)
        return math.sqrt(max(square, 0.0))
    return math.sqrt(dx * dx + dy * dy)


@inlined
def greedy(room: Room) -> None:
    """Match pairs by cost: room.match, `UNMATCHED` before, gets each track's detection, and
    room.free, the detections that may be taken, loses them."""
    found = room.found[0]
    for k in range(found):
        room.by_cost[k] = k
    if room.found[1] == 1:
        # Found along y; equal costs are taken by track, then detection.
        sort_by(room.detection, room.by_cost, found, room.spare_pairs)
        sort_by(room.track, room.by_cost, found, room.spare_pairs)
    sort_by(room.cost, room.by_cost, found, room.spare_pairs)
    for k in range(found):
        t, j = room.track[room.by_cost[k]], room.detection[room.by_cost[k]]
        if room.match[t] == UNMATCHED and room.free[j]:
            room.match[t] = j
            room.free[j] = False


@inlined
def optimal(room: Room, gate: float, n: int, d: int) -> None:
    """As `greedy`, of n tracks and d detections, but with the least sum of costs.

    Shortest augmenting paths (Crouse, 2016, as in scipy's linear_sum_assignment) on the sparse
    graph, with one more place for each track, at the cost of the gate: nothing.
    """
    paths = room.paths
    for j in range(d + n):
        paths.holder[j], paths.of_place[j] = UNMATCHED, 0.0
        paths.shortest[j], paths.done[j] = np.inf, False
    pair = 0
    for t in range(n):
        paths.start[t], paths.place[t], paths.of_track[t] = pair, UNMATCHED, 0.0
        while pair < room.found[0] and room.track[pair] == t:
            pair += 1
    paths.start[n] = pair
    for t in range(n):
        _augment(room, paths, gate, d, t)
    for t in range(n):
        j = paths.place[t]
        if j < d:
            room.match[t] = j
            room.free[j] = False


@inlined
def _augment(room: Room, paths: Paths, gate: float, d: int, first: int) -> None:
    """Give a place to the track `first`, by the shortest path of exchanges."""
    shortest, done, reached, holder = paths.shortest, paths.done, paths.reached, paths.holder
    of_track, of_place, start = paths.of_track, paths.of_place, paths.start
    n_reached, t, length, end = 0, first, 0.0, UNMATCHED
    while end == UNMATCHED:
        for k in range(start[t], start[t + 1] + 1):
            nothing = k == start[t + 1]
            j = d + t if nothing else room.detection[k]
            if done[j] or not (nothing or room.free[j]):
                continue
            reduced = length + (gate if nothing else room.cost[k]) - of_track[t] - of_place[j]
            if reduced < shortest[j]:
                if shortest[j] == np.inf:
                    reached[n_reached] = j
                    n_reached += 1
                shortest[j], paths.back[j] = reduced, t
        nearest = UNMATCHED
        for i in range(n_reached):
            j = reached[i]
            if not done[j] and (nearest == UNMATCHED or shortest[j] < shortest[nearest]):
                nearest = j
        length, done[nearest] = shortest[nearest], True
        if holder[nearest] == UNMATCHED:
            end = nearest
        else:
            t = holder[nearest]
    of_track[first] += length
    for i in range(n_reached):
        j = reached[i]
        if done[j]:
            if j != end:
                of_track[holder[j]] += length - shortest[j]
            of_place[j] -= length - shortest[j]
        shortest[j], done[j] = np.inf, False
    while end != UNMATCHED:
        t = paths.back[end]
        holder[end] = t
        end, paths.place[t] = paths.place[t], end
