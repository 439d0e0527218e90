"""Stationary random processes of unit variance, which errors and signals follow: all runs of a block at once."""

from __future__ import annotations

from typing import Literal

import numpy as np

from trackbench.base.scipy_functions import scipy_function
from trackbench.base.types import Array

#: Solution b of (1 + b) exp(-b) = 1/e: the correlation time of a second-order process, in its time constants.
CORRELATION_TIME = 2.1461932206205825


def gauss_markov(time: Array, time_s: float, white: Array, order: Literal[1, 2] = 1) -> Array:
    """Sample a stationary Gauss-Markov process of unit variance, whose autocorrelation is 1/e after ``time_s``.

    The autocorrelation is ``exp(-|t| / time_s)`` of first order. Of second order it is ``(1 + b |t|) exp(-b |t|)`` with
    ``b = 2.146 / time_s``: the process is smooth. Both are exact at any instants, with one draw for each.

    Source: Gelb (1974), "Applied Optimal Estimation", section 3.8.

    Args:
        time: ``(instants,)`` s, increasing.
        time_s: the correlation time, s.
        white: ``(instants, ...)`` draws of a standard normal.
        order: of the process.

    Returns:
        ``(instants, ...)``.
    """
    steps = (np.diff(time) / time_s).reshape(-1, *(1,) * (white.ndim - 1))
    if order == 2:
        return smooth_process(steps, white)
    decay, driven = np.exp(-steps), np.array(white, order="C")
    driven[1:] *= np.sqrt(1.0 - decay * decay)
    return autoregression(decay, driven)


def smooth_process(steps: Array, white: Array) -> Array:
    """Sample a second-order Gauss-Markov process of unit variance, whose autocorrelation is 1/e over a length of 1.

    Args:
        steps: ``(instants - 1, ...)`` lengths from one instant to the next, of as many axes as ``white``.
        white: ``(instants, ...)`` draws of a standard normal.

    Returns:
        ``(instants, ...)``.
    """
    steps = CORRELATION_TIME * steps
    of_value, of_slope = _innovations(steps)
    decay = np.exp(-steps)
    driven = np.array(white, order="C")
    slope = autoregression(decay, driven * of_slope)[:-1]
    slope *= steps * decay
    driven *= of_value
    driven[1:] += slope
    return autoregression(decay, driven)


def autoregression(decay: Array, driven: Array) -> Array:
    """Compute ``x_k = decay_k-1 x_k-1 + driven_k`` in place of ``driven``, and return it.

    Args:
        decay: ``(instants - 1, ...)`` of as many axes as ``driven``.
        driven: ``(instants, ...)`` innovations, overwritten by the process.
    """
    kept = np.empty(driven.shape[1:])
    for k, factor in enumerate(decay):
        np.multiply(driven[k], factor, out=kept)
        driven[k + 1] += kept
    return driven


def _innovations(steps: Array) -> Array:
    """Return the weights with which each draw enters a second-order process x and ``z = x + x' / b``.

    Over a step h of ``b t`` they follow ``x <- e^-h (x + h z)`` and ``z <- e^-h z`` beside noise, with variances 1 and
    2 and covariance 1. A Kalman filter that observes x alone has the draws as its innovations.
    """
    gammainc = scipy_function("scipy.special", "_ufuncs", "gammainc")
    square = np.exp(-2.0 * steps)
    # Noise covariance: the incomplete gamma functions keep the digits that a difference of small numbers would lose.
    of_x, of_both, of_z = np.maximum(gammainc(3.0, 2.0 * steps), 1e-300), gammainc(2.0, 2.0 * steps), 2.0 - 2.0 * square
    weights = np.ones((2, len(steps) + 1, *steps.shape[1:]))
    variance = np.ones(steps.shape[1:])
    for k in range(len(steps)):
        kept = square[k] * variance
        moved = steps[k] * kept
        deviation = np.sqrt(of_x[k] + steps[k] * moved)
        gain = (of_both[k] + moved) / deviation
        weights[:, k + 1] = deviation, gain
        variance = np.maximum(of_z[k] + kept - gain * gain, 0.0)
    return weights
