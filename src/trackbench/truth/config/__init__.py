"""The options of the built-in sources of truth."""

from __future__ import annotations

from trackbench.truth.config.highway import HUMAN, Drivers, HighwayOptions, IdTargets, NearestTargets, VehicleSizes
from trackbench.truth.config.recording import FixedObserver, MovingObserver, RecordingOptions
from trackbench.truth.config.scripted import ScriptedObserver, ScriptedOptions

__all__ = [
    "HUMAN",
    "Drivers",
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
