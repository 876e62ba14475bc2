"""Detector profiles from recorded detections, and how well simulated detections resemble them."""
