"""Detections into tracks by RobMOT's rules (Nagy et al., 2024).

Each frame: predict all live tracks, delete those grown too uncertain, associate, update the
matched, coast the unmatched, start tracks from what is left, judge validity, report. The stages
are kernels (`mdkf.life_cycle`, `mdkf.association`, `mdkf.report`); `mdkf.engines` strings them
together with the estimator.
"""

from dataclasses import replace
from typing import Any

from mdkf import report
from mdkf.batch import is_batched
from mdkf.engines import Compiled, Interpreted
from mdkf.estimator import Estimator
from mdkf.life_cycle import Seen
from mdkf.settings import TrackerSettings, tracker_settings
from mdkf.tables import Detections, Tracks


class Tracker:
    """Tracks objects with one estimator under one detector's settings.

    estimator: any `mdkf.Estimator`. settings: a name of `mdkf.DETECTORS` or `TrackerSettings`;
    options of the settings can be replaced by keyword, e.g. `coasting=False`.

    `run` takes a whole sequence; `step` takes one frame after another, for use in a live system,
    in constant memory. Built-in estimators run compiled, a user's own frame by frame in Python.
    While it coasts, a track keeps the height, size and heading of its last detection.
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
        self._live: Compiled | Interpreted | None = None
        self._within_step = False

    def run(self, detections: Detections) -> Tracks:
        """The tracks of a whole sequence. The detections' `source` is never read."""
        return self._tracks(self._engine(), detections)

    def step(self, detections: Detections) -> Tracks:
        """The tracks after one more frame: those of `run`, to the bit.

        detections: a table of one frame; its dt is the time since the last one [s]. Raises
        `ValueError` for a table of more frames, and unless the settings' confirmation is `online`:
        what will be confirmed later is not known yet. Raises `RuntimeError` while another thread
        is within a step, and after a step that failed, until `reset`.
        """
        if detections.n_frames != 1:
            raise ValueError(f"a step takes one frame, not {detections.n_frames}")
        if self.settings.confirmation != "online":
            raise ValueError("a step needs confirmation='online': it reports tracks once confirmed")
        if self._within_step:
            raise RuntimeError("the last step has not ended or failed half-way; reset starts anew")
        if self._live is None:
            self._live = self._engine()
        # What ends a step half-way leaves tracks of which some are in this frame, some in the last.
        self._within_step = True
        tracks = self._tracks(self._live, detections)
        self._within_step = False
        return tracks

    def reset(self) -> None:
        """Forget the tracks of all steps so far."""
        self._live = None
        self._within_step = False

    def _engine(self) -> Compiled | Interpreted:
        engine = Compiled if is_batched(self.estimator) else Interpreted
        return engine(self.estimator, self.settings)

    def _tracks(self, engine: Compiled | Interpreted, detections: Detections) -> Tracks:
        seen = Seen.of(detections, self.settings.confirmed_score)
        rows = engine.run(seen, detections.dt)
        return report.table(
            rows, engine.diagnostics, self.settings, detections, repr(self.estimator)
        )
