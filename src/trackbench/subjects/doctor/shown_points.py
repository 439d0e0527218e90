"""Sigma points that do to an estimate what a tracker's own do: drawn where the sums over its points are wrong.

The tracker's own points are not known. Those drawn are the ``2 n`` points of weight ``1 / (2 n)`` at the mean plus and
minus the columns of ``sqrt(n P)`` (Julier and Uhlmann 2004, with kappa 0), changed by the fault.
"""

from __future__ import annotations

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Estimate
from trackbench.subjects.doctor.exhibits import STATE, Points, Ring

#: Of the state px, py, vx, vy.
COUNT = 8
#: Standard deviations of an ellipse that is drawn.
SIZE = 2.0


def points_shown(before: Estimate, after: Estimate, *, weights: float = 1.0, rows: bool = False) -> Points:
    """The points that an estimate has, and those with the covariance that a prediction over no time makes of it.

    Args:
        before: what the points are drawn from.
        after: what the prediction makes of it.
        weights: the sum of the weights. Where it is wrong the points are right.
        rows: whether the points lie along the rows of the lower Cholesky factor, not along its columns.
    """
    factor = np.asarray(np.linalg.cholesky(linalg.symmetrise(before.covariance)), dtype=float)
    applied: Array = factor if weights != 1.0 else factor.T if rows else _root(after.covariance, factor)
    # The difference of rows from columns is in px, vx: px, py are nearly uncorrelated with each other.
    plane = slice(0, 4, 2) if rows else slice(0, 2)
    names = STATE[plane]
    return Points(
        "Sigma points with the effect that was found",
        (names[0], names[1]),
        "as in the tracker",
        _drawn(before.mean, applied)[plane],
        _ring("covariance after the prediction", after, plane),
        _ring("covariance before it", before, plane),
        _drawn(before.mean, factor)[plane],
        "right",
        (weights / COUNT, 1.0 / COUNT),
    )


def _root(covariance: Array, otherwise: Array) -> Array:
    """The lower Cholesky factor; another one where there is none."""
    p = linalg.symmetrise(covariance)
    return np.asarray(np.linalg.cholesky(p), dtype=float) if np.linalg.eigvalsh(p)[0] > 0.0 else otherwise


def _drawn(mean: Array, factor: Array) -> Array:
    spread = np.sqrt(COUNT / 2) * factor
    return np.asarray(mean[:, None] + np.hstack([spread, -spread]))


def _ring(name: str, estimate: Estimate, plane: slice) -> Ring:
    return Ring(f"{name}, {SIZE:g} sigma", estimate.mean[plane], estimate.covariance[plane, plane], SIZE)
