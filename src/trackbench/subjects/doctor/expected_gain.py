"""The gain that a Kalman filter has with a tracker's own predicted covariance and the right models."""

from __future__ import annotations

from itertools import product

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Mask
from trackbench.base.units import wrap_angle
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.trial import Trial

#: Roots and weights of the three-point Gauss-Hermite rule for a standard normal variable.
ROOTS, WEIGHTS = (-np.sqrt(3.0), 0.0, np.sqrt(3.0)), (1 / 6, 2 / 3, 1 / 6)


def linearised_gain(trial: Trial, used: Mask | None = None, covariance: Array | None = None) -> Array:
    """``(4, m)`` that of an EKF; with some components ``(m,)`` alone, or of another covariance ``(4, 4)``."""
    p = linalg.symmetrise(trial.prediction.covariance if covariance is None else covariance)
    cross = p @ trial.jacobian.T
    return _gain(cross, trial.jacobian @ cross + trial.scan.noise_covariance, used)


def gaussian_gain(trial: Trial, used: Mask | None = None) -> Array:
    """``(4, m)`` with the moments of the Gaussian prediction, by the Gauss-Hermite rule of 81 points: what the sums
    over sigma points approximate (Arasaratnam, Haykin and Elliott 2007)."""
    p = linalg.symmetrise(trial.prediction.covariance)
    values, vectors = np.linalg.eigh(p)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    points = root @ np.array(list(product(ROOTS, repeat=4))).T
    weights = np.prod(list(product(WEIGHTS, repeat=4)), axis=1)
    model, scan = SENSOR_MODELS[trial.scan.kind], trial.scan
    seen = [model.measure(trial.prediction.mean + x, scan.sensor_pose, scan.sensor_velocity) for x in points.T]
    apart = np.array(seen).T - trial.predicted_measurement[:, None]
    for i in model.angular:
        apart[i] = wrap_angle(apart[i])
    apart = apart - (apart @ weights)[:, None]
    return _gain(points * weights @ apart.T, apart * weights @ apart.T + scan.noise_covariance, used)


def gain_error(trial: Trial, applied: Array, used: Mask | None = None) -> tuple[float, Array]:
    """The distance of a gain ``(4, m)`` from the nearer of the two, relative to it, and that one.

    The gains are scaled by the standard deviations of prediction and measurement.
    """
    return min(
        (
            (relative_error(applied, right, trial.gain_scale), right)
            for right in (linearised_gain(trial, used), gaussian_gain(trial, used))
        ),
        key=lambda one: one[0],
    )


def joseph(trial: Trial, gain: Array, covariance: Array | None = None) -> Array:
    """``(4, 4)`` the predicted covariance, or another one, after an update with a gain ``(4, m)``, by Joseph's form."""
    p = linalg.symmetrise(trial.prediction.covariance) if covariance is None else covariance
    kept = np.eye(4) - gain @ trial.jacobian
    return np.asarray(kept @ p @ kept.T + gain @ trial.scan.noise_covariance @ gain.T)


def relative_error(found: Array, right: Array, scale: Array) -> float:
    """Of a matrix whose entries are multiplied by ``scale``, in the Frobenius norm."""
    return float(np.linalg.norm((found - right) * scale) / np.linalg.norm(right * scale))


def _gain(cross: Array, innovation_covariance: Array, used: Mask | None) -> Array:
    """Zero where a component is not used."""
    of = np.ones(len(innovation_covariance), dtype=bool) if used is None else used
    gain = np.zeros(cross.shape)
    gain[:, of] = np.linalg.solve(innovation_covariance[np.ix_(of, of)], cross[:, of].T).T
    return gain
