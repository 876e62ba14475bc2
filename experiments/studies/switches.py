"""Motions with one switch of regime into what filters believe around it, and into their drift in
gaps that begin around it.

Closed form (`experiments.studies.motions`), the switch at time zero, each track in a direction of
its own; white noise of the detector's variances, which every filter knows. Perfect association, no
clutter, no deletion. A signal is compared with that of control tracks in the same frame, which are
as old and have been in the quieter of both regimes all the time. Tracks are done in batches: a
batch is what others call a seed.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import pi
from typing import Any, Literal

import numpy as np
import polars as pl

from experiments.jobs import Job, as_rows
from experiments.studies.motions import Straight
from experiments.studies.scale import Scale
from experiments.studies.signals import onset, release, separation, signals
from experiments.studies.worlds import ORDER_2, ORDER_3
from mdkf import DETECTORS, Estimator, estimator, filter_sequence
from mdkf.tables import FloatArray
from sim_bridge.randomness import stream

STUDY = "switches"
DETECTOR = "virconv"
DT = 0.1
"""Time between frames [s]."""
BATCH = 10
"""Tracks of a batch, of each motion."""
READINGS = ("md-innovation", "md-posterior", "md-joint")
"""Other readings of what the paper leaves open: the denoised position, and one weight or two."""
FILTERS = (*ORDER_2, *READINGS, *ORDER_3)
RETUNED = tuple(f"{name}-retuned" for name in ORDER_2)

HISTORY = 40
"""Measured frames before a gap, a track's whole history; and before signals are looked at."""
GAP = 20
"""Frames of a gap."""
STARTS = range(-30, 31, 2)
"""First frames of the gaps, counted from the switch."""
RESPONSE = range(-20, 80)
"""Frames in which signals are looked at, counted from the switch."""
SPAN = range(STARTS.start - HISTORY, RESPONSE.stop)
"""Frames for which noise is drawn: a track's is the same in a frame wherever it is used."""
HELD = 10
"""Frames for which a signal must stand out before the switch to be released by it, and for which a
response must last: noise alone keeps a batch's separation off chance for a few."""
DRAWN = (
    *(("md", "w_v"), ("md", "w_a"), ("md-posterior", "w_v"), ("md-posterior", "w_a")),
    *(("imm", "not cv"), ("imm-zero", "not cv"), ("ca", "speed"), ("ca", "acceleration")),
)
"""Filters and signals whose course is kept, in every second frame."""

Quiet = Literal["before", "after"]


@dataclass(frozen=True)
class Switch:
    """A motion with a switch at time zero.

    quiet: the side of the switch with the less motion. control: a motion that is always so.
    """

    id: str
    title: str
    motion: Straight
    quiet: Quiet
    control: Straight


SWITCHES = (
    Switch(
        "pulls-away",
        "stands, pulls away at 2 m/s²",
        Straight(0.0, ((0.0, 2.0),)),
        "before",
        Straight(0.0),
    ),
    Switch(
        "stops",
        "brakes from 10 m/s at −3 m/s², stands",
        Straight(10.0, ((-10.0 / 3.0, -3.0), (0.0, 0.0))),
        "after",
        Straight(0.0),
    ),
    Switch(
        "brakes",
        "24 m/s, brakes at −3 m/s²",
        Straight(24.0, ((0.0, -3.0),)),
        "before",
        Straight(24.0),
    ),
    Switch(
        "speeds-up",
        "5 m/s, speeds up at 2 m/s²",
        Straight(5.0, ((0.0, 2.0),)),
        "before",
        Straight(5.0),
    ),
    Switch(
        "acceleration-ends",
        "speeds up at 2 m/s² to 14 m/s, keeps it",
        Straight(0.0, ((-7.0, 2.0), (0.0, 0.0))),
        "after",
        Straight(14.0),
    ),
)


@dataclass(frozen=True)
class Switched(Job):
    """Some tracks of every motion."""

    batch: int
    tracks: int

    @property
    def group(self) -> str:
        """Batches have nothing to share."""
        return f"{STUDY}, batch {self.batch}"

    def key(self) -> Mapping[str, Any]:
        """All that decides the rows."""
        return {"study": STUDY, "batch": self.batch, "tracks": self.tracks}

    def rows(self) -> pl.DataFrame:
        """A scenario is a motion. By bin: `start +4`, the first frame of a gap, `drift`, the mean
        error over it [m]; `frame +4`, a signal's mean, and how it stands out from the control; in
        all, a signal's `delay` [s], null without a response, and whether it `responds` [%].
        Frames are counted from the switch."""
        true, hidden = self.gaps()
        seen = self._switched_and_controls()
        measured: list[dict[str, Any]] = []
        for name in (*FILTERS, *RETUNED):
            model = estimator(name)
            own = list(_drifts(model, true, hidden))
            if name not in RETUNED:
                own += _responses(name, _signals(model, seen))
            measured += [{"filter": name, "n": self.tracks, **one} for one in own]
        return as_rows(measured, study=STUDY, seed=self.batch, detector=DETECTOR, occlusion="none")

    def gaps(self) -> tuple[FloatArray, FloatArray]:
        """True and measured positions (frames, switches, starts, tracks, 2) [m] of tracks with a
        history and a gap, the measured NaN in it."""
        motions = [self._drawn(switch.id, switch.motion) for switch in SWITCHES]
        true, seen = (
            np.stack(
                [
                    np.stack([whole[_place(start - HISTORY, start + GAP)] for start in STARTS], 1)
                    for whole in part
                ],
                axis=1,
            )
            for part in zip(*motions, strict=True)
        )
        seen[HISTORY:] = np.nan
        return true, seen

    def _switched_and_controls(self) -> FloatArray:
        """Measured positions (frames, switches, 2, tracks, 2) [m], of the frames of a history and
        `RESPONSE`, of the motions and of their controls."""
        frames = _place(RESPONSE.start - HISTORY, RESPONSE.stop)
        pairs = [
            (
                self._drawn(switch.id, switch.motion)[1][frames],
                self._drawn(f"{switch.id}-control", switch.control)[1][frames],
            )
            for switch in SWITCHES
        ]
        return np.stack([np.stack(pair, axis=1) for pair in pairs], axis=1)

    def _drawn(self, name: str, motion: Straight) -> tuple[FloatArray, FloatArray]:
        """True and measured positions (frames, tracks, 2) [m] in the frames `SPAN`."""
        along = motion.at(DT * np.array(SPAN)).position[:, 0]
        true = np.empty((len(SPAN), self.tracks, 2))
        seen = np.empty_like(true)
        deviation = np.sqrt(_noise().diagonal())
        for place in range(self.tracks):
            random = stream("paper-switches", name, self.batch * BATCH + place)
            heading = random.uniform(-pi, pi)
            true[:, place] = along[:, None] * (np.cos(heading), np.sin(heading))
            seen[:, place] = true[:, place] + deviation * random.standard_normal((len(SPAN), 2))
        return true, seen


def jobs(scale: Scale) -> list[Switched]:
    """All tracks of a scale, in batches."""
    tracks = scale.monte_carlo
    return [
        Switched(first // BATCH, min(BATCH, tracks - first)) for first in range(0, tracks, BATCH)
    ]


def delay(apart: FloatArray, quiet: Quiet) -> float:
    """Frames from the switch to the response of a separation (frames,) in the frames `RESPONSE`,
    NaN if there is none."""
    switch = -RESPONSE.start
    after = apart[switch:]
    if quiet == "before":
        return onset(after, HELD)
    return release(apart[switch - HELD : switch], after, HELD)


def _place(first: int, stop: int) -> slice:
    """Where the frames first..stop-1 are among `SPAN`."""
    return slice(first - SPAN.start, stop - SPAN.start)


def _drifts(model: Estimator, true: FloatArray, seen: FloatArray) -> Iterator[dict[str, Any]]:
    """scenario, bin, metric and value of the mean errors over the gaps of `Switched.gaps`."""
    frames = len(seen)
    estimates = filter_sequence(model, seen.reshape(frames, -1, 2), _noise(), DT)
    error = np.hypot(*np.moveaxis(estimates.position.reshape(true.shape) - true, -1, 0))
    for switch, by_start in zip(SWITCHES, error[HISTORY:].mean(axis=(0, 3)), strict=True):
        for start, value in zip(STARTS, by_start, strict=True):
            place = {"scenario": switch.id, "bin": f"start {start:+d}"}
            yield {**place, "metric": "drift", "value": value}


def _signals(model: Estimator, seen: FloatArray) -> dict[str, FloatArray]:
    """Signals by name, (switches, 2, frames, tracks), of `Switched._switched_and_controls`, in
    the frames `RESPONSE`."""
    z = seen.reshape(len(seen), -1, 2)
    R = np.broadcast_to(_noise(), (z.shape[1], 2, 2))
    state = model.start(z[0], R)
    told: list[dict[str, FloatArray]] = []
    for k in range(1, len(z)):
        state = model.update(model.predict(state, DT), z[k], R)
        told.append(signals(model, state))
    kept = told[-len(RESPONSE) :]
    shape = (len(kept), *seen.shape[1:4])
    return {
        name: np.stack([one[name] for one in kept]).reshape(shape).transpose(1, 2, 0, 3)
        for name in kept[0]
    }


def _responses(name: str, told: Mapping[str, FloatArray]) -> Iterator[dict[str, Any]]:
    """scenario, bin, metric and value of a filter's signals, as `_signals` has them."""
    for signal, values in told.items():
        for switch, (switched, control) in zip(SWITCHES, values, strict=True):
            apart = np.array([separation(*pair) for pair in zip(switched, control, strict=True)])
            if (name, signal) in DRAWN:
                for k in range(0, len(RESPONSE), 2):
                    place = {"scenario": switch.id, "bin": f"frame {RESPONSE[k]:+d}"}
                    yield {**place, "metric": signal, "value": switched[k].mean()}
                    yield {**place, "metric": f"{signal} separation", "value": apart[k]}
            frames = delay(apart, switch.quiet)
            place = {"scenario": switch.id, "bin": "all"}
            yield {**place, "metric": f"{signal} delay", "value": frames * DT}
            responds = 100.0 * np.isfinite(frames)
            yield {**place, "metric": f"{signal} responds", "value": responds}


def _noise() -> FloatArray:
    """Covariance (2, 2) of the measurements [m2]."""
    return np.diag([DETECTORS[DETECTOR].x_var, DETECTORS[DETECTOR].y_var])
