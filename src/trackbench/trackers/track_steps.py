"""State of a batch of tracks, started or not, and estimates made from it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Estimate, Gaussian, Mask
from trackbench.filters import AnyBelief, MultiModelBelief, Update, choose
from trackbench.trackers.cartesian_fallback import CartesianFallback
from trackbench.trackers.initial import TentativeTrack


def belief_estimate(belief: AnyBelief, cartesian: Gaussian) -> Estimate:
    """Return the estimate of a belief whose px, py, vx, vy ``(4, ...)`` are known."""
    if isinstance(belief, MultiModelBelief):
        return Estimate(*cartesian, repaired=belief.repaired, mode_probabilities=belief.probability)
    return Estimate(*cartesian, belief.mean, belief.covariance, repaired=belief.repaired)


def with_innovation(estimate: Estimate, update: Update[Any], tracked: Mask | None = None) -> Estimate:
    """Return the estimate with the innovation of its measurement.

    Args:
        estimate: estimate after the measurement.
        update: update with the measurement.
        tracked: ``(...)`` True for tracks that existed before the measurement; None for all.
    """
    return estimate._replace(
        innovation=where_tracked(tracked, update.innovation),
        innovation_covariance=update.innovation_covariance,
        whitened_innovation=where_tracked(tracked, update.whitened_innovation),
        log_likelihood=None if update.mixture is None else where_tracked(tracked, update.mixture),
    )


def chosen_update(where: Mask, first: Update[Any], second: Update[Any]) -> Update[Any]:
    """Return the first update where ``where`` is True, the second elsewhere."""
    mixture = (
        None if first.mixture is None or second.mixture is None else np.where(where, first.mixture, second.mixture)
    )
    return Update(
        choose(where, first.belief, second.belief),
        np.where(where, first.innovation, second.innovation),
        np.where(where, first.innovation_covariance, second.innovation_covariance),
        np.where(where, first.whitened_innovation, second.whitened_innovation),
        mixture=mixture,
    )


def where_tracked(tracked: Mask | None, values: Array) -> Array:
    """Return the values, with NaN where ``tracked`` is False; None means that all are tracked."""
    return values if tracked is None or np.all(tracked) else np.where(tracked, values, np.nan)


def log_likelihood(estimate: Estimate) -> Array | None:
    """Return ``(batch,)`` the log density of the innovation, ``N(y; 0, S)``.

    NaN without a prediction; None for an estimate without innovations.
    """
    if estimate.log_likelihood is not None:
        return np.asarray(estimate.log_likelihood)
    y, s = estimate.innovation, estimate.innovation_covariance
    if y is None or s is None:
        return None
    factor = linalg.cholesky(s)
    return np.where(factor.positive, factor.log_density(factor.whiten(y)), np.nan)


class TrackState(NamedTuple):
    """State of a built-in tracker after a scan."""

    time: float
    """Time of the latest scan at which the state advanced, s."""
    belief: AnyBelief
    started: Mask
    """``(...)`` True for tracks that have started; the belief of others is a placeholder."""
    waiting: TentativeTrack | None = None
    fallback: CartesianFallback | None = None
    """Position and velocity of tracks whose course is unknown, which replace their belief."""
