"""The state of a batch of tracks, and estimates made of it: some tracks may not have started."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Estimate, Gaussian, Mask
from trackbench.filters import AnyBelief, MultiModelBelief, Update, choose
from trackbench.trackers.cartesian_fallback import CartesianFallback
from trackbench.trackers.initial import TentativeTrack


def belief_estimate(belief: AnyBelief, cartesian: Gaussian) -> Estimate:
    """The estimate of a belief whose px, py, vx, vy ``(4, ...)`` are known."""
    if isinstance(belief, MultiModelBelief):
        return Estimate(*cartesian, repaired=belief.repaired, mode_probabilities=belief.probability)
    return Estimate(*cartesian, belief.mean, belief.covariance, repaired=belief.repaired)


def with_innovation(estimate: Estimate, update: Update[Any], tracked: Mask | None = None) -> Estimate:
    """The estimate with the innovation of its measurement.

    Args:
        estimate: after the measurement.
        update: by it.
        tracked: ``(...)`` where there was a track before the measurement; None: everywhere.
    """
    return estimate._replace(
        innovation=where_tracked(tracked, update.innovation),
        innovation_covariance=update.innovation_covariance,
        whitened_innovation=where_tracked(tracked, update.whitened_innovation),
        log_likelihood=None if update.mixture is None else where_tracked(tracked, update.mixture),
    )


def chosen_update(where: Mask, first: Update[Any], second: Update[Any]) -> Update[Any]:
    """The first update where it holds, the second elsewhere."""
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
    """The values, NaN where there is no track; None: there is one everywhere."""
    return values if tracked is None or np.all(tracked) else np.where(tracked, values, np.nan)


def log_likelihood(estimate: Estimate) -> Array | None:
    """``(batch,)`` log density of the measurement under the prediction, ``N(y; 0, S)`` of innovation and covariance.

    NaN where there was no prediction; None where the estimate has no innovation.
    """
    if estimate.log_likelihood is not None:
        return np.asarray(estimate.log_likelihood)
    y, s = estimate.innovation, estimate.innovation_covariance
    if y is None or s is None:
        return None
    factor = linalg.cholesky(s)
    return np.where(factor.positive, factor.log_density(factor.whiten(y)), np.nan)


class TrackState(NamedTuple):
    """The state of a built-in tracker after a scan."""

    time: float
    """Of the latest scan at which the state advanced, s."""
    belief: AnyBelief
    started: Mask
    """``(...)`` where there is a track; elsewhere the belief is a placeholder."""
    waiting: TentativeTrack | None = None
    fallback: CartesianFallback | None = None
    """The tracks whose course is unknown; it replaces their belief."""
