"""Robust standard deviations, and the noise of a recorded truth."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from trackbench.base.types import Array, RecordedNoise
from trackbench.truth.recorded.drive import Motion

#: Density of a standard normal variable at 3, relative to its probability of lying between -3 and 3.
EDGE = math.exp(-4.5) / math.sqrt(2 * math.pi) / math.erf(3 / math.sqrt(2))
#: Variance of a standard normal variable truncated at three standard deviations.
KEPT = 1 - 6 * EDGE


def clipped(residual: Array, added: Array | float = 0.0) -> tuple[Array, Array]:
    """Return mean and standard deviation, ``(..., 1)``, of the values within three standard deviations.

    Args:
        residual: ``(..., rows)`` values; NaN are ignored.
        added: known variance of each value, which the standard deviation leaves out (Fisher scoring).
    """
    middle = np.nanmedian(residual, axis=-1, keepdims=True)
    rough = 1.4826 * np.nanmedian(np.abs(residual - middle), axis=-1, keepdims=True)
    usual_added = np.nanmedian(np.broadcast_to(added, residual.shape), axis=-1, keepdims=True)
    variance = np.maximum(rough**2 - usual_added, 0.0)
    for _ in range(20):
        total = np.maximum(variance + added, 1e-300)
        is_inside = np.abs(residual - middle) <= 3 * np.sqrt(total)
        weight = np.where(is_inside, np.nanmin(total, axis=-1, keepdims=True) / total, 0.0)
        middle = _weighted_mean(residual, weight, middle)
        variance = np.maximum(_weighted_mean((residual - middle) ** 2 / KEPT - added, weight**2, variance), 0.0)
    return middle, np.sqrt(variance)


def clipped_sigma(residual: Array) -> Array:
    """Return the standard deviation over the last axis of the values within three standard deviations."""
    return np.asarray(clipped(residual)[1][..., 0])


def residual_scale(residual: Array, added: Array) -> Array:
    """Return the standard deviation of each residual, ``(m, rows)``, never zero, so that it can be a divisor.

    Args:
        residual: ``(m, rows)`` residuals.
        added: ``(m, rows)`` variance of each residual that comes from the reference.
    """
    sigma = np.sqrt(clipped(residual, added)[1] ** 2 + added)
    reach = np.nanmax(np.abs(residual), axis=-1, keepdims=True)
    return np.asarray(np.maximum(np.maximum(sigma, 1e-9 * reach), 1e-12))


def _weighted_mean(values: Array, weight: Array, otherwise: Array) -> Array:
    products = np.where(weight > 0, weight * values, 0.0)
    whole = weight.sum(axis=-1, keepdims=True)
    return np.where(whole > 0, products.sum(axis=-1, keepdims=True) / np.where(whole > 0, whole, 1.0), otherwise)


#: Weights of four rows in a third difference, which removes position, velocity and acceleration.
THIRD = np.array([1.0, -3.0, 3.0, -1.0])


def white_sigma(values: Array) -> float:
    """Return the standard deviation of white noise on slowly varying ``values`` ``(k, rows)``, by third differences.

    Source: Rice (1984), "Bandwidth choice for nonparametric regression", with higher differences.
    """
    if values.shape[-1] <= 2 * len(THIRD):
        return 0.0
    differences = np.diff(values, 3).reshape(-1) / np.linalg.norm(THIRD)
    return float(clipped_sigma(differences))


def travelled(motion: Motion) -> Array:
    """Return the stated velocity integrated from the first row (trapezoidal rule), ``(2, rows)`` m."""
    velocity = np.stack([motion.vx, motion.vy])
    steps = 0.5 * (velocity[:, 1:] + velocity[:, :-1]) * np.diff(motion.time)
    return np.concatenate([np.zeros((2, 1)), np.cumsum(steps, axis=1)], axis=1)


def body_sigmas(motion: Motion) -> tuple[float, float]:
    """Return the standard deviations, per axis, of the noise on a body's position, m, and velocity, m/s."""
    position, velocity = np.stack([motion.px, motion.py]), np.stack([motion.vx, motion.vy])
    if len(motion.time) > 1 and np.allclose(velocity, np.gradient(position, motion.time, axis=1)):
        # The velocity was computed from the positions and has their noise.
        sigma = white_sigma(position)
        return sigma, sigma / float(np.sqrt(2) * np.median(np.diff(motion.time)))
    # Relative to the integrated velocity, so that rows may be far apart.
    return white_sigma(position - travelled(motion)), white_sigma(velocity)


def noise_of_motions(motions: Iterable[Motion]) -> RecordedNoise:
    """Return the noise of position and velocity, per axis: RMS standard deviation over the rows of all objects."""
    motions = list(motions)
    squares = np.square([body_sigmas(motion) for motion in motions])
    return RecordedNoise(*np.sqrt(np.average(squares, axis=0, weights=[len(m.time) for m in motions])).tolist())
