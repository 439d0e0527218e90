"""What a measurement said to a filter, in an estimate."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Estimate, Mask
from trackbench.filters import Update
from trackbench.trackers.late import Taken


def with_innovation(estimate: Estimate, said: Update[Any], known: Mask | None) -> Estimate:
    """The estimate with what the measurement said, of the tracks that were there before it; None: of all."""
    return estimate._replace(
        innovation=where_known(known, said.innovation),
        innovation_covariance=said.innovation_covariance,
        whitened_innovation=where_known(known, said.whitened_innovation),
        log_likelihood=None if said.mixture is None else where_known(known, said.mixture),
    )


def where_known(known: Mask | None, values: Array) -> Array:
    """The values, NaN where nothing is known yet; None: all is."""
    return values if known is None or np.all(known) else np.where(known, values, np.nan)


def log_likelihood(estimate: Estimate) -> Array | None:
    """``(batch,)`` logarithm of the density of the measurement under the prediction; None where nothing tells it.

    ``N(y; 0, S)`` of the innovation and its covariance. NaN where there was no prediction.
    """
    said: Any = estimate.log_likelihood
    if said is not None:
        return np.asarray(said)
    y, s = estimate.innovation, estimate.innovation_covariance
    if y is None or s is None:
        return None
    factor = linalg.cholesky(s)
    return np.where(factor.positive, factor.log_density(factor.whiten(y)), np.nan)


def total_log_likelihood(taken: Sequence[Taken[Any, Estimate]]) -> Array | float:
    """``(batch,)`` logarithm of the density of all measurements of scans that were taken in."""
    total: Array | float = 0.0
    for one in taken:
        said = None if one.said is None else log_likelihood(one.said)
        if said is not None:
            total = total + np.where(one.scan.valid & ~np.isnan(said), said, 0.0)
    return total
