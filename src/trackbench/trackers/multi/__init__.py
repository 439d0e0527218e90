"""Trackers of several objects: they associate detections that nobody labelled, and let tracks begin and end."""

from trackbench.trackers.multi.tracker import MultiObjectTracker, build_multi

__all__ = ["MultiObjectTracker", "build_multi"]
