"""Multi-object trackers: association of detections without identities, start and end of tracks.

Options and scans without identities come in; confirmed tracks go out. Read ``tracker.py`` first.
"""

from trackbench.trackers.multi.tracker import MultiObjectState, MultiObjectTracker, build_multi

__all__ = ["MultiObjectState", "MultiObjectTracker", "build_multi"]
