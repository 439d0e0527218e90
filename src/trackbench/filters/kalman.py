"""The Kalman filter and its extensions by linearisation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from trackbench import linalg
from trackbench.filters.base import Belief, Update, correct, guarded, wrap_components
from trackbench.models.motion import MotionModel, process_noise
from trackbench.models.sensors import SENSOR_MODELS, Sensor
from trackbench.types import Array, Scan
from trackbench.units import difference


def predict_linearised(motion: MotionModel, belief: Belief, dt: float) -> Belief:
    """Time update with the transition's Jacobian: ``P <- F P F^T + Q`` (Särkkä 2013, equation 5.26)."""
    x, p = belief.mean, belief.covariance
    if motion.linear:
        f, q = _constant(motion, dt)
    else:
        f, q = motion.jacobian(x, dt), process_noise(motion, x, dt)
    mean = wrap_components(motion.transition(x, dt), motion.angular)
    return Belief(mean, linalg.symmetrise(linalg.quadratic(f, p)) + linalg.expand(q, p))


@lru_cache(maxsize=256)
def _constant(motion: MotionModel, dt: float) -> tuple[Array, Array]:
    """Transition and process noise of a linear model, which are the same for every state."""
    anywhere = np.zeros(len(motion.components))
    return motion.jacobian(anywhere, dt), process_noise(motion, anywhere, dt)


@dataclass(frozen=True)
class KalmanFilter:
    """The Kalman filter: a linear motion model, and measurements converted to a position with its covariance.

    Source: Kalman (1960). The range rate of a radar is not linear in the state and is left out.
    """

    motion: MotionModel

    def predict(self, belief: Belief, dt: float) -> Belief:
        return predict_linearised(self.motion, belief, dt)

    def update(self, belief: Belief, scan: Scan) -> Update:
        position = SENSOR_MODELS[scan.kind].position(scan)
        x, p = belief.mean, belief.covariance
        noise = linalg.expand(position.covariance, p)
        s = p[:2, :2] + np.where(scan.valid, noise, linalg.expand(np.eye(2), p))
        update = correct(belief, position.mean - x[:2], s, p[:2], scan.valid, ())
        return update._replace(belief=kept_definite(update.belief))


@dataclass(frozen=True)
class ExtendedKalmanFilter:
    """The extended Kalman filter of first order.

    Source: Särkkä (2013), "Bayesian Filtering and Smoothing", algorithm 5.4.
    """

    motion: MotionModel

    def predict(self, belief: Belief, dt: float) -> Belief:
        return predict_linearised(self.motion, belief, dt)

    def update(self, belief: Belief, scan: Scan) -> Update:
        sensor = SENSOR_MODELS[scan.kind]
        expected, h = observe(self.motion, sensor, belief.mean, scan)
        innovation = difference(scan.measurement, expected, sensor.angular)
        cross = linalg.matmul(h, belief.covariance)
        s = linalg.matmul_transposed(cross, h) + linalg.expand(scan.noise_covariance, cross)
        update = correct(belief, innovation, s, cross, scan.valid, self.motion.angular)
        return update._replace(belief=kept_definite(update.belief))


@dataclass(frozen=True)
class IteratedExtendedKalmanFilter:
    """The extended Kalman filter, its measurement linearised again at each corrected state (Gauss-Newton).

    Source: Bell and Cathey (1993), "The iterated Kalman filter update as a Gauss-Newton method", equation 22.
    """

    motion: MotionModel
    iterations: int = 5

    def predict(self, belief: Belief, dt: float) -> Belief:
        return predict_linearised(self.motion, belief, dt)

    def update(self, belief: Belief, scan: Scan) -> Update:
        sensor = SENSOR_MODELS[scan.kind]
        angular = self.motion.angular
        at = belief.mean
        first: Update | None = None
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
