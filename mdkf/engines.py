"""Frames of detections through the rules, with an estimator in between: two engines.

`Compiled` runs built-in estimators, whole sequences in one compiled pass; `Interpreted` runs any
estimator, frame by frame. Both use the same kernels for everything but the estimator, and keep
the live tracks between calls: a sequence in one call or frame by frame gives the same bits.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from mdkf import batch as track
from mdkf.association import UNMATCHED, Room
from mdkf.batch import N_MOMENTS, Batch
from mdkf.compiled import inlined, kernel
from mdkf.estimator import Estimator, join, take
from mdkf.life_cycle import Book, Rules, Seen, associate, expire, settle
from mdkf.report import VALUES, Report, write
from mdkf.settings import TrackerSettings
from mdkf.tables import FloatArray

SLOTS = 32
"""Live tracks that an engine has room for at first."""


class _Engine:
    """What both engines keep between frames: the live tracks and the room to work in."""

    def __init__(self, estimator: Estimator, settings: TrackerSettings) -> None:
        self._estimator: Any = estimator
        self._rules = Rules.of(settings)
        self._measured = settings.position == "measurement"
        self._book = Book.empty(SLOTS)
        self._room = Room.of(SLOTS, SLOTS, SLOTS)

    def _make_room(self, seen: Seen, k: int) -> int:
        """Room for all that frame k may bring; returns how many slots were added."""
        slots = len(self._book.place)
        room = slots, len(self._room.free), len(self._room.cost)
        needed = (
            _most_live(self._book, seen, k),
            int(seen.start[k + 1] - seen.start[k]),
            int(self._room.found[0]),
        )
        sizes = [
            has if need <= has else max(need, 2 * has)
            for has, need in zip(room, needed, strict=True)
        ]
        if sizes != [*room]:
            self._room = Room.of(*sizes)
        if sizes[0] > slots:
            self._book = self._book.enlarged(sizes[0])
        return sizes[0] - slots


class Compiled(_Engine):
    """The engine of estimators with a `batch`; its state has one row for each slot of the book."""

    def __init__(self, estimator: Estimator, settings: TrackerSettings) -> None:
        super().__init__(estimator, settings)
        self._state = self._slots(SLOTS)
        self.diagnostics = tuple(estimator.diagnostics(self._state))

    def run(self, seen: Seen, dt: float) -> list[Report]:
        """The rows of all frames."""
        reports = [self._report(len(seen.position) + SLOTS)]
        frame, frames = 0, len(seen.start) - 1
        while True:
            batch = self._estimator.batch(self._state, dt)
            live = batch, self._book, self._rules
            frame = _track(*live, self._measured, seen, frame, self._room, reports[-1])
            if frame == frames:
                return reports
            more = self._make_room(seen, frame)
            if more:
                self._state = join(self._state, self._slots(more))
            most, rows = _most_live(self._book, seen, frame), len(reports[-1].frame)
            if reports[-1].filled[0] + most > rows:
                reports.append(self._report(max(most, 2 * rows)))

    def _slots(self, n: int) -> Any:
        return self._estimator.start(np.zeros((n, 2)), np.tile(np.eye(2), (n, 1, 1)))

    def _report(self, rows: int) -> Report:
        return Report.empty(rows, len(self.diagnostics))


@kernel
def _track(
    batch: Batch,
    book: Book,
    rules: Rules,
    measured: bool,
    seen: Seen,
    first: int,
    room: Room,
    report: Report,
) -> int:
    """Frames from `first` on; returns the first for which there is no room, or their number."""
    for k in range(first, len(seen.start) - 1):
        most = _most_live(book, seen, k)
        if most > len(book.place) or seen.start[k + 1] - seen.start[k] > len(room.free):
            return k
        if report.filled[0] + most > len(report.frame):
            return k
        if book.totals[2] == 0:
            _predict(batch, book)
            expire(book, rules, room)
            book.totals[2] = 1
        if not associate(book, rules, seen, k, room):
            return k
        _update(batch, book, rules, seen, k, room)
        _start(batch, book, settle(book, rules, seen, k, room))
        _diagnose(batch, book, report)
        write(book, k, measured, report)
        book.totals[2] = 0
    return len(seen.start) - 1


@inlined
def _most_live(book: Book, seen: Seen, k: int) -> int:
    """How many tracks may live after frame k."""
    return int(book.totals[0] + seen.start[k + 1] - seen.start[k])


@inlined
def _predict(batch: Batch, book: Book) -> None:
    for i in range(book.totals[0]):
        track.predict(batch, book.place[i])
        _describe(batch, book, i)


@inlined
def _update(batch: Batch, book: Book, rules: Rules, seen: Seen, k: int, room: Room) -> None:
    R = rules.measure.noise[0], 0.0, rules.measure.noise[1]
    for i in range(book.totals[0]):
        z = (np.nan, np.nan)
        if room.match[i] != UNMATCHED:
            row = seen.start[k] + room.match[i]
            z = (seen.position[row, 0], seen.position[row, 1])
        track.update(batch, book.place[i], z, R)
        _describe(batch, book, i)


@inlined
def _start(batch: Batch, book: Book, before: int) -> None:
    for i in range(before, book.totals[0]):
        slot = book.place[i]
        track.start(batch, slot, (book.measured[slot, 0], book.measured[slot, 1]))
        _describe(batch, book, i)


@inlined
def _diagnose(batch: Batch, book: Book, report: Report) -> None:
    for i in range(book.totals[0]):
        row = report.filled[0] + i
        track.diagnose(batch, book.place[i], report.values, len(VALUES), row)


@inlined
def _describe(batch: Batch, book: Book, i: int) -> None:
    moments = track.moments(batch, book.place[i])
    for column in range(N_MOMENTS):
        book.moments[i, column] = moments[column]


class Interpreted(_Engine):
    """The engine of any estimator; its state has one row for each live track."""

    def __init__(self, estimator: Estimator, settings: TrackerSettings) -> None:
        super().__init__(estimator, settings)
        self._state: Any = None
        self.diagnostics: tuple[str, ...] = ()

    def run(self, seen: Seen, dt: float) -> list[Report]:
        """The rows of all frames."""
        reports = [self._frame(seen, k, dt) for k in range(len(seen.start) - 1)]
        # The names of the diagnostics are not known before there is a track.
        told = [report for report in reports if len(report.frame)]
        return told or [Report.empty(0, len(self.diagnostics))]

    def _frame(self, seen: Seen, k: int, dt: float) -> Report:
        estimator, rules, n = self._estimator, self._rules, int(self._book.totals[0])
        self._make_room(seen, k)
        book = self._book
        if n:
            self._state = estimator.predict(self._state, dt)
            self._describe(n)
            expire(book, rules, self._room)
            if book.totals[0] < n:
                n = int(book.totals[0])
                self._state = take(self._state, self._room.kept[:n])
        while not associate(book, rules, seen, k, self._room):
            self._make_room(seen, k)
        noise = np.diag(rules.measure.noise)
        if n:
            match, z = self._room.match[:n], np.full((n, 2), np.nan)
            found = match != UNMATCHED
            z[found] = seen.position[seen.start[k] + match[found]]
            R = np.broadcast_to(noise, (n, 2, 2))
            self._state = estimator.update(self._state, z, R)
        settle(book, rules, seen, k, self._room)
        born = book.place[n : book.totals[0]]
        if len(born):
            R = np.broadcast_to(noise, (len(born), 2, 2))
            new = estimator.start(book.measured[born], R)
            self._state = join(self._state, new) if n else new
            n += len(born)
        columns: Mapping[str, FloatArray] = {}
        if n:
            self._describe(n)
            columns = estimator.diagnostics(self._state)
            self.diagnostics = self.diagnostics or tuple(columns)
        report = Report.empty(n, len(self.diagnostics))
        for i, name in enumerate(columns):
            report.values[len(VALUES) + i] = columns[name]
        write(book, k, self._measured, report)
        return report

    def _describe(self, n: int) -> None:
        """The estimator's moments into the book."""
        moments = self._book.moments[:n]
        position = self._estimator.position(self._state)
        # Tracks that are nowhere would match nothing and vanish, as if there had been no objects.
        if np.shape(position) != (n, 2) or not np.isfinite(position).all():
            kind = type(self._estimator).__name__
            raise ValueError(
                f"{kind}: positions of {n} tracks have shape {np.shape(position)} or are not"
                f" finite; expected ({n}, 2) finite numbers [m], see mdkf.testing.check_estimator"
            )
        moments[:, 0:2] = position
        moments[:, 2:4] = self._estimator.velocity(self._state)
        covariance = self._estimator.covariance(self._state)
        moments[:, 4:7] = covariance.reshape(n, 4)[:, [0, 1, 3]]
