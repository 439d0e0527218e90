"""The last instant at which something held."""

from __future__ import annotations

import numpy as np

from trackbench.base.types import Indices, Mask


def last_instant(mask: Mask) -> Indices:
    """``(T, ...)`` the last instant up to each, with it, at which ``mask`` is True; -1 where there is none."""
    steps = np.arange(len(mask)).reshape(-1, *[1] * (mask.ndim - 1))
    return np.asarray(np.maximum.accumulate(np.where(mask, steps, -1), axis=0))


def last_instant_before(mask: Mask) -> Indices:
    """``(T, ...)`` the same without the instant itself."""
    return np.concatenate([np.full((1, *mask.shape[1:]), -1), last_instant(mask)[:-1]])
