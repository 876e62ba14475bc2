"""One occlusion to play back from above: truth, detections, each filter, its uncertainty."""

from experiments.playback.fragment import playback

__all__ = ["playback"]
