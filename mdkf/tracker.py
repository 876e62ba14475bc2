"""Detections into tracks by RobMOT's rules (Nagy et al., 2024).

Each frame: predict all live tracks, delete those grown too uncertain, associate, update the
matched, coast the unmatched, start tracks from what is left, judge validity, report.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mdkf.association import UNMATCHED, associate, within_gate
from mdkf.estimator import Estimator, join, take
from mdkf.settings import TrackerSettings, tracker_settings
from mdkf.tables import BoolArray, Detections, FloatArray, IntArray, Tracks

_BOX = ("z", "yaw", "length", "width", "height", "score")


@dataclass(frozen=True, eq=False)
class _Population:
    """The live tracks, batched: the estimator's states and what the rules need of each track.

    box (n, 6): the last detection's z, yaw, length, width, height, score; measured (n, 2) [m]:
    where it was; missed (n,): frames since; validity (n,).
    """

    state: Any
    track_id: IntArray
    box: FloatArray
    measured: FloatArray
    missed: IntArray
    validity: FloatArray
    confirmed: BoolArray

    def keep(self, rows: IntArray) -> "_Population":
        arrays = {name: getattr(self, name)[rows] for name in _ARRAYS}
        return _Population(state=take(self.state, rows), **arrays)

    def join(self, others: "_Population") -> "_Population":
        arrays = {n: np.concatenate([getattr(self, n), getattr(others, n)]) for n in _ARRAYS}
        return _Population(state=join(self.state, others.state), **arrays)


_ARRAYS = ("track_id", "box", "measured", "missed", "validity", "confirmed")


class Tracker:
    """Tracks objects with one estimator under one detector's settings.

    estimator: any `mdkf.Estimator`. settings: a name of `mdkf.DETECTORS` or `TrackerSettings`;
    options of the settings can be replaced by keyword, e.g. `coasting=False`.
    """

    def __init__(
        self,
        estimator: Estimator,
        settings: str | TrackerSettings = "pointrcnn",
        **options: Any,
    ) -> None:
        if isinstance(estimator, type) or not isinstance(estimator, Estimator):
            raise TypeError(f"{estimator!r} is no object with the methods of mdkf.Estimator")
        if isinstance(settings, str):
            settings = tracker_settings(settings)
        self.estimator = estimator
        self.settings = replace(settings, **options)

    def run(self, detections: Detections) -> Tracks:
        """The tracks of a whole sequence. The detections' `source` is never read."""
        noise = np.diag([self.settings.x_var, self.settings.y_var])
        # The table's order within a frame betrays the sources; by position it does not.
        order = np.lexsort((detections.y, detections.x, detections.frame))
        measured = np.column_stack([detections.x, detections.y])[order]
        box = np.column_stack([getattr(detections, name) for name in _BOX])[order]
        live: _Population | None = None
        born = 0
        reports: list[dict[str, Any]] = []
        for k in range(detections.n_frames):
            rows = detections.frame_rows(k)
            live = self._step(live, measured[rows], box[rows], noise, detections.dt, born)
            if live is not None:
                born = max(born, int(live.track_id.max(initial=-1)) + 1)
                reports.append(self._report(live, k))
        confirmed = np.zeros(born, dtype=np.bool_)
        for report in reports:
            confirmed[report["track_id"][report["confirmed"]]] = True
        return self._table(reports, confirmed, detections)

    def _step(
        self,
        live: _Population | None,
        measured: FloatArray,
        box: FloatArray,
        noise: FloatArray,
        dt: float,
        born: int,
    ) -> _Population | None:
        """One frame: the live tracks after it, given those before it and its detections."""
        if live is not None:
            live = self._predict(live, dt)
        admitted = self._admit(live, measured, box[:, -1])
        measured, box = measured[admitted], box[admitted]
        free = np.ones(len(measured), dtype=np.bool_)
        if live is not None:
            predicted = self.estimator.position(live.state)
            match = associate(np.ascontiguousarray(predicted), measured, self.settings.gate)
            free[match[match != UNMATCHED]] = False
            live = self._update(live, match, measured, box, noise)
        if free.any():
            new = self._start(measured[free], box[free], noise, born)
            live = new if live is None else live.join(new)
        return live

    def _predict(self, live: _Population, dt: float) -> _Population:
        state = self.estimator.predict(live.state, dt)
        variance = self.estimator.covariance(state).diagonal(axis1=1, axis2=2)
        alive = (variance <= self.settings.max_variance).all(axis=1)
        if self.settings.max_missed is not None:
            alive &= live.missed <= self.settings.max_missed
        live = replace(live, state=state)
        return live if alive.all() else live.keep(np.flatnonzero(alive))

    def _admit(
        self, live: _Population | None, measured: FloatArray, score: FloatArray
    ) -> BoolArray:
        """Detections that count: good ones, and weak ones near a confirmed track."""
        admitted = score >= self.settings.confirmed_score
        weak = admitted & (score < self.settings.score)
        if weak.any():
            near = np.zeros(len(score), dtype=np.bool_)
            if live is not None:
                tracks = self.estimator.position(live.state)[live.confirmed]
                near = within_gate(measured, tracks, self.settings.gate)
            admitted &= ~weak | near
        return admitted

    def _update(
        self,
        live: _Population,
        match: IntArray,
        measured: FloatArray,
        box: FloatArray,
        noise: FloatArray,
    ) -> _Population:
        found = match != UNMATCHED
        n = len(match)
        z = np.full((n, 2), np.nan)
        z[found] = measured[match[found]]
        state = self.estimator.update(live.state, z, np.broadcast_to(noise, (n, 2, 2)))
        boxes, positions = live.box.copy(), live.measured.copy()
        boxes[found], positions[found] = box[match[found]], z[found]
        validity = live.validity.copy()
        validity[found] += _validity(boxes[found, -1], live.missed[found])
        return _Population(
            state,
            live.track_id,
            boxes,
            positions,
            np.where(found, 0, live.missed + 1),
            validity,
            live.confirmed | (validity > self.settings.validity),
        )

    def _start(
        self, measured: FloatArray, box: FloatArray, noise: FloatArray, born: int
    ) -> _Population:
        n = len(measured)
        missed = np.zeros(n, dtype=np.int64)
        validity = _validity(box[:, -1], missed)
        return _Population(
            self.estimator.start(measured, np.broadcast_to(noise, (n, 2, 2))),
            np.arange(born, born + n),
            box,
            measured,
            missed,
            validity,
            validity > self.settings.validity,
        )

    def _report(self, live: _Population, k: int) -> dict[str, Any]:
        """The rows of frame k, all live tracks."""
        position = np.array(self.estimator.position(live.state))
        coasted = live.missed > 0
        if self.settings.position == "measurement":
            position[~coasted] = live.measured[~coasted]
        velocity = self.estimator.velocity(live.state)
        covariance = self.estimator.covariance(live.state)
        return {
            "frame": np.full(len(live.track_id), k),
            "track_id": live.track_id,
            "x": position[:, 0],
            "y": position[:, 1],
            **dict(zip(_BOX, live.box.T, strict=True)),
            "vx": velocity[:, 0],
            "vy": velocity[:, 1],
            "cov_xx": covariance[:, 0, 0],
            "cov_xy": covariance[:, 0, 1],
            "cov_yy": covariance[:, 1, 1],
            "coasted": coasted,
            "confirmed": live.confirmed,
            **self.estimator.diagnostics(live.state),
        }

    def _table(
        self, reports: list[dict[str, Any]], confirmed: BoolArray, detections: Detections
    ) -> Tracks:
        columns = {
            name: np.concatenate([report[name] for report in reports])
            for name in (reports[0] if reports else {})
        }
        if columns:
            told = columns["confirmed"]
            if self.settings.confirmation == "retrospective":
                told = confirmed[columns["track_id"]]
            if not self.settings.coasting:
                told = told & ~columns["coasted"]
            columns = {name: values[told] for name, values in columns.items()}
        fixed = {name: columns.get(name, np.empty(0)) for name in Tracks.column_types()}
        diagnostics = {
            name: values
            for name, values in columns.items()
            if name not in fixed and name != "confirmed"
        }
        return Tracks.from_columns(
            fixed,
            n_frames=detections.n_frames,
            dt=detections.dt,
            provenance={
                **detections.provenance,
                "estimator": repr(self.estimator),
                "settings": repr(self.settings),
            },
            diagnostics=diagnostics,
        )


def _validity(score: FloatArray, missed: IntArray) -> FloatArray:
    """What a match adds to a track's validity after `missed` frames without one (RobMOT)."""
    confidence = np.maximum(score, 1.0)
    gain: FloatArray = confidence * np.exp(-missed) - missed / confidence
    return gain
