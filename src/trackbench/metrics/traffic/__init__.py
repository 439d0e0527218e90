"""Scores of tracks with hidden identities: which object each track is on, how well, how long, with which switches.

They are pure functions of one run's histories; :func:`score_run` computes all, ``TRACK_METRICS`` has their meanings.
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
