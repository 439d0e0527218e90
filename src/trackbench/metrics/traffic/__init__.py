"""Scores of tracks with hidden identities: which object each track is on, how well, how long, with which switches.

The scores are pure functions of one run's true states and tracks. :func:`score_run` computes all of them, and
``TRACK_METRICS`` explains each.
"""

from trackbench.metrics.traffic.assignment import Associations, TrackHistory, TrafficScoreOptions, TruthHistory
from trackbench.metrics.traffic.run import RunScores, TrackedRun, score_run
from trackbench.metrics.traffic.table import (
    ASSOCIATION_METRICS,
    DETECTION_METRICS,
    OF_FALSE_TRACKS,
    TRACK_METRICS,
    TRACKS,
    RunRatio,
    run_sums,
)

__all__ = [
    "ASSOCIATION_METRICS",
    "DETECTION_METRICS",
    "OF_FALSE_TRACKS",
    "TRACKS",
    "TRACK_METRICS",
    "Associations",
    "RunRatio",
    "RunScores",
    "TrackHistory",
    "TrackedRun",
    "TrafficScoreOptions",
    "TruthHistory",
    "run_sums",
    "score_run",
]
