"""Stationary random processes of unit variance for errors and signals, drawn for all runs of a block in one call."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy.special import gammainc

from trackbench.base.types import Array

#: Solution b of (1 + b) exp(-b) = 1/e: the correlation time of a second-order process, in its time constants.
CORRELATION_TIME = 2.1461932206205825
#: Number of instants, a spell, over which innovations are summed in one step.
SPELL = 16
#: Longest step, in time constants: the autocorrelation is at most 2e-16 there, and over a spell ``exp`` stays finite.
LONGEST_STEP = 40.0


def gauss_markov(time: Array, time_s: float, white: Array, order: Literal[1, 2] = 1) -> Array:
    """Sample a stationary Gauss-Markov process of unit variance, whose autocorrelation is 1/e after ``time_s``.

    The autocorrelation is ``exp(-|t| / time_s)`` for order 1. For order 2 it is ``(1 + b |t|) exp(-b |t|)`` with ``b =
    2.146 / time_s``: the process is smooth. Both are exact at any instants, with one draw per instant.

    Source: Gelb (1974), "Applied Optimal Estimation", section 3.8.

    Args:
        time: ``(instants,)`` s, increasing.
        time_s: correlation time, s.
        white: ``(instants, ...)`` draws of a standard normal.
        order: order of the process.

    Returns:
        ``(instants, ...)``.
    """
    steps = (np.diff(time) / time_s).reshape(-1, *(1,) * (white.ndim - 1))
    return smooth_process(steps, white) if order == 2 else _process(steps, white, order)


def smooth_process(steps: Array, white: Array) -> Array:
    """Sample a second-order Gauss-Markov process of unit variance, whose autocorrelation is 1/e at a distance of 1.

    Args:
        steps: ``(instants - 1, ...)`` distances of consecutive instants, in correlation lengths, with as many axes as
            ``white``.
        white: ``(instants, ...)`` draws of a standard normal.

    Returns:
        ``(instants, ...)``.
    """
    return _process(CORRELATION_TIME * steps, white, 2)


def _process(steps: Array, white: Array, order: int) -> Array:
    draw_weights, sum_weights = _weights(steps.tobytes(), steps.shape, order)
    process, state = np.empty(white.shape), np.zeros((order, *white.shape[1:]))
    for first in range(0, len(white), SPELL):
        spell = slice(first, first + SPELL)
        sums = draw_weights[spell] * np.array(white[spell, None], order="C")
        sums[0] += state
        for earlier, later in pairwise(sums):
            later += earlier
        state = sum_weights[spell][-1, 0] * sums[-1]
        sums *= sum_weights[spell]
        state[0] = np.sum(sums, axis=1, out=process[spell])[-1]
    return process


@lru_cache(maxsize=8)
def _weights(steps: bytes, shape: tuple[int, ...], order: int) -> tuple[Array, Array]:
    """Return the weight of each draw in the sum over its spell of ``SPELL`` instants, and of each sum in the process.

    Without innovations a process of first order follows ``x <- e^-h x``, a process of second order ``x <- e^-h (x + h
    z)`` and ``z <- e^-h z``. A length t after the instant before the spell, ``e^t (x - t z)`` and ``e^t z`` are sums of
    the innovations' contributions.
    """
    lengths = np.minimum(np.frombuffer(steps).reshape(shape), LONGEST_STEP)
    reached = np.concatenate([np.zeros((1, *shape[1:])), lengths])
    for k in range(1, SPELL):
        reached[k::SPELL] += reached[k - 1 :: SPELL][: len(reached[k::SPELL])]
    decay = np.exp(-reached)[:, None]
    if order == 1:
        innovations = np.sqrt(-np.expm1(-2.0 * lengths))[:, None]
        return np.concatenate([np.ones((1, 1, *shape[1:])), innovations]) / decay, decay
    draw_weights = _innovations(lengths) / decay
    draw_weights[:, 0] -= reached * draw_weights[:, 1]
    return draw_weights, np.concatenate([decay, reached[:, None] * decay], axis=1)


def _innovations(steps: Array) -> Array:
    """Return the weights of each instant's draws in a second-order process x and in ``z = x + x' / b``.

    Over a step h of ``b t`` they follow ``x <- e^-h (x + h z)`` and ``z <- e^-h z`` plus noise, with variances 1 and 2
    and covariance 1. The draws are the innovations of a Kalman filter that observes x alone.
    """
    square = np.exp(-2.0 * steps)
    # Noise covariance. Incomplete gamma functions keep digits that a difference of small numbers would lose.
    x_noise, xz_noise = np.maximum(gammainc(3.0, 2.0 * steps), 1e-300), gammainc(2.0, 2.0 * steps)
    z_noise = 2.0 - 2.0 * square
    weights = np.ones((len(steps) + 1, 2, *steps.shape[1:]))
    variance = np.ones(steps.shape[1:])
    for k in range(len(steps)):
        decayed = square[k] * variance
        moved = steps[k] * decayed
        deviation = np.sqrt(x_noise[k] + steps[k] * moved)
        gain = (xz_noise[k] + moved) / deviation
        weights[k + 1] = deviation, gain
        variance = np.maximum(z_noise[k] + decayed - gain * gain, 0.0)
    return weights
