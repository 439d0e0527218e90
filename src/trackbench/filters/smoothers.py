"""Smoothers: what a filter's beliefs become once the measurements after them are known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackbench import linalg
from trackbench.filters.base import Belief, SingleModelFilter, wrap_components
from trackbench.types import Gaussian
from trackbench.units import difference


def smoothed(filter: SingleModelFilter, filtered: Sequence[Belief], intervals: Sequence[float]) -> list[Gaussian]:
    """The Rauch-Tung-Striebel smoother, from the last belief of a filter to the first.

    With ``D`` the covariance of the state before and after an interval, the prediction ``x^-, P^-`` and the gain
    ``G = D P^-^-1``: ``x <- x + G (x^s - x^-)`` and ``P <- P + G (P^s - P^-) G^T``. Source: Särkkä (2013), theorem 8.2
    for the Kalman filter, algorithm 9.1 for its linearisations and 10.2 for the sigma points.

    Args:
        filter: the one that gave the beliefs.
        filtered: ``(T,)`` after the update of each instant; those with batch axes are smoothed together.
        intervals: ``(T - 1,)`` from each instant to the next, s.
    """
    motion = filter.motion
    result = [Gaussian(filtered[-1].mean, filtered[-1].covariance)]
    for belief, dt in zip(reversed(filtered[:-1]), reversed(intervals), strict=True):
        later, predicted = result[-1], filter.predict(belief, dt)
        definite = linalg.ensure_definite(predicted.covariance)
        # With P^- = L L^T and V = L^-1 D^T the gain is G = V^T L^-1.
        whiten = definite.factor.whiten
        gain = whiten(np.swapaxes(filter.cross_covariance(belief, dt), 0, 1))
        change = whiten(difference(later.mean, predicted.mean, motion.angular))
        mean = wrap_components(belief.mean + linalg.apply_transposed(gain, change), motion.angular)
        loss = whiten(np.swapaxes(whiten(definite.covariance - later.covariance), 0, 1))
        covariance = belief.covariance - linalg.quadratic(np.swapaxes(gain, 0, 1), loss)
        result.append(Gaussian(mean, linalg.symmetrise(covariance)))
    return result[::-1]
