"""Chi-square statistics by which a stated covariance is tested, and their bounds."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.special import gammaincinv

from trackbench.base import linalg
from trackbench.base.types import Array, Estimate, Mask


def beyond_path(point: str) -> str:
    """Return the metric path of the share of NEES beyond a point of chi-square, such as "95 %"."""
    return f"nees_beyond.{point.removesuffix(' %')}"


def normalised_square(error: Array, covariance: Array) -> tuple[Array, Array, Mask]:
    """Return ``e^T P^-1 e``, with P the stated covariance of the error e.

    With the estimation error this is the NEES, and with the innovation, whose covariance is
    S, the NIS ``y^T S^-1 y`` (Bar-Shalom, Li and Kirubarajan 2001, section 5.4.2).

    Args:
        error: ``(n, ...)`` estimation errors or innovations.
        covariance: ``(n, n, ...)`` stated covariance of each error.

    Returns:
        The normalised square, the whitened error ``L^-1 e``, and where the covariance is positive definite.
    """
    factor = linalg.cholesky(covariance)
    whitened = factor.whiten(error)
    return np.einsum("i...,i...->...", whitened, whitened), whitened, factor.positive


def whitened_innovation(estimate: Estimate, members: slice = slice(None)) -> Array | None:
    """Return the innovation ``(m, batch)`` in units of its standard deviations.

    If the tracker gives no whitened innovation, it is computed from the innovation and its covariance, NaN where that
    is not positive definite. None where the tracker gives no innovation.
    """
    if estimate.whitened_innovation is not None:
        return estimate.whitened_innovation[:, members]
    if estimate.innovation is None or estimate.innovation_covariance is None:
        return None
    _, white, positive = normalised_square(
        estimate.innovation[:, members], estimate.innovation_covariance[:, :, members]
    )
    return np.where(positive, white, np.nan)


def mean_bounds(dof: int, count: Array | float) -> tuple[Array, Array]:
    """Return the two-sided 95 % bounds of the mean of ``count`` chi-square variables of ``dof`` degrees of freedom."""
    # Few counts are distinct: most instants count all runs.
    n, where = np.unique(np.maximum(np.asarray(count, dtype=float), 1.0), return_inverse=True)
    low, high = ((2 * gammaincinv(n * dof / 2, q) / n)[where] for q in (0.025, 0.975))
    return low, high


#: Fields of the NEES of position and velocity errors along and across the true velocity, by name in the verdict.
DIRECTIONS = {
    "along the motion": "nees_along",
    "across the motion": "nees_across",
    "velocity along the motion": "nees_velocity_along",
    "velocity across the motion": "nees_velocity_across",
}
#: Points of chi-square beyond which NEES are counted, by name, with the expected share beyond.
BEYOND = {"95 %": 0.05, "99 %": 0.01, "99.9 %": 0.001}


@cache
def beyond_points(dof: int) -> tuple[float, ...]:
    """Return the 95 %, 99 % and 99.9 % quantiles of chi-square with ``dof`` degrees of freedom."""
    return tuple(float(2 * gammaincinv(dof / 2, 1.0 - share)) for share in BEYOND.values())


@cache
def point95(dof: int) -> float:
    """Return the 95 % quantile of chi-square with ``dof`` degrees of freedom."""
    return float(2 * gammaincinv(dof / 2, 0.95))
