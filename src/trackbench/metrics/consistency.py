"""Whether a covariance can be believed: chi-square statistics and their bounds."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.special import gammaincinv

from trackbench.base import linalg
from trackbench.base.types import Array, Estimate, Mask


def beyond_path(point: str) -> str:
    """Return the path of the share of the NEES beyond a point of ``BEYOND``."""
    return f"nees_beyond.{point.removesuffix(' %')}"


def normalised_square(error: Array, covariance: Array) -> tuple[Array, Array, Mask]:
    """``e^T P^-1 e``, with P the stated covariance of e.

    With the estimation error this is the NEES, and with the innovation, whose covariance is
    S, the NIS ``y^T S^-1 y`` (Bar-Shalom, Li and Kirubarajan 2001, section 5.4.2).

    Args:
        error: ``(n, ...)``.
        covariance: ``(n, n, ...)``.

    Returns:
        It, the whitened error ``L^-1 e``, and where the covariance is positive definite.
    """
    factor = linalg.cholesky(covariance)
    whitened = factor.whiten(error)
    return np.einsum("i...,i...->...", whitened, whitened), whitened, factor.positive


def whitened_innovation(estimate: Estimate, members: slice = slice(None)) -> Array | None:
    """``(m, batch)`` innovation in units of its own standard deviations: what the tracker gives, or else computed.

    None where the tracker gives no innovation; NaN where its covariance is not positive definite.
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
    """Two-sided 95 % bounds of the mean of ``count`` independent chi-square variables of ``dof`` degrees of freedom."""
    # The numbers are few: mostly that of all runs.
    n, where = np.unique(np.maximum(np.asarray(count, dtype=float), 1.0), return_inverse=True)
    low, high = ((2 * gammaincinv(n * dof / 2, q) / n)[where] for q in (0.025, 0.975))
    return low, high


#: The NEES of errors along and across the true velocity, by name of the part of the verdict: of the position, and of
#: the velocity.
DIRECTIONS = {
    "along the motion": "nees_along",
    "across the motion": "nees_across",
    "velocity along the motion": "nees_velocity_along",
    "velocity across the motion": "nees_velocity_across",
}
#: The points of chi-square beyond which a NEES is counted, by name, with the share that lies beyond.
BEYOND = {"95 %": 0.05, "99 %": 0.01, "99.9 %": 0.001}


@cache
def beyond_points(dof: int) -> tuple[float, ...]:
    """Those points."""
    return tuple(float(2 * gammaincinv(dof / 2, 1.0 - share)) for share in BEYOND.values())


@cache
def point95(dof: int) -> float:
    """The 95 % point of chi-square."""
    return float(2 * gammaincinv(dof / 2, 0.95))
