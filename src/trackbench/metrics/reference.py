"""The posterior Cramer-Rao bound of the errors, for targets that move with white acceleration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Indices, Mask, Truth
from trackbench.models.motion import ConstantVelocity, process_noise
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.sensing.scans import IdealSensor

#: Standard deviation of the position before the first measurement, m: no information.
UNKNOWN_POSITION = 1e4
#: Eigenvalues of an information below this share of the largest are rounding.
NEGLIGIBLE = 1e-12
#: Largest information of a component: one millimetre, of a target in a radar's own place too. Beyond it the unknown
#: position before the first measurement would be lost in rounding.
LARGEST = 1e6
#: Of targets that enter at rest it is not known that they are; least standard deviation of their velocity, m/s.
LEAST_VELOCITY = 1.0


@dataclass(frozen=True)
class BoundStart:
    """What is known of a target before its first measurement."""

    velocity_sigma: float
    """m/s, per axis."""
    position_sigma: float | None = None
    """m, per axis; None where tracks start from their first measurement, and the target is unknown before it."""


def typical_acceleration(truths: Sequence[Truth]) -> float:
    """RMS over scenes, targets and time of the true acceleration per axis, m/s^2: that of the velocity vector."""
    square = time = 0.0
    for truth in truths:
        vx, vy = np.diff(truth.vx, axis=0), np.diff(truth.vy, axis=0)
        elapsed = np.diff(truth.time)[:, None, None]
        there = np.broadcast_to(truth.alive[1:, :, None] & truth.alive[:-1, :, None], vx.shape)
        square += ((vx * vx + vy * vy) / elapsed)[there].sum()
        time += np.broadcast_to(elapsed, vx.shape)[there].sum()
    return float(np.sqrt(square / time / 2.0)) if time > 0 else 0.0


def entry_velocity(truths: Sequence[Truth]) -> float:
    """RMS over scenes and targets of the true velocity per axis as each enters the scene, m/s; at least 1."""
    squares = []
    for truth in truths:
        there = truth.alive.any(axis=0)
        first = np.argmax(truth.alive, axis=0)
        squares.append(truth.speed[first[there], np.flatnonzero(there)] ** 2)
    every = np.concatenate([square.mean(axis=-1) for square in squares])
    return max(float(np.sqrt(every.mean() / 2.0)), LEAST_VELOCITY) if every.size else LEAST_VELOCITY


class Information(NamedTuple):
    """What the measurements of one sensor tell of the position and velocity of the targets."""

    steps: Indices
    """``(measurements,)`` indices of the truth's steps."""
    root: Array
    """``(measurements, rank, 4, objects)`` ``A`` with ``A^T A = E[H^T R^-1 H]``, the Fisher information."""


def information(sensor: IdealSensor, truth: Truth) -> Information:
    """The Fisher information of each measurement of a sensor.

    It is an expectation over the motion of the targets: the mean over the runs in which the sensor can see the target,
    and where the truth is the same in every run, that along the truth.
    """
    target = np.stack([truth.px, truth.py, truth.vx, truth.vy])
    each = np.stack([_information(sensor, k, target[:, step]) for k, step in enumerate(sensor.steps)])
    # A radar has no Jacobian of a target at its own place, and is taken to tell nothing of it.
    each = np.where(np.isfinite(each).all(axis=(-2, -1), keepdims=True), each, 0.0)
    # Semidefinite: a measurement tells nothing of some directions.
    values, vectors = np.linalg.eigh(each)
    values = np.where(values > NEGLIGIBLE * values[..., -1:], np.minimum(values, LARGEST), 0.0)
    rank = max(1, int((values > 0.0).sum(axis=-1).max(initial=0)))
    root = np.sqrt(values)[..., -rank:, None] * np.swapaxes(vectors, -1, -2)[..., -rank:, :]
    return Information(sensor.steps, np.ascontiguousarray(root.transpose(0, 2, 3, 1)))


def conditional_bound(
    truth: Truth,
    sensors: Mapping[str, Information],
    valid: Mapping[str, Mask],
    acceleration_sigma: float,
    start: BoundStart,
    instants: Indices,
    drawn: Indices | None = None,
) -> Array:
    """Bound of the errors of each run, given which of its measurements there are.

    For targets that move with white acceleration: the recursion of Tichavský, Muravchik and Nehorai (1998), "Posterior
    Cramér-Rao bounds for discrete-time nonlinear filtering", equation 21, where a measurement adds its information in
    those runs that have it. Its mean over the runs is the enumeration bound (Farina, Ristic and Timmoneri 2002,
    "Cramér-Rao bound for nonlinear filtering with Pd<1 and its application to target tracking"; Hernandez, Ristic,
    Farina and Timmoneri 2004, "A comparison of two Cramér-Rao bounds for nonlinear filtering with Pd<1"), the
    sequences of detections being drawn and not enumerated.

    Args:
        truth: the motion of the targets.
        sensors: by name, the information of those that the tracker reads.
        valid: by sensor ``(measurements, objects, runs)``, where there is a measurement.
        acceleration_sigma: m/s^2 per axis.
        start: what is known before the first measurement.
        instants: ``(instants,)`` indices of the truth's steps at which the bound is wanted, among them those of all
            measurements.
        drawn: indices of the truth's steps at which the acceleration is drawn anew, among them those of all
            measurements, and constant in between; unless given, it is at each measurement of these sensors.

    Returns:
        ``(2, instants, objects, runs or 1)`` variance of the position, m^2, and of the velocity, (m/s)^2, each the sum
        over both axes; one for all runs where the measurements of all are of the same instants. NaN before the first
        measurement, or before the target's time in the scene where tracks start from the truth.
    """
    motion = ConstantVelocity.model_construct(acceleration_sigma_mps2=acceleration_sigma)
    # Of one run where all are alike.
    masks = {
        name: valid[name][..., :1] if bool((valid[name] == valid[name][..., :1]).all()) else valid[name]
        for name in sensors
    }
    if drawn is None:
        drawn = np.unique(np.concatenate([of.steps for of in sensors.values()]))
    objects, runs = len(truth.ids), max(mask.shape[-1] for mask in masks.values())
    prior = np.diag(np.square([start.position_sigma or UNKNOWN_POSITION] * 2 + [start.velocity_sigma] * 2))
    covariance = np.broadcast_to(prior[:, :, None, None], (4, 4, objects, runs))
    known = np.zeros((objects, runs), dtype=bool)
    result = np.full((2, len(instants), objects, runs), np.nan)
    latest = instants[0]
    for row, step in enumerate(instants):
        passed = drawn[(drawn > latest) & (drawn <= step)]
        if len(passed) > 0:
            moved = _predicted(motion, covariance, truth.time[[latest, *passed]])
            covariance, latest = moved if known.all() else np.where(known, moved, covariance), passed[-1]
        for name, of in sensors.items():
            k = int(np.searchsorted(of.steps, step))
            if k == len(of.steps) or of.steps[k] != step:
                continue
            if start.position_sigma is not None:
                known = known | truth.alive[step][:, None]
            root, seen = of.root[k][..., None], masks[name][k]
            updated = _updated(covariance, root, seen)
            begun = seen & ~known
            if begun.any():
                # The prior is too wide for the update of a covariance.
                total = np.linalg.inv(prior)[:, :, None, None] + linalg.gram(root)
                first = np.linalg.inv(total.transpose(2, 3, 0, 1)).transpose(2, 3, 0, 1)
                updated = np.where(begun, first, updated)
            covariance = updated
            known = known | begun
        now = covariance if step == latest else _predicted(motion, covariance, truth.time[[latest, step]])
        variance = np.einsum("ii...->i...", now)
        result[:, row] = np.where(known, [variance[0] + variance[1], variance[2] + variance[3]], np.nan)
    return result


def _information(sensor: IdealSensor, measurement: int, target: Array) -> Array:
    """``(objects, 4, 4)`` of a measurement of targets ``(4, objects, runs)``, mean over the runs that can have it."""
    pose, velocity = sensor.pose[:, measurement], sensor.velocity[:, measurement]
    h = SENSOR_MODELS[sensor.config.type].jacobian(target, pose, velocity)
    h = np.broadcast_to(linalg.expand(h, target[None]), (len(h), *target.shape))
    weighted = np.einsum("ab,bj...->aj...", np.linalg.inv(sensor.noise_covariance), h)
    weight = np.broadcast_to(sensor.visible[measurement], target.shape[1:]).astype(float)
    total = np.einsum("or,aior,ajor->oij", weight, h, weighted)
    return np.asarray(total / np.maximum(weight.sum(axis=1), 1.0)[:, None, None])


def _predicted(motion: ConstantVelocity, covariance: Array, times: Array) -> Array:
    """``P <- F P F^T + Q``, the acceleration being drawn at each of the times but the last."""
    nowhere = np.zeros(4)
    f, q = np.eye(4), np.zeros((4, 4))
    for dt in map(float, np.diff(times)):
        step = motion.jacobian(nowhere, dt)
        f, q = step @ f, step @ q @ step.T + process_noise(motion, nowhere, dt)
    return linalg.quadratic(f, covariance) + q[:, :, None, None]


def _updated(covariance: Array, root: Array, seen: Mask) -> Array:
    """``P <- (P^-1 + A^T A)^-1`` where there is a measurement, without an inverse of ``P``."""
    cross = linalg.matmul(root, covariance)
    s = linalg.matmul_transposed(cross, root) + np.eye(len(root))[:, :, None, None]
    gain = linalg.cholesky(s).whiten(cross)
    return covariance - linalg.gram(gain if seen.all() else np.where(seen, gain, 0.0))
