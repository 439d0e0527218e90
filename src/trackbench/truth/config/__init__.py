"""Where the true motion comes from."""

from __future__ import annotations

from trackbench.truth.config.highway import HighwayTruth, IdTargets, NearestTargets
from trackbench.truth.config.observer import FixedObserver, MovingObserver
from trackbench.truth.config.recording import RecordingTruth
from trackbench.truth.config.scripted import ScriptedTruth

__all__ = [
    "FixedObserver",
    "HighwayTruth",
    "IdTargets",
    "MovingObserver",
    "NearestTargets",
    "RecordingTruth",
    "ScriptedTruth",
]
