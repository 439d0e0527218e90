"""Random streams, each derived from what it is for and from nothing else.

Run 17's noise does not depend on how many runs, workers, trackers or other sensors there are.
"""

from __future__ import annotations

import hashlib

import numpy as np


def stream(seed: int, scenario: str, run: int, purpose: str) -> np.random.Generator:
    """The generator of one run for one purpose (a sensor's name, or the draw of the initial error)."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, _key(scenario), run, _key(purpose)])))


def _key(name: str) -> int:
    return int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "little")
