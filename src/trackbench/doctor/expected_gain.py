"""The gain that a Kalman filter has with a tracker's own predicted covariance and the right models."""

from __future__ import annotations

from itertools import product

import numpy as np

from trackbench import linalg
from trackbench.doctor.trial import Trial
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.types import Array
from trackbench.units import wrap_angle

#: Roots and weights of the three-point Gauss-Hermite rule for a standard normal variable.
ROOTS, WEIGHTS = (-np.sqrt(3.0), 0.0, np.sqrt(3.0)), (1 / 6, 2 / 3, 1 / 6)


def linearised_gain(trial: Trial) -> Array:
    """``(4, m)`` that of an EKF."""
    p, h = linalg.symmetrise(trial.prediction.covariance), trial.jacobian
    cross = p @ h.T
    return _gain(cross, h @ cross + trial.scan.noise_covariance)


def gaussian_gain(trial: Trial) -> Array:
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
    return _gain(points * weights @ apart.T, apart * weights @ apart.T + scan.noise_covariance)


def gain_error(trial: Trial, applied: Array) -> tuple[float, Array]:
    """The distance of a gain ``(4, m)`` from the nearer of the two, relative to it, and that one.

    The gains are scaled by the standard deviations of prediction and measurement.
    """
    scale = trial.sigma / trial.state_sigma[:, None]
    found = []
    for right in (linearised_gain(trial), gaussian_gain(trial)):
        found.append((float(np.linalg.norm((applied - right) * scale) / np.linalg.norm(right * scale)), right))
    return min(found, key=lambda one: one[0])


def _gain(cross: Array, innovation_covariance: Array) -> Array:
    return np.asarray(np.linalg.solve(innovation_covariance, cross.T).T)
