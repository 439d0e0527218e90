"""The posterior Cramer-Rao bound: the least error that any estimator of these measurements can have."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackbench import linalg
from trackbench.metrics.sums import NO_BOUND, Bound
from trackbench.models.motion import ConstantVelocity, process_noise
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.sensing.scans import IdealSensor
from trackbench.types import Array, Indices, Truth

#: Standard deviation of the position before the first measurement, m: no information.
UNKNOWN_POSITION = 1e6


@dataclass(frozen=True)
class BoundStart:
    """What is known of a target before its first measurement."""

    velocity_sigma: float
    """m/s, per axis."""
    position_sigma: float | None = None
    """m, per axis; None where tracks start from their first measurement, and the target is unknown before it."""


def typical_acceleration(truth: Truth) -> float:
    """RMS over targets and time of the true acceleration per axis, m/s^2, normal acceleration included."""
    total = truth.acceleration**2 + (truth.speed * truth.yaw_rate) ** 2
    alive = np.broadcast_to(truth.alive[:, :, None], total.shape)
    return float(np.sqrt(total[alive].mean() / 2.0)) if alive.any() else 0.0


def cramer_rao(
    truth: Truth,
    sensors: list[IdealSensor],
    rates: dict[str, Array],
    acceleration_sigma: float,
    start: BoundStart,
    instants: Indices,
) -> Array:
    """Bound of the covariance of px, py, vx, vy for targets that move with white acceleration, along the truth.

    The recursion of Tichavský, Muravchik and Nehorai (1998), "Posterior Cramér-Rao bounds for discrete-time nonlinear
    filtering", equation 21, with the information of a measurement weighted by the share of the runs that have it
    (Zhang, Willett and Bar-Shalom 2005, "Dynamic Cramer-Rao bound for target tracking in clutter", the information
    reduction factor). The sum of squared error components is bounded by the sum of the diagonal.

    The information of a measurement is an expectation over the motion of the targets: where the truth varies from run
    to run it is averaged over the runs, and where it does not it is that along the one truth.

    Args:
        truth: the motion of the targets.
        sensors: those that the tracker reads.
        rates: per sensor ``(measurements, objects)`` share of the runs with a detection.
        acceleration_sigma: m/s^2 per axis, constant from one instant to the next.
        start: what is known before the first measurement.
        instants: ``(instants,)`` indices of the truth's steps at which the bound is wanted.

    Returns:
        ``(instants, objects, 4)`` variances, NaN before the first measurement of an object.
    """
    motion = ConstantVelocity.model_construct(acceleration_sigma_mps2=acceleration_sigma)
    target = np.stack([truth.px, truth.py, truth.vx, truth.vy])
    sigma = [start.position_sigma or UNKNOWN_POSITION] * 2 + [start.velocity_sigma] * 2
    covariance = np.repeat(np.diag(np.square(sigma))[None], len(truth.ids), axis=0)
    known = np.zeros(len(truth.ids), dtype=bool)
    result = np.full((len(instants), len(truth.ids), 4), np.nan)
    previous = instants[0]
    for row, step in enumerate(instants):
        dt = float(truth.time[step] - truth.time[previous])
        previous = step
        f = motion.jacobian(target[:, step], dt)
        moved = f @ covariance @ f.T + process_noise(motion, target[:, step], dt)
        covariance = np.where(known[:, None, None], moved, covariance)
        if start.position_sigma is not None:
            known |= truth.alive[step]
        for sensor in sensors:
            k = int(np.searchsorted(sensor.steps, step))
            if k == len(sensor.steps) or sensor.steps[k] != step:
                continue
            rate = rates[sensor.name][k]
            gained = rate[:, None, None] * _information(sensor, k, target[:, step])
            covariance = np.linalg.inv(np.linalg.inv(covariance) + gained)
            known |= rate > 0.0
        result[row] = np.where(known[:, None], np.einsum("oii->oi", covariance), np.nan)
    return result


def rms_bound(variances: Array, weight: Array) -> Bound:
    """The bound of the RMSE, from variances ``(instants, objects, 4)`` and the number of estimates at each."""
    use = (weight > 0) & np.isfinite(variances).all(axis=2)
    if not use.any():
        return NO_BOUND
    mean = (variances[use] * weight[use][:, None]).sum(axis=0) / weight[use].sum()
    return Bound(float(np.sqrt(mean[:2].sum())), float(np.sqrt(mean[2:].sum())))


def _information(sensor: IdealSensor, measurement: int, target: Array) -> Array:
    """``(objects, 4, 4)`` of a measurement of targets ``(4, objects, runs)``, mean over the runs that can have it."""
    pose, velocity = sensor.pose[:, measurement], sensor.velocity[:, measurement]
    h = SENSOR_MODELS[sensor.config.type].jacobian(target, pose, velocity)
    h = np.broadcast_to(linalg.expand(h, target[None]), (len(h), *target.shape))
    weighted = np.einsum("ab,bj...->aj...", np.linalg.inv(sensor.noise_covariance), h)
    weight = np.broadcast_to(sensor.visible[measurement], target.shape[1:]).astype(float)
    total = np.einsum("or,aior,ajor->oij", weight, h, weighted)
    return np.asarray(total / np.maximum(weight.sum(axis=1), 1.0)[:, None, None])
