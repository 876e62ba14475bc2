"""Recorded KITTI tracking data: the filters on recorded detections, scored by KITTI's rules."""
