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
    """Return the estimate of a belief, given its px, py, vx, vy ``(4, ...)``."""
    if isinstance(belief, MultiModelBelief):
        return Estimate(*cartesian, repaired=belief.repaired, mode_probabilities=belief.probability)
    return Estimate(*cartesian, belief.mean, belief.covariance, repaired=belief.repaired)


def with_innovation(estimate: Estimate, update: Update[Any], tracked: Mask | None = None) -> Estimate:
    """Return the estimate with the innovation of its measurement.

    Args:
        estimate: estimate after the measurement.
        update: update with the measurement.
        tracked: mask ``(...)``, True for tracks that existed before the measurement; None if all did.
    """
    return estimate._replace(
        innovation=where_tracked(tracked, update.innovation),
        innovation_covariance=update.innovation_covariance,
        whitened_innovation=where_tracked(tracked, update.whitened_innovation),
        log_likelihood=None if update.mixture is None else where_tracked(tracked, update.mixture),
    )


def chosen_update(where: Mask, first: Update[Any], second: Update[Any]) -> Update[Any]:
    """Return an update that is ``first`` where the mask ``where`` is True, and ``second`` elsewhere."""
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
    """Return ``values``, with NaN where the mask ``tracked`` is False; None means that all are tracked."""
    return values if tracked is None or np.all(tracked) else np.where(tracked, values, np.nan)


def log_likelihood(estimate: Estimate) -> Array | None:
    """Return the log density ``N(y; 0, S)`` of each innovation, ``(batch,)``.

    The density is NaN without a prediction. The result is None for an estimate without innovations.
    """
    if estimate.log_likelihood is not None:
        return np.asarray(estimate.log_likelihood)
    y, s = estimate.innovation, estimate.innovation_covariance
    if y is None or s is None:
        return None
    factor = linalg.cholesky(s)
    return np.where(factor.positive, factor.log_density(factor.whiten(y)), np.nan)


class TrackState(NamedTuple):
    """Time, beliefs and started tracks of a built-in single-object tracker after a scan."""

    time: float
    """Time of the latest scan that moved the state in time, s."""
    belief: AnyBelief
    started: Mask
    """Mask ``(...)``, True for tracks that have started; the beliefs of other tracks are placeholders."""
    waiting: TentativeTrack | None = None
    fallback: CartesianFallback | None = None
    """Position and velocity of the tracks whose course is unknown, in place of their beliefs; None without any."""
