"""Two tracks that follow the same object."""

from __future__ import annotations

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Gaussian, Indices, Mask
from trackbench.base.units import difference


def duplicates(detection: Indices, confirmed: Mask, states: Gaussian, angular: tuple[int, ...]) -> Mask:
    """``(L,)`` tracks whose most probable detection is also that of a better track, and whose state is too.

    Of those that share a detection a confirmed track is better than another, and then an older one. Two estimates of
    the same state are as close as the mean of two independent ones: their squared Mahalanobis distance is at most
    ``n``.

    Args:
        detection: ``(L,)`` the most probable one of each track; negative for none.
        confirmed: ``(L,)``.
        states: ``(n, L)``.
        angular: which components of the state are angles.
    """
    mean, covariance = states
    found = np.zeros(len(detection), dtype=bool)
    order = np.lexsort((~confirmed, detection))
    order = order[detection[order] >= 0]
    again = np.diff(detection[order], prepend=-1) == 0
    if not np.any(again):
        return found
    best = order[np.maximum.accumulate(np.where(again, 0, np.arange(len(order))))]
    worse, better = order[again], best[again]
    apart = difference(mean[:, worse], mean[:, better], angular)
    whitened = linalg.cholesky(covariance[..., worse] + covariance[..., better]).whiten(apart)
    found[worse] = np.einsum("ik,ik->k", whitened, whitened) <= len(mean)
    return found
