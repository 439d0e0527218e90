"""The posterior Cramer-Rao bound of the errors, for targets that move with white acceleration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Indices, Mask, Truth
from trackbench.engine.choice import kernels_of
from trackbench.engine.equations import Compute, Equations, Values, by_numpy
from trackbench.models.motion import ConstantVelocity, process_noise_covariance
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
    target = truth.state
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
    compute: Compute = by_numpy,
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
        compute: how equations are computed.

    Returns:
        ``(2, instants, objects, runs or 1)`` variance of the position, m^2, and of the velocity, (m/s)^2, each the sum
        over both axes; one for all runs where the measurements of all are of the same instants. Zero before the first
        measurement, or before the target's time in the scene where tracks start from the truth.
    """
    # Of one run where all are alike.
    masks = {
        name: valid[name][..., :1] if bool((valid[name] == valid[name][..., :1]).all()) else valid[name]
        for name in sensors
    }
    if drawn is None:
        drawn = np.unique(np.concatenate([of.steps for of in sensors.values()]))
    shape = len(truth.ids), max(mask.shape[-1] for mask in masks.values())
    prior = np.diag(np.square([start.position_sigma or UNKNOWN_POSITION] * 2 + [start.velocity_sigma] * 2))
    # The prior is too wide for the update of a covariance.
    firsts = {
        name: np.linalg.inv(np.linalg.inv(prior) + np.einsum("krio,krjo->koij", of.root, of.root)).transpose(0, 2, 3, 1)
        for name, of in sensors.items()
    }
    # Of few runs NumPy's sums are as quick.
    compute = kernels_of(compute, shape[1]) or by_numpy
    result = np.zeros((2, len(instants), *shape))
    covariance = np.broadcast_to(prior[:, :, None, None], (4, 4, *shape))
    begun = np.zeros(shape, dtype=bool)
    latest = instants[0]

    def after(equations: Equations, **values: Array) -> tuple[Array, Array]:
        computed = compute(equations, {"covariance": covariance, "begun": begun, **values})
        return computed["covariance"], computed["bound"]

    for row, step in enumerate(instants):
        moves, at_end = drawn[(drawn > latest) & (drawn <= step)], False
        if len(moves) > 0:
            covariance, bound = after(PREDICTION, motion=_motion(acceleration_sigma, truth.time[[latest, *moves]]))
            latest, at_end = moves[-1], True
        for name, of in sensors.items():
            k = int(np.searchsorted(of.steps, step))
            if k == len(of.steps) or of.steps[k] != step:
                continue
            if start.position_sigma is not None:
                begun = begun | truth.alive[step][:, None]
            told = {"root": of.root[k][..., None], "first": firsts[name][k][..., None]}
            covariance, bound = after(MEASUREMENT, seen=np.broadcast_to(masks[name][k], shape), **told)
            begun, at_end = begun | masks[name][k], True
        if step != latest or not at_end:
            # The recursion does not go on from it.
            _, bound = after(PREDICTION, motion=_motion(acceleration_sigma, truth.time[[latest, step]]))
        result[:, row] = bound
    return result


def _motion(acceleration_sigma: float, times: Array) -> Array:
    """``(4,)`` from one time to the last: the elapsed time, s, and the process noise of position, of both, and of
    velocity, per axis; the acceleration is drawn at each of the times but the last."""
    q = np.zeros((4, 4))
    for dt in map(float, np.diff(times)):
        step, noise = _transition(acceleration_sigma, dt)
        q = step @ q @ step.T + noise
    return np.array([times[-1] - times[0], q[0, 0], q[0, 2], q[2, 2]])


@lru_cache(maxsize=1024)
def _transition(acceleration_sigma: float, dt: float) -> tuple[Array, Array]:
    """Return the transition and the process noise ``(4, 4)`` of a constant velocity over ``dt`` s."""
    motion, nowhere = ConstantVelocity.model_construct(acceleration_sigma_mps2=acceleration_sigma), np.zeros(4)
    return motion.jacobian(nowhere, dt), process_noise_covariance(motion, nowhere, dt)


def _predicted(values: Values) -> Values:
    covariance, (dt, q_position, q_both, q_velocity) = values["covariance"], values["motion"]
    f = linalg.matrix([[1.0, 0.0, dt, 0.0], [0.0, 1.0, 0.0, dt], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    q = linalg.matrix(
        [
            [q_position, 0.0, q_both, 0.0],
            [0.0, q_position, 0.0, q_both],
            [q_both, 0.0, q_velocity, 0.0],
            [0.0, q_both, 0.0, q_velocity],
        ]
    )
    moved = linalg.quadratic(f, covariance) + linalg.expand(q, covariance)
    return _bound(np.where(values["begun"], moved, covariance), values["begun"])


def _measured(values: Values) -> Values:
    """``P <- (P^-1 + A^T A)^-1`` where there is a measurement, without an inverse of ``P``."""
    covariance, root, seen, begun = (values[name] for name in ("covariance", "root", "seen", "begun"))
    cross = linalg.matmul(root, covariance)
    s = linalg.matmul_transposed(cross, root) + linalg.expand(np.eye(len(root)), covariance)
    gain = linalg.cholesky(s).whiten(cross)
    updated = covariance - linalg.gram(np.where(seen, gain, 0.0))
    return _bound(np.where(seen & ~begun, values["first"], updated), begun | seen)


def _bound(covariance: Array, begun: Mask) -> Values:
    variances = [covariance[0, 0] + covariance[1, 1], covariance[2, 2] + covariance[3, 3]]
    return {"covariance": covariance, "bound": np.where(begun, linalg.vector(variances), 0.0)}


#: A prediction of the bound by ``motion`` where something is ``begun``.
PREDICTION = Equations(
    "prediction of the bound",
    _predicted,
    {"covariance": 2, "begun": 0, "motion": 1},
    frozenset({"covariance"}),
)
#: A measurement with the ``root`` of its information where it is ``seen``; ``first``: the covariance after it where
#: nothing was ``begun`` before.
MEASUREMENT = Equations(
    "measurement of the bound",
    _measured,
    {"covariance": 2, "begun": 0, "root": 2, "first": 2, "seen": 0},
    frozenset({"covariance", "first"}),
)


def _information(sensor: IdealSensor, measurement: int, target: Array) -> Array:
    """``(objects, 4, 4)`` of a measurement of targets ``(4, objects, runs)``, mean over the runs that can have it."""
    pose, velocity = sensor.pose[:, measurement], sensor.velocity[:, measurement]
    h = SENSOR_MODELS[sensor.config.type].jacobian(target, pose, velocity)
    h = np.broadcast_to(linalg.expand(h, target[None]), (len(h), *target.shape))
    weighted = np.einsum("ab,bj...->aj...", np.linalg.inv(sensor.noise_covariance), h)
    weight = np.broadcast_to(sensor.visible[measurement], target.shape[1:]).astype(float)
    total = np.einsum("or,aior,ajor->oij", weight, h, weighted)
    return np.asarray(total / np.maximum(weight.sum(axis=1), 1.0)[:, None, None])
