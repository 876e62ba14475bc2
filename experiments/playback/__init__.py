"""One occlusion to play back from above: truth, detections, each filter, its uncertainty."""

from experiments.playback.fragment import playback
from experiments.playback.still import still

__all__ = ["playback", "still"]
