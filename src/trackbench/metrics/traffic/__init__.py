"""Scores of tracks that carry no object's name: which object each is on, how well, how long and with which switches.

Pure functions of one run's histories; :func:`score_run` computes all at once, and ``TRACK_METRICS`` says what each
means.
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
