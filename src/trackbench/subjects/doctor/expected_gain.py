"""The right gain of a trial, and the measurement model that a tracker's gain implies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Mask
from trackbench.subjects.doctor.trial import Trial


def linearised_gain(trial: Trial, used: Mask | None = None) -> Array:
    """Return the gain ``(4, m)`` of an EKF; columns of components not in the mask ``used`` ``(m,)`` are zero."""
    p = linalg.symmetrise(trial.prediction.covariance)
    cross = p @ trial.jacobian.T
    return _gain(cross, trial.jacobian @ cross + trial.scan.noise_covariance, used)


def gaussian_gain(trial: Trial, used: Mask | None = None) -> Array:
    """Return the gain ``(4, m)`` by the exact moments of a Gaussian prediction, which sigma points approximate."""
    cross, covariance = trial.gaussian_moments
    return _gain(cross, covariance + trial.scan.noise_covariance, used)


def gain_error(trial: Trial, applied: Array, used: Mask | None = None) -> tuple[float, Array]:
    """Return the relative error of the gain ``applied`` ``(4, m)``, and the right gain that is nearest to it.

    The gain of an EKF and the Gaussian one are right. Gains are scaled by the sigmas of prediction and measurement.
    """
    return min(
        (
            (relative_error(applied, right, trial.gain_scale), right)
            for right in (linearised_gain(trial, used), gaussian_gain(trial, used))
        ),
        key=lambda error: error[0],
    )


def relative_error(applied: Array, right: Array, scale: Array) -> float:
    """Return the relative error of a matrix in the Frobenius norm, with its entries multiplied by ``scale``."""
    return float(np.linalg.norm((applied - right) * scale) / np.linalg.norm(right * scale))


def _gain(cross: Array, innovation_covariance: Array, used: Mask | None) -> Array:
    columns = np.ones(len(innovation_covariance), dtype=bool) if used is None else used
    gain = np.zeros(cross.shape)
    gain[:, columns] = np.linalg.solve(innovation_covariance[np.ix_(columns, columns)], cross[:, columns].T).T
    return gain


#: Largest share of the change of the covariance outside the column space of the gain. Sigma points have up to 0.01,
#: fixed gains have 0.08 and more.
OUTSIDE = 0.05


#: Correlation of the implied noise of two components above which that noise is not diagonal.
MIXED = 0.1
#: Speed of targets across the line of sight, m/s.
ACROSS = 20.0


class ImpliedModel(NamedTuple):
    """Jacobian and measurement noise that one update of the tracker implies, compared with the right ones."""

    trial: Trial
    used: Mask
    noise: Array
    """Implied divided by stated noise variances ``(m,)``. NaN for an unused component, and where the implied row of the
    Jacobian is at 90 degrees or more to the right row."""
    direction_difference: Array
    """Unit vector along each row of the implied Jacobian, minus the one along the right row ``(m, 4)``."""
    size: Array
    """Length ``(m,)`` of each implied Jacobian row along the right row, divided by the right row's length."""
    jacobian: Array
    """Implied Jacobian ``(m, 4)`` of the measurement with respect to the state."""
    own_noise: Array
    """Noise variances ``(m,)``, divided by the stated ones, with which the implied Jacobian gives the applied gain."""
    noise_correlation: float = 0.0
    """Largest absolute correlation between two components of the implied noise; 0 for the stated noise."""

    @property
    def direction(self) -> Array:
        """Error ``(m,)`` of each implied row's direction: 0 for the right direction, 2 for the opposite one."""
        return np.asarray(np.linalg.norm(self.direction_difference, axis=1))


class SamplingErrors(NamedTuple):
    """Standard errors of implied models by the tracker's random samples; zeros for a tracker without samples."""

    direction: Array
    """Standard error ``(m,)`` of ``ImpliedModel.direction``, the length of a difference of unit vectors."""
    size: Array
    """Standard error ``(m,)`` of the logarithm of the ``size`` of each row of the implied Jacobian."""
    noise: Array
    """Standard error ``(m,)`` of the logarithm of each component's noise, which is the median over the trials."""


def implied_model(trial: Trial) -> ImpliedModel | None:
    """Return Jacobian and noise of the Kalman filter that makes the tracker's update; None if there is no such filter.

    The update with a measurement equal to the predicted one is taken: its gain and covariance determine both matrices.
    """
    update = trial.update(trial.predicted_measurement)
    if update is None or update.information is None or not update.used.any():
        return None
    # In a Kalman filter the covariance changes only in the column space of the gain; with a fixed gain it does not.
    change = (trial.prediction.covariance - update.estimate.covariance) / trial.variance_scale
    base = np.linalg.qr(update.relative_gain[:, update.used])[0]
    outside, changed = change - base @ (base.T @ change), float(np.linalg.norm(change))
    if not (changed > 1e-9 and float(np.linalg.norm(outside)) < OUTSIDE * changed):
        return None
    h, spread, sigma = trial.jacobian, trial.state_sigma, trial.sigma
    scaled, rows = h * spread, update.information.T * spread
    along, length = np.einsum("ij,ij->i", rows, scaled), np.einsum("ij,ij->i", scaled, scaled)
    noise, size = np.full(len(sigma), np.nan), np.full(len(sigma), np.nan)
    direction_difference, jacobian = np.full_like(h, np.nan), np.full_like(h, np.nan)
    before = linalg.symmetrise(trial.prediction.covariance)
    if not np.linalg.eigvalsh(before)[0] > 0.0:
        return None
    added = np.linalg.inv(linalg.symmetrise(update.estimate.covariance)) - np.linalg.inv(before)
    used = update.used
    jacobian[used] = np.linalg.pinv(update.information[:, used], rcond=1e-9) @ added
    precision = np.linalg.pinv(jacobian[used].T * spread[:, None], rcond=1e-9) @ rows[used].T
    implied_noise: Array = np.asarray(np.linalg.pinv(precision, rcond=1e-12), dtype=float)
    own_noise = np.full(len(sigma), np.nan)
    own_noise[used] = np.diag(implied_noise) / sigma[used] ** 2
    correlation = float(np.abs(np.triu(_to_correlations(implied_noise), 1)).max())
    if correlation > MIXED:
        # The columns of H^T R^-1 are mixtures of the rows of H.
        rows = jacobian * spread
    for i in np.flatnonzero(used):
        direction_difference[i] = rows[i] / np.linalg.norm(rows[i]) - scaled[i] / np.sqrt(length[i])
        size[i] = float((jacobian[i] * spread) @ scaled[i] / length[i])
        if along[i] > 0.0:
            noise[i] = length[i] / along[i] / sigma[i] ** 2
    return ImpliedModel(trial, used, noise, direction_difference, size, jacobian, own_noise, correlation)


def _to_correlations(matrix: Array) -> Array:
    sigma = np.sqrt(np.maximum(np.abs(np.diag(matrix)), np.finfo(float).tiny))
    return np.asarray(matrix / np.outer(sigma, sigma))


def variance_of_ray(components: Sequence[str], sigma: Array) -> Array:
    """Return noise variances ``(m,)``, divided by stated ones, if a filter projects velocities on the measured ray.

    An azimuth error turns the ray: the range rate then has a part of a target's velocity across it (20 m/s here).
    """
    factors = np.ones(len(sigma))
    if {"azimuth", "range_rate"} <= set(components):
        azimuth, rate = (components.index(name) for name in ("azimuth", "range_rate"))
        factors[rate] += (ACROSS * sigma[azimuth] / sigma[rate]) ** 2
    return factors


def average(
    rows: Sequence[ImpliedModel | None], replicas: Sequence[ImpliedModel | None]
) -> tuple[list[ImpliedModel], SamplingErrors]:
    """Average each implied model with its replica by other random samples; return the means and standard errors."""
    pairs = [(a, b) for a, b in zip(rows, replicas, strict=False) if a is not None and b is not None]
    means = [
        ImpliedModel(
            a.trial,
            a.used & b.used,
            np.sqrt(a.noise * b.noise),
            (a.direction_difference + b.direction_difference) / 2,
            (a.size + b.size) / 2,
            (a.jacobian + b.jacobian) / 2,
            np.sqrt(np.abs(a.own_noise * b.own_noise)),
        )
        for a, b in pairs
    ]
    if not pairs:
        return [], SamplingErrors(*np.zeros((3, 1)))
    turned = [np.linalg.norm(a.direction_difference - b.direction_difference, axis=1) for a, b in pairs]
    scaled = [np.log(np.maximum(a.size, 1e-3) / np.maximum(b.size, 1e-3)) for a, b in pairs]
    louder = [np.log(a.noise / b.noise) for a, b in pairs]
    direction, size, noise = (np.sqrt(np.nanmean(np.square(gap), axis=0)) / 2 for gap in (turned, scaled, louder))
    # The standard error of a median is 1.25 times that of a mean.
    return means, SamplingErrors(direction, size, 1.25 * noise / np.sqrt(len(pairs)))
