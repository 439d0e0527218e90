"""Where the true motion comes from."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from trackbench.truth.config.highway import HighwayTruth, IdTargets, NearestTargets
from trackbench.truth.config.observer import FixedObserver, MovingObserver
from trackbench.truth.config.recording import RecordingTruth
from trackbench.truth.config.scripted import ScriptedTruth

#: Each source of truth is told by its word.
AnyTruth = Annotated[HighwayTruth | ScriptedTruth | RecordingTruth, Field(discriminator="source")]

__all__ = [
    "AnyTruth",
    "FixedObserver",
    "HighwayTruth",
    "IdTargets",
    "MovingObserver",
    "NearestTargets",
    "RecordingTruth",
    "ScriptedTruth",
]
