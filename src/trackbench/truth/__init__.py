"""Ground truth, from whatever source a scenario names: simulated (once, and kept), scripted, recorded, or a plug-in's.

The simulator takes a second to import, so nothing here imports it before it is needed.
"""

from __future__ import annotations

from trackbench.truth.base import MAX_SCENES, TRUTH_SOURCES, Draw, LoadedTruth, SteppedTruth, TruthSource

__all__ = ["MAX_SCENES", "TRUTH_SOURCES", "Draw", "LoadedTruth", "SteppedTruth", "TruthSource", "list_envs"]


def list_envs() -> list[str]:
    """The environments that a scenario can name."""
    from trackbench.truth import highway

    return highway.list_envs()
