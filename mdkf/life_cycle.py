"""A tracker's book of live tracks, and the rules by which tracks live (RobMOT; Nagy et al., 2024).

Every track has a slot while it lives. The rules are kernels on the book, one for each stage of a
frame; what the estimator knows of the tracks comes in as rows of `mdkf.batch.Moments`, by place
in the order of birth.
"""

import math
from typing import NamedTuple

import numpy as np

from mdkf.association import UNMATCHED, Measure, Room, find_pairs, greedy, optimal
from mdkf.batch import N_MOMENTS
from mdkf.compiled import allocating, inlined
from mdkf.ordering import sort_by
from mdkf.settings import TrackerSettings
from mdkf.tables import BoolArray, Detections, FloatArray, IntArray

BOX = ("z", "yaw", "length", "width", "height", "score")
"""Columns of a box in the book."""

YAW, SCORE = BOX.index("yaw"), BOX.index("score")

NEVER = 2**62
"""More frames than any track can miss."""


class Book(NamedTuple):
    """The live tracks; all arrays have one row for each slot but for the last two.

    place (c,): the slots, those of live tracks first, in their order of birth. track_id; missed:
    frames since the last detection; validity; confirmed; box (c, 6): `BOX` of the last detection;
    sense: how many more of a track's detections looked into the last one's direction than into
    the opposite; measured (c, 2): where the last detection was [m]; moments (c, 7): by place, not
    slot; totals (3,): live tracks, tracks ever born, whether the live ones are predicted already.
    """

    place: IntArray
    track_id: IntArray
    missed: IntArray
    validity: FloatArray
    confirmed: BoolArray
    box: FloatArray
    sense: IntArray
    measured: FloatArray
    moments: FloatArray
    totals: IntArray

    @classmethod
    def empty(cls, slots: int) -> "Book":
        """A book without tracks."""
        numbers = np.zeros((3, slots), dtype=np.int64)
        return cls(
            np.arange(slots),
            numbers[0],
            numbers[1],
            np.zeros(slots),
            np.zeros(slots, dtype=np.bool_),
            np.zeros((slots, len(BOX))),
            numbers[2],
            np.zeros((slots, 2)),
            np.zeros((slots, N_MOMENTS)),
            np.zeros(3, dtype=np.int64),
        )

    def enlarged(self, slots: int) -> "Book":
        """The book with more slots."""
        more = Book.empty(slots)
        for old, new in zip(self, more, strict=True):
            new[: len(old)] = old
        return more


class Rules(NamedTuple):
    """`TrackerSettings` as the kernels take them."""

    measure: Measure
    optimal: bool
    validity: float
    score: float
    max_variance: float
    max_missed: int

    @classmethod
    def of(cls, settings: TrackerSettings) -> "Rules":
        """The rules that these settings set."""
        noise = float(settings.x_var), float(settings.y_var)
        return cls(
            Measure(float(settings.gate), settings.cost == "mahalanobis", noise),
            settings.assignment == "optimal",
            float(settings.validity),
            float(settings.score),
            float(settings.max_variance),
            NEVER if settings.max_missed is None else min(settings.max_missed, NEVER),
        )


class Seen(NamedTuple):
    """Detections as a tracker sees them: those of frame k are the rows start[k] .. start[k + 1] - 1
    of position (n, 2) [m] and box (n, 6), `BOX`, by x, then y, then score. Their source is not
    among them, and the table's order within a frame, which would betray it, is lost."""

    start: IntArray
    position: FloatArray
    box: FloatArray

    @classmethod
    def of(cls, detections: Detections, least_score: float) -> "Seen":
        """The detections that score at least so much."""
        columns = [getattr(detections, name) for name in ("x", "y", *BOX)]
        return cls(*_arranged(detections.frame_start, np.column_stack(columns), least_score))


@allocating
def _arranged(
    start: IntArray, columns: FloatArray, least_score: float
) -> tuple[IntArray, FloatArray, FloatArray]:
    """start, position and box of `Seen` from columns x, y, *BOX."""
    frames, n, score = len(start) - 1, len(columns), 2 + SCORE
    order, spare, key = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64), np.empty(n)
    begin = np.zeros(frames + 1, dtype=np.int64)
    position, box = np.empty((n, 2)), np.empty((n, len(BOX)))
    total = 0
    for k in range(frames):
        d = 0
        for row in range(start[k], start[k + 1]):
            if columns[row, score] >= least_score:
                order[d] = row
                d += 1
        for column in (score, 1, 0):
            for row in range(start[k], start[k + 1]):
                key[row] = columns[row, column]
            sort_by(key, order, d, spare)
        for i in range(d):
            for column in range(2):
                position[total + i, column] = columns[order[i], column]
            for column in range(len(BOX)):
                box[total + i, column] = columns[order[i], 2 + column]
        total += d
        begin[k + 1] = total
    return begin, position[:total], box[:total]


@inlined
def expire(book: Book, rules: Rules, room: Room) -> None:
    """Delete the tracks whose predicted variance, or time without a detection, is too large.

    room.kept gets the places that those that stay had before.
    """
    n, moments = book.totals[0], book.moments
    alive = 0
    for i in range(n):
        slot = book.place[i]
        variance = max(moments[i, 4], moments[i, 6])
        # Written so that NaN fails.
        if variance <= rules.max_variance and book.missed[slot] <= rules.max_missed:
            room.kept[alive] = i
            # The slot of a deleted track goes behind those of the live ones.
            book.place[i], book.place[alive] = book.place[alive], slot
            for column in range(N_MOMENTS):
                moments[alive, column] = moments[i, column]
            alive += 1
    book.totals[0] = alive


@inlined
def associate(book: Book, rules: Rules, seen: Seen, k: int, room: Room) -> bool:
    """Match the live tracks with frame k's detections: room.match gets each track's, room.free
    those that start tracks. Returns whether there was room for it."""
    n, first, d = book.totals[0], seen.start[k], seen.start[k + 1] - seen.start[k]
    find_pairs(book.moments, n, seen.position, first, d, rules.measure, room)
    if room.found[0] > len(room.cost):
        return False
    for i in range(n):
        room.match[i] = UNMATCHED
    # Weak detections count only within the gate of a confirmed track.
    for j in range(d):
        room.free[j] = seen.box[first + j, SCORE] >= rules.score
    for pair in range(room.found[0]):
        if book.confirmed[book.place[room.track[pair]]]:
            room.free[room.detection[pair]] = True
    if rules.optimal:
        optimal(room, rules.measure.gate, n, d)
    else:
        greedy(room)
    return True


@inlined
def settle(book: Book, rules: Rules, seen: Seen, k: int, room: Room) -> int:
    """Write down which live track was seen where, which was not, and the new tracks of the
    detections that are free; returns how many tracks there were before."""
    first, before = seen.start[k], book.totals[0]
    for i in range(before):
        slot, row = book.place[i], first + room.match[i]
        if room.match[i] == UNMATCHED:
            book.missed[slot] += 1
            continue
        if math.cos(seen.box[row, YAW] - book.box[slot, YAW]) < 0.0:
            book.sense[slot] = -book.sense[slot]
        book.sense[slot] += 1
        book.validity[slot] += gain(seen.box[row, SCORE], book.missed[slot])
        book.missed[slot] = 0
        _copy_detection(book, rules, slot, seen, row)
    for row in range(first, seen.start[k + 1]):
        if room.free[row - first]:
            slot = book.place[book.totals[0]]
            book.track_id[slot] = book.totals[1]
            book.missed[slot], book.sense[slot] = 0, 1
            book.validity[slot] = gain(seen.box[row, SCORE], 0)
            book.confirmed[slot] = False
            _copy_detection(book, rules, slot, seen, row)
            book.totals[0] += 1
            book.totals[1] += 1
    return int(before)


@inlined
def _copy_detection(book: Book, rules: Rules, slot: int, seen: Seen, row: int) -> None:
    if book.validity[slot] > rules.validity:
        book.confirmed[slot] = True
    for column in range(len(BOX)):
        book.box[slot, column] = seen.box[row, column]
    book.measured[slot, 0] = seen.position[row, 0]
    book.measured[slot, 1] = seen.position[row, 1]


@inlined
def gain(score: float, missed: int) -> float:
    """What a match adds to a track's validity after `missed` frames without one (RobMOT)."""
    confidence = max(score, 1.0)
    return confidence * math.exp(-missed) - missed / confidence
