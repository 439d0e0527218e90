"""The Kalman filter and its extensions by linearisation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Scan
from trackbench.base.units import difference
from trackbench.filters.base import (
    Belief,
    Measured,
    PredictedMeasurement,
    SingleModelFilter,
    Update,
    correct,
    guarded,
    linear_update,
    wrap_components,
)
from trackbench.models.motion import MotionModel, process_noise
from trackbench.models.sensors import SENSOR_MODELS, Sensor


def predict_linearised(motion: MotionModel, belief: Belief, dt: float) -> Belief:
    """Time update with the transition's Jacobian: ``P <- F P F^T + Q`` (Särkkä 2013, equation 5.26)."""
    x, p = belief.mean, belief.covariance
    if motion.linear and not motion.batched and isinstance(dt, float):
        f, q = _constant(motion, dt)
    else:
        f, q = motion.jacobian(x, dt), process_noise(motion, x, dt)
    mean = wrap_components(motion.transition(x, dt), motion.angular)
    return Belief(mean, linalg.symmetrise(linalg.quadratic(f, p)) + linalg.expand(q, p))


def linearised_cross(motion: MotionModel, belief: Belief, dt: float) -> Array:
    """Covariance of the state before and after ``dt``: ``P F^T`` (Särkkä 2013, algorithm 9.1)."""
    f = motion.jacobian(belief.mean, dt)
    return linalg.matmul_transposed(belief.covariance, linalg.expand(f, belief.covariance))


@lru_cache(maxsize=256)
def _constant(motion: MotionModel, dt: float) -> tuple[Array, Array]:
    """Transition and process noise of a linear model, which are the same for every state."""
    anywhere = np.zeros(len(motion.components))
    return motion.jacobian(anywhere, dt), process_noise(motion, anywhere, dt)


@dataclass(frozen=True)
class KalmanFilter(SingleModelFilter):
    """The Kalman filter: a linear motion model, and measurements converted to a position with its covariance.

    Source: Kalman (1960). The range rate of a radar is not linear in the state and is left out.
    """

    def predict(self, belief: Belief, dt: float) -> Belief:
        return predict_linearised(self.motion, belief, dt)

    def cross_covariance(self, belief: Belief, dt: float) -> Array:
        return linearised_cross(self.motion, belief, dt)

    def measured(self, scan: Scan) -> Measured:
        position = SENSOR_MODELS[scan.kind].position(scan)
        like = position.mean[None]
        noise = np.where(scan.valid, linalg.expand(position.covariance, like), linalg.expand(np.eye(2), like))
        return Measured(position.mean, noise, ())

    def predict_measurement(self, belief: Belief, scan: Scan) -> PredictedMeasurement:
        p = belief.covariance
        return PredictedMeasurement(belief.mean[:2], p[:2, :2], p[:2])

    def update(self, belief: Belief, scan: Scan, predicted: PredictedMeasurement | None = None) -> Update[Belief]:
        predicted = predicted or self.predict_measurement(belief, scan)
        update = linear_update(belief, predicted, self.measured(scan), scan.valid, ())
        return update._replace(belief=kept_definite(update.belief))


@dataclass(frozen=True)
class ExtendedKalmanFilter(SingleModelFilter):
    """The extended Kalman filter of first order.

    Source: Särkkä (2013), "Bayesian Filtering and Smoothing", algorithm 5.4.
    """

    def predict(self, belief: Belief, dt: float) -> Belief:
        return predict_linearised(self.motion, belief, dt)

    def cross_covariance(self, belief: Belief, dt: float) -> Array:
        return linearised_cross(self.motion, belief, dt)

    def measured(self, scan: Scan) -> Measured:
        return as_measured(scan)

    def predict_measurement(self, belief: Belief, scan: Scan) -> PredictedMeasurement:
        return linearised_measurement(self.motion, belief, scan)

    def update(self, belief: Belief, scan: Scan, predicted: PredictedMeasurement | None = None) -> Update[Belief]:
        predicted = predicted or self.predict_measurement(belief, scan)
        update = linear_update(belief, predicted, self.measured(scan), scan.valid, self.motion.angular)
        return update._replace(belief=kept_definite(update.belief))


@dataclass(frozen=True)
class IteratedExtendedKalmanFilter(SingleModelFilter):
    """The extended Kalman filter, its measurement linearised again at each corrected state (Gauss-Newton).

    Source: Bell and Cathey (1993), "The iterated Kalman filter update as a Gauss-Newton method", equation 22.
    """

    iterations: int = 5

    def predict(self, belief: Belief, dt: float) -> Belief:
        return predict_linearised(self.motion, belief, dt)

    def cross_covariance(self, belief: Belief, dt: float) -> Array:
        return linearised_cross(self.motion, belief, dt)

    def measured(self, scan: Scan) -> Measured:
        return as_measured(scan)

    def predict_measurement(self, belief: Belief, scan: Scan) -> PredictedMeasurement:
        return linearised_measurement(self.motion, belief, scan)

    def update(self, belief: Belief, scan: Scan, predicted: PredictedMeasurement | None = None) -> Update[Belief]:
        sensor = SENSOR_MODELS[scan.kind]
        angular = self.motion.angular
        at = belief.mean
        first: Update[Belief] | None = None
        for _ in range(self.iterations):
            expected, h = observe(self.motion, sensor, at, scan)
            back = difference(belief.mean, at, angular)
            innovation = difference(scan.measurement, expected, sensor.angular) - linalg.apply(h, back)
            cross = linalg.matmul(h, belief.covariance)
            s = linalg.matmul_transposed(cross, h) + linalg.expand(scan.noise_covariance, cross)
            update = correct(belief, innovation, s, cross, scan.valid, angular)
            # What the measurement said is judged against the prediction, which is the first linearisation.
            first = first or update
            at = update.belief.mean
        assert first is not None
        return first._replace(belief=kept_definite(update.belief))


def as_measured(scan: Scan) -> Measured:
    """The measurements of a scan as the sensor gives them."""
    return Measured(scan.measurement, scan.noise_covariance, SENSOR_MODELS[scan.kind].angular)


def linearised_measurement(motion: MotionModel, belief: Belief, scan: Scan) -> PredictedMeasurement:
    """The expected measurement, by the measurement's derivative at the mean."""
    expected, h = observe(motion, SENSOR_MODELS[scan.kind], belief.mean, scan)
    cross = linalg.matmul(h, belief.covariance)
    return PredictedMeasurement(expected, linalg.matmul_transposed(cross, h), cross)


def observe(motion: MotionModel, sensor: type[Sensor], x: Array, scan: Scan) -> tuple[Array, Array]:
    """The expected measurement ``(m, ...)`` of a state ``(n, ...)`` and its derivative ``(m, n, ...)``."""
    target = motion.to_cartesian(x)
    expected = sensor.measure(target, scan.sensor_pose, scan.sensor_velocity)
    h = sensor.jacobian(target, scan.sensor_pose, scan.sensor_velocity)
    slope = motion.cartesian_jacobian(x)
    return expected, h if slope.shape == (4, 4) else linalg.matmul(h, slope)


def kept_definite(belief: Belief) -> Belief:
    """The belief, checked by its variances alone: the gain cannot make the covariance indefinite but by rounding."""
    variances = np.einsum("ii...->i...", belief.covariance)
    return guarded(belief) if np.any(variances <= 0.0) else belief
