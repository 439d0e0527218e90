"""Ground truth, from whatever source a scenario names: simulated (once, and kept), scripted, recorded, or a plug-in's.

The simulator takes a second to import, so nothing here imports it before it is needed.
"""

from __future__ import annotations

from trackbench.truth.base import MAX_SCENES, TRUTH_SOURCES, Draw, LoadedTruth, SteppedTruth, TruthSource

__all__ = ["MAX_SCENES", "TRUTH_SOURCES", "Draw", "LoadedTruth", "SteppedTruth", "TruthSource"]
