"""Standard deviations from the values near the middle, of rows to whose noise that of the reference is added."""

from __future__ import annotations

import numpy as np

from trackbench.base.distributions import normal_density, normal_within
from trackbench.base.types import Array

#: Variance of a standard normal variable within three standard deviations.
KEPT = 1 - 6 * normal_density(3) / normal_within(3)


def clipped(residual: Array, added: Array | float = 0.0) -> tuple[Array, Array]:
    """Middle and standard deviation ``(..., 1)`` of a normal distribution, from the values within three of it.

    Args:
        residual: ``(..., rows)``; NaN is left out.
        added: variance of each value beside that which is looked for; what is near it is what remains (Fisher scoring).
    """
    middle = np.nanmedian(residual, axis=-1, keepdims=True)
    rough = 1.4826 * np.nanmedian(np.abs(residual - middle), axis=-1, keepdims=True)
    usual = np.nanmedian(np.broadcast_to(added, residual.shape), axis=-1, keepdims=True)
    variance = np.maximum(rough**2 - usual, 0.0)
    for _ in range(20):
        total = np.maximum(variance + added, 1e-300)
        inside = np.abs(residual - middle) <= 3 * np.sqrt(total)
        weight = np.where(inside, np.nanmin(total, axis=-1, keepdims=True) / total, 0.0)
        middle = _mean(residual, weight, middle)
        variance = np.maximum(_mean((residual - middle) ** 2 / KEPT - added, weight**2, variance), 0.0)
    return middle, np.sqrt(variance)


def clipped_sigma(residual: Array) -> Array:
    """The standard deviation ``(...)`` alone."""
    return np.asarray(clipped(residual)[1][..., 0])


def residual_scale(residual: Array, added: Array) -> Array:
    """Standard deviations ``(m, rows)``, never zero, so that a component without noise does not divide by it.

    Args:
        residual: ``(m, rows)``.
        added: ``(m, rows)`` variance from the reference.
    """
    sigma = np.sqrt(clipped(residual, added)[1] ** 2 + added)
    reach = np.nanmax(np.abs(residual), axis=-1, keepdims=True)
    return np.asarray(np.maximum(np.maximum(sigma, 1e-9 * reach), 1e-12))


def _mean(values: Array, weight: Array, otherwise: Array) -> Array:
    """Weighted mean along the last axis, or another value where all weights vanish; NaN has no weight."""
    products = np.where(weight > 0, weight * values, 0.0)
    whole = weight.sum(axis=-1, keepdims=True)
    return np.where(whole > 0, products.sum(axis=-1, keepdims=True) / np.where(whole > 0, whole, 1.0), otherwise)
