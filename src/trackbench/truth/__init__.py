"""Ground truth from the source that a scenario names: simulated and cached, scripted, recorded, or a plug-in's.

The options of a source come in; a ``Truth``, and any recorded measurements, go out. The simulator takes a second to
import, so it is imported only when needed. Read ``base.py`` first.
"""

from __future__ import annotations

from trackbench.truth.base import MAX_SCENES, TRUTH_SOURCES, Draw, LoadedTruth, SteppedTruth, TruthSource

__all__ = ["MAX_SCENES", "TRUTH_SOURCES", "Draw", "LoadedTruth", "SteppedTruth", "TruthSource"]
