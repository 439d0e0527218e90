"""Errors and NEES of each estimate, as functions of components that any engine computes."""

from __future__ import annotations

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Mask
from trackbench.engine.equations import Equations, Values
from trackbench.engine.layout import ADDED, SUMMED
from trackbench.metrics.consistency import beyond_points
from trackbench.metrics.sums import ERROR, OVERFLOW

#: Smallest determinant of a 2 by 2 covariance as a share of the product of its variances, and smallest variance in a
#: direction as a share of their sum; anything smaller is rounding.
SMALLEST_DETERMINANT = 1e-14


def _given(values: Values) -> Values:
    # A sum is finite only if all of its terms are; a covariance with finite variances and other entries that are not
    # is not positive definite.
    mean, covariance = values["mean"], values["covariance"]
    total = mean.sum(axis=0) + (covariance[0, 0] + covariance[1, 1] + covariance[2, 2] + covariance[3, 3])
    none = np.isnan(mean[0]) & np.isnan(mean[1]) & np.isnan(mean[2]) & np.isnan(mean[3])
    return {"finite": np.isfinite(total), "given": ~none}


#: Masks of an estimate: ``finite``, and ``given``, which is False for a state of NaN.
GIVEN = Equations("given estimate", _given, {"mean": 1, "covariance": 2})


def _errors(values: Values) -> Values:
    covariance, finite, scored = (values[name] for name in ("covariance", "finite", "scored"))
    if not np.all(finite):
        # Any positive definite covariance passes the check.
        covariance = np.where(finite, covariance, linalg.expand(np.eye(4), covariance))
    rows, definite = _rows(values["mean"], covariance, values["truth"], values["reference"], finite)
    if not np.all(scored):
        rows = np.where(scored, rows, 0.0)
    return {"rows": rows, "definite": definite, "bounded": rows.max(axis=0) < OVERFLOW}


def _rows(mean: Array, covariance: Array, truth: Array, reference: Array, finite: Mask) -> tuple[Array, Mask]:
    error = mean - truth
    factor = linalg.cholesky(covariance)
    whitened = factor.whiten(error)
    # The first two whitened components depend on the position alone.
    nees_of_position = whitened[0] * whitened[0] + whitened[1] * whitened[1]
    nees = nees_of_position + whitened[2] * whitened[2] + whitened[3] * whitened[3]
    nees_of_velocity = _nees_of_velocity(error * error, error[2] * error[3], covariance)
    directions = _nees_of_directions(error, truth, covariance)
    given = np.where(finite, 1.0, 0.0)
    if not np.all(finite):
        nees, nees_of_position, nees_of_velocity, *directions = (
            np.where(finite, each, 0.0) for each in (nees, nees_of_position, nees_of_velocity, *directions)
        )
    squares = error * error
    rows = linalg.vector([1.0, *squares, nees, nees_of_position, nees_of_velocity, *directions, *reference, given])
    return rows, factor.positive


def _scores(values: Values) -> Values:
    mean, covariance, truth = (values[name] for name in ("mean", "covariance", "truth"))
    rows, definite = _rows(mean, covariance, truth, values["reference"], np.ones((), dtype=bool))
    squares = linalg.vector([rows[1] + rows[2], rows[3] + rows[4]])
    bounded = ~values["due"] | (rows.max(axis=0) < OVERFLOW)
    rows = np.where(values["due"], rows, 0.0)
    beyond = [np.where(rows[ERROR["nees"]] > point, 1.0, 0.0) for point in beyond_points(4)]
    return {
        "per_step": rows,
        "by_class": np.concatenate([rows, linalg.vector(beyond)]),
        "squares": np.where(values["due"], squares, 0.0),
        "definite": definite & np.isfinite(mean.sum(axis=0)),
        "bounded": bounded,
    }


#: Scores of a finite estimate in a sequence of calls: terms of the sums where it is ``due``, terms of the sums of its
#: class with the points that its NEES is beyond, and squared errors of position and velocity.
SCORES = Equations(
    "scores of an estimate",
    _scores,
    {"mean": 1, "covariance": 2, "truth": 1, "reference": 1, "due": 0},
    frozenset({"covariance"}),
    modes={"per_step": SUMMED, "by_class": ADDED},
)


def _nees_of_velocity(squares: Array, product: Array, covariance: Array) -> Array:
    a, b, d = covariance[2, 2], covariance[3, 2], covariance[3, 3]
    variances = a * d
    determinant = np.maximum(variances - b * b, SMALLEST_DETERMINANT * variances)
    nees: Array = (d * squares[2] + a * squares[3] - 2.0 * (b * product)) / determinant
    return nees


def _nees_of_directions(error: Array, truth: Array, covariance: Array) -> list[Array]:
    """Return the NEES along and across the true velocity, of position, then velocity; along x at a standstill."""
    speed = np.sqrt(truth[2] * truth[2] + truth[3] * truth[3])
    moves = speed > 0
    over = 1.0 / np.where(moves, speed, 1.0)
    c, s = np.where(moves, truth[2] * over, 1.0), truth[3] * over
    directions: list[Array] = []
    for x, y in ((0, 1), (2, 3)):
        along, across = c * error[x] + s * error[y], c * error[y] - s * error[x]
        total = covariance[x, x] + covariance[y, y]
        variance = (c * c) * covariance[x, x] + (2.0 * c * s) * covariance[y, x] + (s * s) * covariance[y, y]
        least = SMALLEST_DETERMINANT * total
        directions += [
            along * along / np.maximum(variance, least),
            across * across / np.maximum(total - variance, least),
        ]
    return directions


#: Errors of an estimate, which a charged state replaces unless it is ``finite``: ``rows`` as ERROR_FIELDS, zero unless
#: ``scored``; ``definite``: whether the covariance is positive definite; ``bounded``: whether squares can be summed.
ERRORS = Equations(
    "errors of an estimate", _errors, {"mean": 1, "covariance": 2, "truth": 1, "reference": 1, "finite": 0, "scored": 0}
)
