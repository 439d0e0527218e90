"""Hypothetical measurements given to a tracker, and what they do to its estimate."""

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
#: The same where answers are averaged over different random numbers.
DRAWN_STEP = 1.5
#: Curvature of the measurement model above which correct gains may differ from that of the Jacobian, in sigma.
CURVED = 0.3
#: Innovation that counts as zero, in standard deviations of the measurement. The second-order terms of a sigma-point
#: filter stay below a third of one.
ZERO = 0.75
#: A gain below this, relative to the largest, counts as zero.
NO_GAIN = 1e-6
#: Roots and weights of the three-point Gauss-Hermite rule for a standard normal variable.
ROOTS, WEIGHTS = (-np.sqrt(3.0), 0.0, np.sqrt(3.0)), (1 / 6, 2 / 3, 1 / 6)


@dataclass(frozen=True, eq=False)
class Trial:
    """A tracker just before a measurement. Any measurement can be tried; none of them changes the tracker."""

    name: str
    """Of the probe or test drive."""
    description: str
    """Of the same."""
    scan: Scan
    """With the sensor's measurement of the true target."""
    prediction: Estimate
    """The tracker's, at the time of the scan."""
    session: TrackerSession
    repeats: int = 1
    """How many answers are averaged."""
    sensor_set: tuple[str, ...] = ()
    """The sensors with which the target was followed before."""
    _posteriors: dict[tuple[float, ...], Estimate | None] = field(default_factory=dict)
    _updates: dict[tuple[float, ...], TrialUpdate | None] = field(default_factory=dict)

    @property
    def usable(self) -> bool:
        """Whether the prediction is finite, not absurdly far off, and has positive variances."""
        p = self.prediction
        return finite(p) and bool(np.abs(p.mean).max() < FAR) and bool(np.diag(p.covariance).min() > 0.0)

    @cached_property
    def sigma(self) -> Array:
        """``(m,)`` stated standard deviations of the measurement."""
        return np.sqrt(np.diag(self.scan.noise_covariance))

    @cached_property
    def state_sigma(self) -> Array:
        """``(4,)`` standard deviations of the prediction."""
        return np.sqrt(np.diag(self.prediction.covariance))

    @property
    def gain_scale(self) -> Array:
        """``(4, m)`` by which a gain is multiplied to be in standard deviations."""
        return self.sigma / self.state_sigma[:, None]

    @property
    def variance_scale(self) -> Array:
        """``(4, 4)`` by which a covariance is divided to be in variances of the prediction."""
        return np.outer(self.state_sigma, self.state_sigma)

    @cached_property
    def predicted_measurement(self) -> Array:
        """``(m,)`` the measurement of the predicted mean, by the right measurement model."""
        return SENSOR_MODELS[self.scan.kind].measure(
            self.prediction.mean, self.scan.sensor_pose, self.scan.sensor_velocity
        )

    @cached_property
    def jacobian(self) -> Array:
        """``(m, 4)`` of the right measurement model at the predicted mean."""
        return SENSOR_MODELS[self.scan.kind].jacobian(
            self.prediction.mean, self.scan.sensor_pose, self.scan.sensor_velocity
        )

    @cached_property
    def curvature(self) -> Array:
        """``(m,)`` standard deviation of the measurement model's second-order term, in those of the measurement.

        ``sqrt(tr(A P A P) / 2)`` with the second derivative ``A`` (Bar-Shalom, Li and Kirubarajan 2001, section
        10.3.2). Where it is large, correct sigma-point filters and correct EKFs differ.
        """
        product = np.einsum("iab,bc->iac", self._second_derivative, linalg.symmetrise(self.prediction.covariance))
        return np.asarray(np.sqrt(np.maximum(np.einsum("iab,iba->i", product, product), 0.0) / 2) / self.sigma)

    @property
    def nearly_linear(self) -> bool:
        """Whether the curvature of every component is small."""
        return bool(self.curvature.max() < CURVED)

    @cached_property
    def second_order(self) -> Array:
        """``(m,)`` ``tr(A P) / 2``: by how much the mean of the measurement differs from that of the predicted mean."""
        return np.asarray(0.5 * np.einsum("iab,ba->i", self._second_derivative, self.prediction.covariance))

    @cached_property
    def _second_derivative(self) -> Array:
        """``(m, 4, 4)`` by differences of the Jacobian."""
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
        """``(4, m)`` covariance of the Gaussian prediction with its measurement, and ``(m, m)`` that of the measurement
        without noise, by the Gauss-Hermite rule of 81 points: what the sums over sigma points approximate (Arasaratnam,
        Haykin and Elliott 2007)."""
        values, vectors = np.linalg.eigh(linalg.symmetrise(self.prediction.covariance))
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        points = root @ np.array(list(product(ROOTS, repeat=4))).T
        weights = np.prod(list(product(WEIGHTS, repeat=4)), axis=1)
        model, scan = SENSOR_MODELS[self.scan.kind], self.scan
        seen = [model.measure(self.prediction.mean + x, scan.sensor_pose, scan.sensor_velocity) for x in points.T]
        apart = difference(np.array(seen).T, self.predicted_measurement[:, None], model.angular)
        apart = apart - (apart @ weights)[:, None]
        return points * weights @ apart.T, apart * weights @ apart.T

    def posterior(self, measurement: Array) -> Estimate | None:
        """The estimate after a measurement; None where the tracker fails or its estimate is not finite.

        Raises:
            StepFailed: its process ended.
        """
        key = _key(measurement)
        if key not in self._posteriors:
            self._posteriors[key] = self._asked(np.array(key))
        return self._posteriors[key]

    def _ask_at_once(self, measurements: list[Array]) -> None:
        """Try measurements in one request, where the session can be asked that many."""
        measurements = [one for one in measurements if _key(one) not in self._posteriors]
        if not 1 < len(measurements) <= self.session.at_once or self.repeats > 1:
            return
        # A step that fails tells not at which of them: they are tried one by one.
        with suppress(StepFailed):
            found = self.session.peek_each([self.scan._replace(measurement=one) for one in measurements])
            for one, estimate in zip(measurements, found, strict=True):
                usable = estimate is not None and finite(estimate)
                self._posteriors[_key(one)] = estimate if usable else None

    def _asked(self, measurement: Array) -> Estimate | None:
        try:
            estimate = averaged(self.session, self.scan._replace(measurement=measurement), self.repeats)
        except StepFailed as failure:
            if failure.fault.kind == "died":
                raise
            return None
        return estimate if estimate is not None and finite(estimate) else None

    def offset(self) -> Array | None:
        """``(m,)`` the measurement without an innovation, minus the predicted measurement; None where unknown."""
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
        """The update with the predicted measurement; None where the model is curved, or no component counts."""
        update = self.update(self.predicted_measurement) if self.nearly_linear else None
        return update if update is not None and update.used.any() else None

    def update(self, measurement: Array) -> TrialUpdate | None:
        """The estimate and the gain at a measurement; None where ``posterior`` is."""
        key = _key(measurement)
        if key not in self._updates:
            self._updates[key] = self._differentiated(np.array(key))
        return self._updates[key]

    def _differentiated(self, measurement: Array) -> TrialUpdate | None:
        steps = np.diag((GAIN_STEP if self.repeats == 1 else DRAWN_STEP) * self.sigma)
        self._ask_at_once([measurement, *(measurement + step for step in (*steps, *-steps))])
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


def averaged(session: TrackerSession, scan: Scan, repeats: int) -> Estimate | None:
    """What the session would return after a scan: the mean of so many answers."""
    first = session.peek(scan)
    if first is None or repeats == 1:
        return first
    answers = [first, *(one for _ in range(repeats - 1) if (one := session.peek(scan)) is not None)]
    return Estimate(
        np.mean([estimate.mean for estimate in answers], axis=0),
        np.mean([estimate.covariance for estimate in answers], axis=0),
    )


@dataclass(frozen=True, eq=False)
class TrialUpdate:
    """A tracker's update with one measurement."""

    estimate: Estimate
    gain: Array
    """``(4, m)`` derivative of the estimate by the measurement, by finite differences."""
    trial: Trial

    @cached_property
    def relative_gain(self) -> Array:
        """``(4, m)`` the gain in standard deviations of the prediction per standard deviation of the measurement."""
        return self.gain * self.trial.sigma / self.trial.state_sigma[:, None]

    @cached_property
    def used(self) -> Mask:
        """``(m,)`` which components of the measurement move the estimate."""
        size = np.linalg.norm(self.relative_gain, axis=0)
        return np.asarray(size > NO_GAIN * max(1.0, float(size.max())))

    @cached_property
    def innovation(self) -> Array:
        """``(m,)`` the innovation that the tracker applied, in standard deviations of the measurement.

        It is the one by which the gain moves the prediction to the estimate; NaN in unused components.
        """
        moved = (self.estimate.mean - self.trial.prediction.mean) / self.trial.state_sigma
        found = np.full(len(self.used), np.nan)
        if self.used.any():
            found[self.used] = np.linalg.pinv(self.relative_gain[:, self.used], rcond=1e-9) @ moved
        return found

    @cached_property
    def information(self) -> Array | None:
        """``(4, m)`` ``P^-1 K``, which is ``H^T R^-1`` in a Kalman filter; None where P is not positive definite."""
        p = linalg.symmetrise(self.estimate.covariance)
        if not np.linalg.eigvalsh(p)[0] > 0.0:
            return None
        return np.asarray(np.linalg.solve(p, self.gain))
