"""The posterior Cramer-Rao bound of position and velocity errors, for targets that move with white acceleration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Indices, Mask, Truth
from trackbench.engine.choice import kernels_of
from trackbench.engine.equations import Compute, Equations, Values, by_numpy
from trackbench.engine.vector_code import WIDTH
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.sensing.scans import IdealSensor

if TYPE_CHECKING:
    from trackbench.engine.kernels import Kernels

#: Standard deviation of the position before the first measurement, m: no information.
UNKNOWN_POSITION = 1e4
#: Eigenvalues of an information below this share of the largest are rounding.
NEGLIGIBLE = 1e-12
#: Largest information of a component, for an error of one millimetre; a target at a radar's own place would have more.
#: Above it the unknown position before the first measurement would be lost in rounding.
LARGEST = 1e6
#: Least standard deviation of the velocity on entry, m/s: a target that enters at rest is not known to be at rest.
LEAST_VELOCITY = 1.0


@dataclass(frozen=True)
class BoundStart:
    """Prior of a target before the first measurement: standard deviations of its position and velocity."""

    velocity_sigma: float
    """Standard deviation of the velocity, m/s per axis."""
    position_sigma: float | None = None
    """Standard deviation of the position, m per axis; None where tracks start from their first measurement, and the
    position is unknown before it."""


def typical_acceleration(truths: Sequence[Truth]) -> float:
    """Return the RMS of the true acceleration per axis over scenes, targets and time, m/s^2, from true velocities."""
    square = time = 0.0
    for truth in truths:
        vx, vy = np.diff(truth.vx, axis=0), np.diff(truth.vy, axis=0)
        elapsed = np.diff(truth.time)[:, None, None]
        there = np.broadcast_to(truth.alive[1:, :, None] & truth.alive[:-1, :, None], vx.shape)
        square += ((vx * vx + vy * vy) / elapsed)[there].sum()
        time += np.broadcast_to(elapsed, vx.shape)[there].sum()
    return float(np.sqrt(square / time / 2.0)) if time > 0 else 0.0


def entry_velocity(truths: Sequence[Truth]) -> float:
    """Return the RMS of the true velocity per axis over scenes and targets as each enters, m/s; at least 1."""
    squares = []
    for truth in truths:
        there = truth.alive.any(axis=0)
        first = np.argmax(truth.alive, axis=0)
        squares.append(truth.speed[first[there], np.flatnonzero(there)] ** 2)
    every = np.concatenate([square.mean(axis=-1) for square in squares])
    return max(float(np.sqrt(every.mean() / 2.0)), LEAST_VELOCITY) if every.size else LEAST_VELOCITY


class Information(NamedTuple):
    """Fisher information on the position and velocity of the targets in the measurements of one sensor."""

    steps: Indices
    """``(measurements,)`` index of the truth's step at which each measurement is taken."""
    root: Array
    """``(rank, 4, measurements, objects)`` matrix ``A`` of each measurement of each object, with the information ``A^T
    A = E[H^T R^-1 H]``."""


def information(sensor: IdealSensor, truth: Truth) -> Information:
    """Return the Fisher information on position and velocity in each measurement of a sensor.

    It is an expectation over the motion of the targets: the mean over the runs in which the sensor can see the target.
    If the truth is the same in every run, it is the information along the truth.
    """
    target = truth.state
    each = np.stack([_mean_information(sensor, k, target[:, step]) for k, step in enumerate(sensor.steps)])
    # A radar has no Jacobian for a target at its own place; its information there is taken as zero.
    each = np.where(np.isfinite(each).all(axis=(-2, -1), keepdims=True), each, 0.0)
    # Semidefinite: a measurement tells nothing of some directions.
    values, vectors = np.linalg.eigh(each)
    values = np.where(values > NEGLIGIBLE * values[..., -1:], np.minimum(values, LARGEST), 0.0)
    rank = max(1, int((values > 0.0).sum(axis=-1).max(initial=0)))
    root = np.sqrt(values)[..., -rank:, None] * np.swapaxes(vectors, -1, -2)[..., -rank:, :]
    return Information(sensor.steps, np.ascontiguousarray(root.transpose(2, 3, 0, 1)))


class ConditionalBound:
    """Cramér-Rao bound of the errors in each run, given which measurements the run has.

    For targets that move with white acceleration, it is the recursion of Tichavský, Muravchik and Nehorai (1998),
    "Posterior Cramér-Rao bounds for discrete-time nonlinear filtering", equation 21. A measurement adds its information
    in the runs that have it. The mean over the runs is the enumeration bound (Farina, Ristic and Timmoneri 2002,
    "Cramér-Rao bound for nonlinear filtering with Pd<1 and its application to target tracking"; Hernandez, Ristic,
    Farina and Timmoneri 2004, "A comparison of two Cramér-Rao bounds for nonlinear filtering with Pd<1"), but the
    sequences of detections are sampled at random, not enumerated.

    Args:
        truth: the motion of the targets.
        sensors: information of each sensor that the tracker uses, by name.
        acceleration_sigma: standard deviation of the acceleration, m/s^2 per axis.
        start: prior knowledge before the first measurement.
        instants: ``(instants,)`` indices of the truth's steps at which the bound is computed; they include the steps of
            all measurements.
        drawn: indices of the truth's steps at which the acceleration takes a new random value, constant in between;
            they include the steps of all measurements. By default they are the steps of the measurements of
            ``sensors``.
    """

    def __init__(
        self,
        truth: Truth,
        sensors: Mapping[str, Information],
        acceleration_sigma: float,
        start: BoundStart,
        instants: Indices,
        drawn: Indices | None = None,
    ) -> None:
        if drawn is None:
            drawn = np.unique(np.concatenate([info.steps for info in sensors.values()]))
        self._shape = len(instants), len(truth.ids)
        self._prior = np.diag(np.square([start.position_sigma or UNKNOWN_POSITION] * 2 + [start.velocity_sigma] * 2))
        self._constants: dict[str, dict[str, Array | Mask]] = {}
        for name, info in sensors.items():
            # The prior is too wide for the update of a covariance.
            first = np.linalg.inv(np.linalg.inv(self._prior) + np.einsum("rkmo,rjmo->mokj", info.root, info.root))
            enters = truth.alive[info.steps] & (start.position_sigma is not None)
            self._constants[name] = {"root": info.root, "first": first.transpose(2, 3, 0, 1).copy(), "enters": enters}
        numbers = {name: {step: k for k, step in enumerate(info.steps.tolist())} for name, info in sensors.items()}
        # Instant; time and process noise since the latest measurement; sensor, or none; measurement.
        self._steps: list[tuple[int, float, Array, str, int]] = []
        latest = instants[0]
        for row, step in enumerate(instants.tolist()):
            reading = [(name, of_step[step]) for name, of_step in numbers.items() if step in of_step]
            for name, k in reading or [("", 0)]:
                between = drawn[np.searchsorted(drawn, latest, "right") : np.searchsorted(drawn, step)]
                times = truth.time[[latest, *between, step]]
                self._steps.append((row, times[-1] - times[0], _process_noise(acceleration_sigma, times), name, k))
                latest = step if reading else latest

    def of_runs(self, valid: Mapping[str, Mask], compute: Compute = by_numpy) -> Array:
        """Return the Cramér-Rao bound of position and velocity in the runs that ``valid`` describes.

        Args:
            valid: by sensor, mask ``(measurements, objects, runs)`` of the measurements that the runs have.
            compute: function that computes equations.

        Returns:
            ``(2, instants, objects, runs or 1)`` variance of the position, m^2, and of the velocity, (m/s)^2, each
            summed over both axes; the last axis has length 1 if all runs have the same measurements. The bound is zero
            before the first measurement, or before the target enters if tracks start from the truth.
        """
        masks = {name: valid[name] for name in self._constants}
        # For few runs NumPy is as quick.
        kernels = kernels_of(compute, next(iter(masks.values())).shape[-1])
        if all((mask == mask[..., :1]).all() for mask in masks.values()):
            masks = {name: mask[..., :1] for name, mask in masks.items()}
        result = None if kernels is None else self._by_kernels(kernels, masks)
        return self._by_numpy(masks) if result is None else result

    def _by_numpy(self, masks: Mapping[str, Mask]) -> Array:
        instants, objects = self._shape
        shape = objects, next(iter(masks.values())).shape[-1]
        covariance = np.broadcast_to(self._prior[:, :, None, None], (4, 4, *shape))
        values: dict[str, Array] = {"covariance": covariance, "begun": np.zeros(shape, dtype=bool)}
        result = np.empty((2, instants, *shape))
        for row, dt, noise, sensor, k in self._steps:
            values |= {"dt": np.asarray(dt), "noise": noise}
            if sensor:
                constants = {name: array[..., k, :, None] for name, array in self._constants[sensor].items()}
                values |= by_numpy(MEASUREMENT, {**values, **constants, "seen": masks[sensor][k]})
                result[:, row] = values["bound"]
            else:
                result[:, row] = by_numpy(PREDICTION, values)["bound"]
        return result

    def _by_kernels(self, kernels: Kernels, masks: Mapping[str, Mask]) -> Array | None:
        from trackbench.engine.sequences import CallSequence, place

        instants, objects = self._shape
        runs = next(iter(masks.values())).shape[-1]
        if runs == 1:
            masks = {name: mask.repeat(WIDTH, axis=-1) for name, mask in masks.items()}
        shape = objects, max(runs, WIDTH)
        # The state has two slots: a step reads one and writes the other.
        covariance, begun = np.empty((4, 4, 2, *shape)), np.zeros((2, *shape), dtype=bool)
        covariance[:, :, 0] = self._prior[:, :, None, None]
        result = np.empty((2, instants, *shape))
        rows, times, noises, sensors, numbers = map(np.array, zip(*self._steps, strict=True))
        after = np.cumsum(sensors != "")
        sequence = CallSequence(kernels, *shape, len(self._steps))
        for name in np.unique(sensors).tolist():
            at = np.flatnonzero(sensors == name)
            into, k = after[at] % 2, numbers[at]
            slots = 1 - into if name else into
            inputs = {"covariance": place(covariance, 2, slots), "begun": place(begun, 0, slots)}
            inputs |= {"dt": place(times, 0, at), "noise": place(np.moveaxis(noises, 0, -1), 2, at)}
            outputs = {"bound": place(result, 1, rows[at])}
            if name:
                arrays = {**self._constants[name], "seen": masks[name]}
                inputs |= {item: place(array, MEASUREMENT.ranks[item], k) for item, array in arrays.items()}
                outputs |= {"covariance": place(covariance, 2, into), "begun": place(begun, 0, into)}
            if not sequence.compute(MEASUREMENT if name else PREDICTION, at, inputs, outputs):
                return None
        return result[..., :runs] if sequence.run() else None


def _process_noise(acceleration_sigma: float, times: Array) -> Array:
    """Return the process noise ``(4, 4)`` of white acceleration over an interval, constant between ``times``, s."""
    dt = np.diff(times)
    moved = dt * (times[-1] - times[1:] + 0.5 * dt)
    per_axis = np.array([[moved @ moved, moved @ dt], [moved @ dt, dt @ dt]])
    # The Kronecker product with the identity: np.kron takes ten times as long.
    return (acceleration_sigma**2 * per_axis[:, None, :, None] * np.eye(2)[:, None]).reshape(4, 4)


def _predicted(values: Values) -> Array:
    covariance, dt = values["covariance"], values["dt"]
    f = linalg.matrix([[1.0, 0.0, dt, 0.0], [0.0, 1.0, 0.0, dt], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    moved = linalg.quadratic(f, covariance) + linalg.expand(values["noise"], covariance)
    return np.where(values["begun"], moved, covariance)


def _measured(values: Values) -> Values:
    """Predict the covariance P, and update ``P <- (P^-1 + A^T A)^-1`` at a measurement, without inverting P."""
    covariance, root, seen = _predicted(values), values["root"], values["seen"]
    begun = values["begun"] | values["enters"]
    cross = linalg.matmul(root, covariance)
    s = linalg.matmul_transposed(cross, root) + linalg.expand(np.eye(len(root)), covariance)
    gain = linalg.cholesky(s).whiten(cross)
    updated = covariance - linalg.gram(np.where(seen, gain, 0.0))
    updated, begun = np.where(seen & ~begun, values["first"], updated), begun | seen
    return {"covariance": updated, "begun": begun, "bound": _bound(updated, begun)}


def _bound(covariance: Array, begun: Mask) -> Array:
    variances = [covariance[0, 0] + covariance[1, 1], covariance[2, 2] + covariance[3, 3]]
    return np.where(begun, linalg.vector(variances), 0.0)


#: Prediction of the bound over ``dt`` s for targets that have ``begun``.
PREDICTION = Equations(
    "prediction of the bound",
    lambda values: {"bound": _bound(_predicted(values), values["begun"])},
    {"covariance": 2, "begun": 0, "dt": 0, "noise": 2},
    frozenset({"covariance", "noise"}),
)
#: Prediction, and update with the ``root`` of the information where a measurement is ``seen``. ``enters``: whether the
#: target is there and its start is known; ``first``: covariance after a first measurement.
MEASUREMENT = Equations(
    "measurement of the bound",
    _measured,
    {"covariance": 2, "begun": 0, "dt": 0, "noise": 2, "root": 2, "first": 2, "enters": 0, "seen": 0},
    frozenset({"covariance", "noise", "first"}),
)


def _mean_information(sensor: IdealSensor, measurement: int, target: Array) -> Array:
    pose, velocity = sensor.pose[:, measurement], sensor.velocity[:, measurement]
    h = SENSOR_MODELS[sensor.config.type].jacobian(target, pose, velocity)
    h = np.broadcast_to(linalg.expand(h, target[None]), (len(h), *target.shape))
    weighted = np.einsum("ab,bj...->aj...", np.linalg.inv(sensor.noise_covariance), h)
    weight = np.broadcast_to(sensor.visible[measurement], target.shape[1:]).astype(float)
    total = np.einsum("or,aior,ajor->oij", weight, h, weighted)
    return np.asarray(total / np.maximum(weight.sum(axis=1), 1.0)[:, None, None])
