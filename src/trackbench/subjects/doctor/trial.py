"""Trials: hypothetical measurements given to a tracker, and what they do to its estimate."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Estimate, Mask, Scan
from trackbench.base.units import difference
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.session import FAR, StepFailed, TrackerSession, finite

#: Change of a measurement for the finite differences of a gain, in its standard deviations.
GAIN_STEP = 0.05
#: Change of a measurement where answers are averaged over different random numbers, in its standard deviations.
DRAWN_STEP = 1.5
#: Curvature of the measurement model above which correct gains may differ from the one with its Jacobian, in sigma.
CURVED = 0.3
#: Innovation that counts as zero, in standard deviations of the measurement. Second-order terms of a sigma-point
#: filter stay below 0.33.
ZERO = 0.75
#: Gain that counts as zero, relative to the largest.
NO_GAIN = 1e-6
#: Roots and weights of the three-point Gauss-Hermite rule for a standard normal variable.
ROOTS, WEIGHTS = (-np.sqrt(3.0), 0.0, np.sqrt(3.0)), (1 / 6, 2 / 3, 1 / 6)


@dataclass(frozen=True, eq=False)
class Trial:
    """A tracker just before a measurement. Any measurement can be tried; none of them changes the tracker."""

    name: str
    """Name of the probe (test target) or test drive."""
    description: str
    scan: Scan
    """Scan with the sensor's measurement of the true target."""
    prediction: Estimate
    """Estimate of the tracker at the time of the scan, before its measurement."""
    session: TrackerSession
    repeats: int = 1
    """Number of answers that are averaged; 1 unless copies of the tracker draw different random numbers."""
    sensor_set: tuple[str, ...] = ()
    """Names of the sensors with which the target was followed before the trial."""
    _posteriors: dict[tuple[float, ...], Estimate | None] = field(default_factory=dict)
    _updates: dict[tuple[float, ...], TrialUpdate | None] = field(default_factory=dict)

    @property
    def usable(self) -> bool:
        """Whether the prediction is finite and below 10 000 m and m/s, and has positive variances."""
        p = self.prediction
        return finite(p) and bool(np.abs(p.mean).max() < FAR) and bool(np.diag(p.covariance).min() > 0.0)

    @cached_property
    def sigma(self) -> Array:
        """Stated standard deviations of the measurement ``(m,)``."""
        return np.sqrt(np.diag(self.scan.noise_covariance))

    @cached_property
    def state_sigma(self) -> Array:
        """Standard deviations of the prediction ``(4,)``."""
        return np.sqrt(np.diag(self.prediction.covariance))

    @property
    def gain_scale(self) -> Array:
        """Factors ``(4, m)`` that scale a gain to standard deviations of the prediction per one of the measurement."""
        return self.sigma / self.state_sigma[:, None]

    @property
    def variance_scale(self) -> Array:
        """Products ``(4, 4)`` of the prediction's standard deviations; a covariance divided by them is scaled."""
        return np.outer(self.state_sigma, self.state_sigma)

    @cached_property
    def predicted_measurement(self) -> Array:
        """Measurement of the predicted mean ``(m,)``, by the right measurement model."""
        return SENSOR_MODELS[self.scan.kind].measure(
            self.prediction.mean, self.scan.sensor_pose, self.scan.sensor_velocity
        )

    @cached_property
    def jacobian(self) -> Array:
        """Jacobian ``(m, 4)`` of the right measurement model at the predicted mean."""
        return SENSOR_MODELS[self.scan.kind].jacobian(
            self.prediction.mean, self.scan.sensor_pose, self.scan.sensor_velocity
        )

    @cached_property
    def curvature(self) -> Array:
        """Standard deviation ``(m,)`` of the measurement model's second-order term, in sigma of the measurement.

        ``sqrt(tr(A P A P) / 2)`` with the second derivative ``A`` (Bar-Shalom, Li and Kirubarajan 2001, section
        10.3.2). Where it is large, correct sigma-point filters and correct EKFs differ.
        """
        product = np.einsum("iab,bc->iac", self._second_derivative, linalg.symmetrise(self.prediction.covariance))
        return np.asarray(np.sqrt(np.maximum(np.einsum("iab,iba->i", product, product), 0.0) / 2) / self.sigma)

    @property
    def nearly_linear(self) -> bool:
        """Whether the curvature of every component is below 0.3 sigma."""
        return bool(self.curvature.max() < CURVED)

    @cached_property
    def second_order(self) -> Array:
        """Mean ``(m,)`` of the measurement model's second-order term: ``tr(A P) / 2``, ``A`` its second derivative."""
        return np.asarray(0.5 * np.einsum("iab,ba->i", self._second_derivative, self.prediction.covariance))

    @cached_property
    def _second_derivative(self) -> Array:
        """Second derivative ``(m, 4, 4)`` of the measurement model, by differences of its Jacobian."""
        model, scan = SENSOR_MODELS[self.scan.kind], self.scan
        steps = np.diag(1e-3 * np.maximum(self.state_sigma, 1e-3))
        ahead, behind = (
            [
                model.jacobian(self.prediction.mean + side * step, scan.sensor_pose, scan.sensor_velocity)
                for step in steps
            ]
            for side in (1, -1)
        )
        return np.asarray((np.stack(ahead, axis=-1) - np.stack(behind, axis=-1)) / (2 * np.diag(steps)))

    @cached_property
    def gaussian_moments(self) -> tuple[Array, Array]:
        """Covariance ``(4, m)`` of state and noise-free measurement, and covariance ``(m, m)`` of the measurement.

        The prediction is taken as Gaussian. The Gauss-Hermite rule with 81 points gives what sums over sigma points
        approximate (Arasaratnam, Haykin and Elliott 2007).
        """
        values, vectors = np.linalg.eigh(linalg.symmetrise(self.prediction.covariance))
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        points = root @ np.array(list(product(ROOTS, repeat=4))).T
        weights = np.prod(list(product(WEIGHTS, repeat=4)), axis=1)
        model, scan = SENSOR_MODELS[self.scan.kind], self.scan
        measured = [model.measure(self.prediction.mean + x, scan.sensor_pose, scan.sensor_velocity) for x in points.T]
        deviation = difference(np.array(measured).T, self.predicted_measurement[:, None], model.angular)
        deviation = deviation - (deviation @ weights)[:, None]
        return points * weights @ deviation.T, deviation * weights @ deviation.T

    def posterior(self, measurement: Array) -> Estimate | None:
        """Return the estimate after a measurement; None where the tracker fails or its estimate is not finite.

        Raises:
            StepFailed: the tracker's process ended.
        """
        key = _key(measurement)
        if key not in self._posteriors:
            self._posteriors[key] = self._try(np.array(key))
        return self._posteriors[key]

    def _try_together(self, measurements: list[Array]) -> None:
        """Try several measurements in one step of a batched tracker, if its batch has a column for each."""
        measurements = [measurement for measurement in measurements if _key(measurement) not in self._posteriors]
        if not 1 < len(measurements) <= self.session.peek_limit or self.repeats > 1:
            return
        # A failed step does not say at which measurement: they are then tried one by one.
        with suppress(StepFailed):
            scans = [self.scan._replace(measurement=measurement) for measurement in measurements]
            for measurement, estimate in zip(measurements, self.session.peek_each(scans), strict=True):
                usable = estimate is not None and finite(estimate)
                self._posteriors[_key(measurement)] = estimate if usable else None

    def _try(self, measurement: Array) -> Estimate | None:
        try:
            estimate = average_answers(self.session, self.scan._replace(measurement=measurement), self.repeats)
        except StepFailed as failure:
            if failure.fault.kind == "died":
                raise
            return None
        return estimate if estimate is not None and finite(estimate) else None

    def offset(self) -> Array | None:
        """Return the measurement ``(m,)`` that leaves the mean as it is, minus the predicted one; None if not found."""
        measurement = self.predicted_measurement.copy()
        for _ in range(6):
            update = self.update(measurement)
            if update is None or not update.used.any():
                return None
            step = np.nan_to_num(update.innovation) * self.sigma
            measurement = measurement - step
            if np.max(np.abs(step) / self.sigma) < 0.02:
                return measurement - self.predicted_measurement
        return None

    def linear_update(self) -> TrialUpdate | None:
        """Return the update with a measurement equal to the predicted one.

        None where the measurement model is too curved, or no component of the measurement moves the estimate.
        """
        update = self.update(self.predicted_measurement) if self.nearly_linear else None
        return update if update is not None and update.used.any() else None

    def update(self, measurement: Array) -> TrialUpdate | None:
        """Return the tracker's update with a measurement; None where this or a neighbouring one gives no estimate."""
        key = _key(measurement)
        if key not in self._updates:
            self._updates[key] = self._differentiate(np.array(key))
        return self._updates[key]

    def _differentiate(self, measurement: Array) -> TrialUpdate | None:
        steps = np.diag((GAIN_STEP if self.repeats == 1 else DRAWN_STEP) * self.sigma)
        self._try_together([measurement, *(measurement + step for step in (*steps, *-steps))])
        centre = self.posterior(measurement)
        if centre is None:
            return None
        columns = []
        for i, step in enumerate(steps):
            slopes = []
            for side in (step, -step):
                estimate = self.posterior(measurement + side)
                if estimate is None:
                    return None
                slopes.append((estimate.mean - centre.mean) / side[i])
            # An angle may jump on one side.
            one_sided = min(slopes, key=lambda slope: float(np.abs(slope).max()))
            columns.append(one_sided if self.repeats == 1 else (slopes[0] + slopes[1]) / 2)
        return TrialUpdate(centre, np.stack(columns, axis=1), self)


def _key(measurement: Array) -> tuple[float, ...]:
    return tuple(float(value) for value in measurement)


def average_answers(session: TrackerSession, scan: Scan, repeats: int) -> Estimate | None:
    """Return the mean of ``repeats`` estimates after a scan, each by a copy of the session; None if there is none."""
    first = session.peek(scan)
    if first is None or repeats == 1:
        return first
    answers = [first, *(answer for _ in range(repeats - 1) if (answer := session.peek(scan)) is not None)]
    return Estimate(
        np.mean([estimate.mean for estimate in answers], axis=0),
        np.mean([estimate.covariance for estimate in answers], axis=0),
    )


@dataclass(frozen=True, eq=False)
class TrialUpdate:
    """A tracker's update with one measurement, and the gain that neighbouring measurements show."""

    estimate: Estimate
    gain: Array
    """Derivative ``(4, m)`` of the estimated mean with respect to the measurement, from finite differences."""
    trial: Trial

    @cached_property
    def relative_gain(self) -> Array:
        """Gain ``(4, m)`` in standard deviations of the prediction per standard deviation of the measurement."""
        return self.gain * self.trial.sigma / self.trial.state_sigma[:, None]

    @cached_property
    def used(self) -> Mask:
        """Whether each component of the measurement moves the estimate, ``(m,)``."""
        size = np.linalg.norm(self.relative_gain, axis=0)
        return np.asarray(size > NO_GAIN * max(1.0, float(size.max())))

    @cached_property
    def innovation(self) -> Array:
        """Innovation ``(m,)`` that the tracker applied, in standard deviations of the measurement.

        The gain times this innovation moves the prediction to the estimate. Components that move nothing are NaN.
        """
        moved = (self.estimate.mean - self.trial.prediction.mean) / self.trial.state_sigma
        innovation = np.full(len(self.used), np.nan)
        if self.used.any():
            innovation[self.used] = np.linalg.pinv(self.relative_gain[:, self.used], rcond=1e-9) @ moved
        return innovation

    @cached_property
    def information(self) -> Array | None:
        """``P^-1 K`` ``(4, m)``, in a Kalman filter ``H^T R^-1``; None unless the updated P is positive definite."""
        p = linalg.symmetrise(self.estimate.covariance)
        if not np.linalg.eigvalsh(p)[0] > 0.0:
            return None
        return np.asarray(np.linalg.solve(p, self.gain))
