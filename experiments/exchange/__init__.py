"""Worlds out to other trackers and official scorers, and their results back in."""
