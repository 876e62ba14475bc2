"""Which rows a tracker's KITTI files hold: RobMOT's rules, and those without its quirks."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from mdkf import TrackerSettings, Tracks
from sim_bridge.kitti_image import Camera, Picture, PictureBoxes

ROBMOT_PICTURE = Picture(1242.0, 375.0, robmot=True)


@dataclass(frozen=True)
class Rules:
    """Rules by which tracks are made and written.

    coasting: whether frames in which a track has no detection are written. weak: whether
    detections between the detector's two scores count near a confirmed track. picture: where
    boxes are cut; None: at the edges of each sequence's own picture. meaning: for people.
    """

    name: str
    meaning: str
    coasting: bool
    weak: bool
    picture: Picture | None

    def settings(self, detector: TrackerSettings) -> TrackerSettings:
        """A detector's settings under these rules. Coasted frames are left to `written`."""
        least = detector.confirmed_score if self.weak else detector.score
        return replace(
            detector, confirmed_score=max(least, detector.confirmed_score), coasting=True
        )

    def written(self, tracks: Tracks, camera: Camera) -> tuple[Tracks, PictureBoxes]:
        """The tracks' rows that these rules allow, and of them those in the picture."""
        if not self.coasting:
            tracks = tracks.take(np.flatnonzero(~tracks.coasted))
        return tracks, camera.boxes(tracks, self.picture)


RULES: Mapping[str, Rules] = MappingProxyType(
    {
        rules.name: rules
        for rules in (
            Rules(
                "robmot",
                "frames with a detection, whole pixels in 1242 x 375, as RobMOT's program writes",
                coasting=False,
                weak=False,
                picture=ROBMOT_PICTURE,
            ),
            Rules(
                "paper",
                "as robmot, but coasted frames are written too, as the paper's figures suggest",
                coasting=True,
                weak=False,
                picture=ROBMOT_PICTURE,
            ),
            Rules(
                "exact",
                "coasted frames too, unrounded boxes in each sequence's own picture, weak"
                " detections near confirmed tracks",
                coasting=True,
                weak=True,
                picture=None,
            ),
        )
    }
)
"""RobMOT's published program does not write coasted frames. It lets weak detections in where they
are within the gate of a confirmed track, but compares the LiDAR's coordinates with the world's
there: of the 12447 weak ones of second_iou on the val split 97 come in, so none do here."""
