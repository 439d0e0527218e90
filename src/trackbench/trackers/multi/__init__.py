"""Trackers of several objects: they associate detections that nobody labelled, and let tracks begin and end."""

from trackbench.trackers.multi.tracker import MultiObjectState, MultiObjectTracker, build_multi

__all__ = ["MultiObjectState", "MultiObjectTracker", "build_multi"]
