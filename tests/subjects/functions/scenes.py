"""Egos and objects of one instant, or of many at once."""

from __future__ import annotations

from typing import Any

import numpy as np

from trackbench.metrics.ego import Ego
from trackbench.subjects.functions.protocol import Objects


def ego(speed: float = 20.0, yaw_rate: float = 0.0, yaw: float = 0.0, x: Any = 0.0, y: float = 0.0) -> Ego:
    """5 m long and 2 m wide, with arrays of the shape of ``x``."""
    values = (x, y, yaw, speed * np.cos(yaw), speed * np.sin(yaw), yaw_rate)
    return Ego(*np.broadcast_arrays(*map(np.asarray, values)), length=5.0, width=2.0)


def objects(*states: Any, covariance: Any = None) -> Objects:
    """4.5 m long and 1.8 m wide, of states ``(4, ...)``, all with one covariance."""
    mean = np.stack([np.asarray(state, dtype=float) for state in states], axis=1)
    there = np.ones(mean.shape[1:], dtype=bool)
    spread = np.zeros((4, 4)) if covariance is None else np.asarray(covariance)
    spread = np.broadcast_to(spread.reshape(4, 4, *[1] * there.ndim), (4, 4, *there.shape))
    return Objects(mean, spread, there, np.full(there.shape, 4.5), np.full(there.shape, 1.8))


#: Where the centres of an ego and an object are when they touch, along and across the path, m.
LENGTHS, WIDTHS = 4.75, 1.9
