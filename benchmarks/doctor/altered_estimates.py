"""Means ``(4, ...)`` and covariances ``(4, 4, ...)`` with an error: one function for each mistake."""

from __future__ import annotations

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array

SAMPLES = 200


def velocity_beside_position(mean: Array, covariance: Array) -> tuple[Array, Array]:
    """In the order px, vx, py, vy."""
    order = [0, 2, 1, 3]
    return mean[order], covariance[order][:, order]


def velocity_in_kmh(mean: Array, covariance: Array) -> tuple[Array, Array]:
    scale = np.array([1.0, 1.0, 3.6, 3.6])
    return mean * linalg.expand(scale, mean), covariance * linalg.expand(np.outer(scale, scale), covariance)


def covariance_beside(mean: Array, covariance: Array) -> tuple[Array, Array]:
    """The covariance alone in the order px, vx, py, vy."""
    order = [0, 2, 1, 3]
    return mean, covariance[order][:, order]


def diagonal_alone(mean: Array, covariance: Array) -> tuple[Array, Array]:
    """The variances, and zeros beside them."""
    return mean, covariance * linalg.expand(np.eye(4), covariance)


def constant(mean: Array, covariance: Array) -> tuple[Array, Array]:
    """Always the same covariance."""
    return mean, 0.0 * covariance + linalg.expand(np.diag([0.04, 0.04, 1.0, 1.0]), covariance)


def upper_triangle_scaled(mean: Array, covariance: Array) -> tuple[Array, Array]:
    upper = np.triu(np.full((4, 4), 1e-3), 1)
    return mean, covariance * linalg.expand(1.0 + upper, covariance)


def one_entry_left(mean: Array, covariance: Array) -> tuple[Array, Array]:
    """The covariance of px and vx, right in one of its two entries only."""
    changed = covariance.copy()
    changed[0, 2] = 0.9 * covariance[2, 0]
    return mean, changed


def correlations_doubled(mean: Array, covariance: Array) -> tuple[Array, Array]:
    """Covariances doubled, as if the two triangles had been added."""
    return mean, covariance * linalg.expand(2.0 - np.eye(4), covariance)


def smallest_eigenvalue_negated(mean: Array, covariance: Array) -> tuple[Array, Array]:
    """The smallest eigenvalue negated, as by cancellation."""
    values, vectors = np.linalg.eigh(np.nan_to_num(np.moveaxis(covariance, (0, 1), (-2, -1))))
    least = vectors[..., :, 0]
    flipped = 2 * values[..., 0, None, None] * least[..., :, None] * least[..., None, :]
    return mean, covariance - np.moveaxis(flipped, (-2, -1), (0, 1))


def sampled(mean: Array, covariance: Array) -> tuple[Array, Array]:
    """The moments of samples from the estimate, by an unseeded generator."""
    normal = np.random.default_rng().standard_normal((4, SAMPLES, *mean.shape[1:]))
    spread = linalg.matmul(linalg.cholesky(covariance).lower(), normal)
    centre = spread.mean(axis=1)
    apart = spread - centre[:, None]
    return mean + centre, linalg.matmul_transposed(apart, apart) / (SAMPLES - 1)
