"""The estimates of the built-in filters, and the likelihood of measurements under them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Estimate, Gaussian, Mask
from trackbench.filters import AnyBelief, MultiModelBelief, Update
from trackbench.trackers.late import ProcessedScan


def estimate_of(belief: AnyBelief, cartesian: Gaussian) -> Estimate:
    """The estimate of a belief whose px, py, vx, vy ``(4, ...)`` are known."""
    if isinstance(belief, MultiModelBelief):
        return Estimate(*cartesian, repaired=belief.repaired, mode_probabilities=belief.probability)
    return Estimate(*cartesian, belief.mean, belief.covariance, repaired=belief.repaired)


def with_innovation(estimate: Estimate, update: Update[Any], known: Mask | None) -> Estimate:
    """The estimate with the innovation of its measurement.

    Args:
        estimate: after the measurement.
        update: by it.
        known: ``(...)`` where there was a track before the measurement; None: everywhere.
    """
    return estimate._replace(
        innovation=where_known(known, update.innovation),
        innovation_covariance=update.innovation_covariance,
        whitened_innovation=where_known(known, update.whitened_innovation),
        log_likelihood=None if update.mixture is None else where_known(known, update.mixture),
    )


def where_known(known: Mask | None, values: Array) -> Array:
    """The values, NaN where nothing is known yet; None: all is known."""
    return values if known is None or np.all(known) else np.where(known, values, np.nan)


def log_likelihood(estimate: Estimate) -> Array | None:
    """``(batch,)`` log density of the measurement under the prediction, ``N(y; 0, S)`` of innovation and covariance.

    NaN where there was no prediction; None where the estimate has no innovation.
    """
    stated: Any = estimate.log_likelihood
    if stated is not None:
        return np.asarray(stated)
    y, s = estimate.innovation, estimate.innovation_covariance
    if y is None or s is None:
        return None
    factor = linalg.cholesky(s)
    return np.where(factor.positive, factor.log_density(factor.whiten(y)), np.nan)


def total_log_likelihood(history: Sequence[ProcessedScan[Any, Estimate]]) -> Array | float:
    """``(batch,)`` log density of all measurements of some scans."""
    total: Array | float = 0.0
    for processed in history:
        logarithm = None if processed.answer is None else log_likelihood(processed.answer)
        if logarithm is not None:
            total = total + np.where(processed.scan.valid & ~np.isnan(logarithm), logarithm, 0.0)
    return total
