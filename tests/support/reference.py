"""Textbook filters for one target, written with numpy.linalg: what the batched ones are compared with.

A function ``residual(a, b)`` is ``a - b`` with its angles wrapped.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import least_squares

from trackbench.filters.base import B, Filter

Residual = Callable[[np.ndarray, np.ndarray], np.ndarray]
Function = Callable[[np.ndarray], np.ndarray]


def residual(angular: tuple[int, ...]) -> Residual:
    """``a - b`` of vectors whose components named in ``angular`` are angles."""

    def subtract(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        d = np.asarray(a - b, dtype=float)
        for i in angular:
            d[i] = np.arctan2(np.sin(d[i]), np.cos(d[i]))
        return d

    return subtract


def predict(x, p, f, jacobian, q):
    """Kalman and extended Kalman filter, time update."""
    return f(x), jacobian @ p @ jacobian.T + q


def update(x, p, innovation, h, r):
    """Kalman and extended Kalman filter, measurement update in Joseph's form; also the innovation's covariance."""
    s = h @ p @ h.T + r
    k = p @ h.T @ np.linalg.inv(s)
    i_kh = np.eye(len(x)) - k @ h
    return x + k @ innovation, i_kh @ p @ i_kh.T + k @ r @ k.T, s


def most_probable(x, p, z, h: Function, r, subtract: Residual):
    """The state of greatest posterior density, to which the iterated extended Kalman filter converges."""
    prior, noise = np.linalg.inv(np.linalg.cholesky(p)), np.linalg.inv(np.linalg.cholesky(r))

    def cost(state):
        return np.concatenate([prior @ (state - x), noise @ subtract(z, h(state))])

    return least_squares(cost, x, method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15).x


def sigma_points(x, p, spread):
    """Central point, then one and the other of each pair at ``spread`` standard deviations; ``(n, 2 n + 1)``."""
    columns = spread * np.linalg.cholesky(p)
    return np.column_stack([x, x[:, None] + columns, x[:, None] - columns])


def weights(n, alpha, beta, kappa):
    """InitialSigmas in standard deviations, weights of the mean, weights of the covariance (scaled sigma points)."""
    lam = alpha**2 * (n + kappa) - n
    mean = np.full(2 * n + 1, 0.5 / (n + lam))
    mean[0] = lam / (n + lam)
    covariance = mean.copy()
    covariance[0] += 1 - alpha**2 + beta
    return np.sqrt(n + lam), mean, covariance


def moments(points, mean_weights, covariance_weights, subtract: Residual):
    """Mean and deviations; the mean is taken as offsets from the central point."""
    offsets = np.column_stack([subtract(point, points[:, 0]) for point in points.T])
    mean = points[:, 0] + offsets @ mean_weights
    deviations = np.column_stack([subtract(point, mean) for point in points.T])
    return mean, deviations, (deviations * covariance_weights) @ deviations.T


def unscented_predict(x, p, f: Function, gain: Function, sigma, subtract: Residual, rule, augmented):
    """Time update; with ``augmented`` also the moved points, through which the measurement update goes."""
    n, q = len(x), len(sigma)
    noise = np.diag(np.square(sigma))
    if not augmented:
        spread, wm, wc = weights(n, *rule)
        moved = np.column_stack([f(point) for point in sigma_points(x, p, spread).T])
        mean, _, covariance = moments(moved, wm, wc, subtract)
        return mean, covariance + gain(x) @ noise @ gain(x).T, None
    big = np.zeros((n + q, n + q))
    big[:n, :n], big[n:, n:] = p, noise
    spread, wm, wc = weights(n + q, *rule)
    points = sigma_points(np.concatenate([x, np.zeros(q)]), big, spread)
    moved = np.column_stack([f(point[:n]) + gain(point[:n]) @ point[n:] for point in points.T])
    mean, _, covariance = moments(moved, wm, wc, subtract)
    return mean, covariance, moved


def unscented_update(x, p, points, z, h: Function, r, subtract_x: Residual, subtract_z: Residual, rule):
    """Measurement update with the given points, or with points drawn from ``x`` and ``p`` if there are none."""
    n = len(x) if points is None else (points.shape[1] - 1) // 2
    spread, wm, wc = weights(n, *rule)
    points = sigma_points(x, p, spread) if points is None else points
    seen = np.column_stack([h(point) for point in points.T])
    expected, deviations, spread_seen = moments(seen, wm, wc, subtract_z)
    s = spread_seen + r
    state_deviations = np.column_stack([subtract_x(point, x) for point in points.T])
    k = (state_deviations * wc) @ deviations.T @ np.linalg.inv(s)
    innovation = subtract_z(z, expected)
    return x + k @ innovation, p - k @ s @ k.T, innovation, s


def smoothed(filter: Filter[B], filtered: Sequence[B], intervals: Sequence[float]) -> list[B]:
    """A filter's beliefs given all measurements, from the last to the first.

    Args:
        filter: the one that gave the beliefs.
        filtered: ``(T,)`` after the update of each instant; those with batch axes are smoothed together.
        intervals: ``(T - 1,)`` from each instant to the next, s.
    """
    result = [filtered[-1]]
    for belief, dt in zip(reversed(filtered[:-1]), reversed(intervals), strict=True):
        result.append(filter.smooth(belief, result[-1], dt))
    return result[::-1]
