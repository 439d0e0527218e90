"""Angles, and the units in which the outside world states them."""

from __future__ import annotations

import numpy as np

from trackbench.base.types import Array

TWO_PI = 2.0 * np.pi
PER_TURN = 1.0 / TWO_PI
#: The least angle of the range (-pi, pi].
LEAST = np.nextafter(-np.pi, 0.0)


def wrap_angle(angle: Array) -> Array:
    """Any angle in rad, to the same direction in (-pi, pi]."""
    turned = angle - TWO_PI * np.ceil((angle - np.pi) * PER_TURN)
    # Rounding may leave the range by a unit in the last place.
    return np.clip(turned, LEAST, np.pi)


def difference(a: Array, b: Array, angular: tuple[int, ...]) -> Array:
    """``a - b`` along the first axis, with the components named in ``angular`` wrapped to (-pi, pi]."""
    result = a - b
    for i in angular:
        result[i] = wrap_angle(result[i])
    return result


def cos_sin(angle: Array) -> tuple[Array, Array]:
    """Cosine and sine; of arrays from the tangent of half the angle.

    NumPy has vector instructions for the tangent but not for a sine of doubles: this is five times faster, and agrees
    to a few units in the last place of one.
    """
    if not isinstance(angle, np.ndarray | float):
        return np.cos(angle), np.sin(angle)
    t = np.tan(0.5 * angle)
    square = t * t
    scale = 1.0 / (1.0 + square)
    return (1.0 - square) * scale, 2.0 * t * scale


def exp_minus_one(x: Array) -> Array:
    """``exp(x) - 1`` without the loss of digits at small ``x``, from functions that the fused engine has.

    Source: Kahan, as Higham (2002), "Accuracy and stability of numerical algorithms", section 1.14.1.
    """
    power = np.exp(x)
    lost = power == 1.0
    return np.where(lost, x, (power - 1.0) * x / np.log(np.where(lost, 2.0, power)))
