"""Options of the built-in sources of truth."""

from __future__ import annotations

from trackbench.truth.config.highway import HighwayOptions, IdTargets, NearestTargets, VehicleSizes
from trackbench.truth.config.recording import FixedObserver, MovingObserver, RecordingOptions
from trackbench.truth.config.scripted import ScriptedObserver, ScriptedOptions

__all__ = [
    "FixedObserver",
    "HighwayOptions",
    "IdTargets",
    "MovingObserver",
    "NearestTargets",
    "RecordingOptions",
    "ScriptedObserver",
    "ScriptedOptions",
    "VehicleSizes",
]
