"""Small histories of objects and tracks."""

from __future__ import annotations

from typing import Any

import numpy as np

from trackbench.base.types import DUE, Array
from trackbench.metrics.traffic import TrackHistory, TruthHistory
from trackbench.metrics.traffic.assignment import Counted, count_by_gospa, nearby

STEP = 0.5


def truth_of(positions: Any, status: Any = None) -> TruthHistory:
    """From positions ``(T, N)`` along x, m, at instants half a second apart; NaN where the object is absent."""
    x = np.asarray(positions, dtype=float)
    given = np.where(np.isnan(x), 0, DUE if status is None else np.asarray(status)).astype(np.int8)
    return TruthHistory(np.arange(len(x)) * STEP, _states(x), given)


def tracks_of(positions: Any, ids: Any = None, existence: Any = None) -> TrackHistory:
    """From positions ``(T, K)`` along x, m, NaN where there is no track; column k has the id k unless given."""
    x = np.asarray(positions, dtype=float)
    numbers = np.broadcast_to(np.arange(x.shape[1]), x.shape) if ids is None else np.asarray(ids)
    unit = np.broadcast_to(np.eye(4)[:, :, None, None], (4, 4, *x.shape))
    return TrackHistory(np.where(np.isnan(x), -1, numbers), _states(x), unit, existence)


def _states(x: Array) -> Array:
    state = np.zeros((4, *x.shape))
    state[0] = x
    return state


def counted_of(truth: TruthHistory, tracks: TrackHistory, cutoff: float) -> Counted:
    """What counts for GOSPA and its like."""
    return count_by_gospa(nearby(truth, tracks, cutoff))


def random_histories(
    rng: np.random.Generator, steps: int, objects: int, tracks: int, spread: float
) -> tuple[TruthHistory, TrackHistory]:
    """Objects and tracks that come and go along a line of this length."""
    x, y = (rng.uniform(0, spread, (steps, count)) for count in (objects, tracks))
    x[rng.random(x.shape) < 0.2] = np.nan
    y[rng.random(y.shape) < 0.2] = np.nan
    return truth_of(x), tracks_of(y)
