"""Kalman filters: linear, extended, iterated extended, and with sigma points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Scan
from trackbench.base.units import difference
from trackbench.filters.base import (
    Belief,
    Measured,
    PredictedMeasurement,
    Remainder,
    SingleModelFilter,
    Update,
    correct,
    linear_update,
    square_root,
    with_factor,
    wrap_components,
)
from trackbench.models.motion import MotionModel, process_noise_covariance
from trackbench.models.motion.base import scaled_noise_gain
from trackbench.models.sensors import SENSOR_MODELS, Sensor


@lru_cache(maxsize=256)
def _constant(motion: MotionModel, dt: float) -> tuple[Array, Array]:
    """Return transition matrix and process noise of a linear motion model, which are equal for every state."""
    anywhere = np.zeros(len(motion.components))
    return motion.jacobian(anywhere, dt), process_noise_covariance(motion, anywhere, dt)


@dataclass(frozen=True)
class LinearisedFilter(SingleModelFilter):
    """Base of the filters that linearise motion and measurement by Jacobians."""

    def predict(self, belief: Belief, dt: float) -> Belief:
        """Predict the belief ``dt`` seconds ahead, by ``P <- F P F^T + Q`` (Särkkä 2013, equation 5.26)."""
        motion, x, p = self.motion, belief.mean, belief.covariance
        if motion.linear and not motion.batched and isinstance(dt, float):
            f, q = _constant(motion, dt)
        else:
            f, q = motion.jacobian(x, dt), process_noise_covariance(motion, x, dt)
        mean = wrap_components(motion.transition(x, dt), motion.angular)
        return Belief(mean, linalg.rounded_up(linalg.quadratic(f, p) + linalg.expand(q, p)))

    def cross_covariance(self, belief: Belief, dt: float) -> Array:
        """Return ``P F^T``, the covariance of the states now and ``dt`` later (Särkkä 2013, algorithm 9.1)."""
        f = self.motion.jacobian(belief.mean, dt)
        return linalg.matmul_transposed(belief.covariance, linalg.expand(f, belief.covariance))

    def predict_measurement(self, belief: Belief, scan: Scan) -> PredictedMeasurement:
        return self._predict_with_spread(with_factor(belief), scan)[0]

    def update(self, belief: Belief, scan: Scan, predicted: PredictedMeasurement | None = None) -> Update[Belief]:
        measured, remainder = self.measured(scan), None
        if predicted is None:
            belief = with_factor(belief)
            predicted, seen = self._predict_with_spread(belief, scan)
            remainder = square_root(factor_of(belief), seen, measured.noise)
        return linear_update(belief, predicted, measured, scan.valid, self.motion.angular, remainder)

    def _predict_with_spread(self, belief: Belief, scan: Scan) -> tuple[PredictedMeasurement, Array]:
        """Predict the measurement; return also ``H L`` ``(m, n, ...)``, with ``L`` the belief's Cholesky factor."""
        expected, h = observe(self.motion, SENSOR_MODELS[scan.kind], belief.mean, scan)
        factor = factor_of(belief)
        seen = linalg.matmul(h, factor)
        spread, cross = linalg.matmul_transposed(seen, seen), linalg.matmul_transposed(seen, factor)
        return PredictedMeasurement(expected, spread, cross), seen


@dataclass(frozen=True)
class KalmanFilter(LinearisedFilter):
    """Kalman filter with a linear motion model; measurements are converted to a position with its covariance.

    Source: Kalman (1960). The range rate of a radar is not linear in the state and is left out.
    """

    def measured(self, scan: Scan) -> Measured:
        position = SENSOR_MODELS[scan.kind].position(scan)
        like = position.mean[None]
        noise = np.where(scan.valid, linalg.expand(position.covariance, like), linalg.expand(np.eye(2), like))
        return Measured(position.mean, noise, ())

    def _predict_with_spread(self, belief: Belief, scan: Scan) -> tuple[PredictedMeasurement, Array]:
        p = belief.covariance
        return PredictedMeasurement(belief.mean[:2], p[:2, :2], p[:2]), factor_of(belief)[:2]


@dataclass(frozen=True)
class ExtendedKalmanFilter(LinearisedFilter):
    """Extended Kalman filter of first order.

    Source: Särkkä (2013), "Bayesian Filtering and Smoothing", algorithm 5.4.
    """


@dataclass(frozen=True)
class IteratedExtendedKalmanFilter(LinearisedFilter):
    """Extended Kalman filter that repeats the linearisation at each corrected state (Gauss-Newton).

    Source: Bell and Cathey (1993), "The iterated Kalman filter update as a Gauss-Newton method", equation 22.
    """

    iterations: int = 5

    def update(self, belief: Belief, scan: Scan, predicted: PredictedMeasurement | None = None) -> Update[Belief]:
        sensor, angular, belief = SENSOR_MODELS[scan.kind], self.motion.angular, with_factor(belief)
        noise = self.measured(scan).noise
        at, factor = belief.mean, factor_of(belief)
        first: Update[Belief] | None = None
        for number in range(self.iterations):
            expected, h = observe(self.motion, sensor, at, scan)
            back = difference(belief.mean, at, angular)
            innovation = difference(scan.measurement, expected, sensor.angular) - linalg.matvec(h, back)
            seen = linalg.matmul(h, factor)
            cross, spread = linalg.matmul_transposed(seen, factor), linalg.matmul_transposed(seen, seen)
            s = spread + linalg.expand(noise, cross)
            # Only the last linearisation changes the covariance.
            last = number == self.iterations - 1
            remainder = square_root(factor, seen, noise) if last else lambda _: belief.covariance
            update = correct(belief, innovation, s, cross, scan.valid, angular, remainder)
            # The innovation compares the measurement with the prediction, at which the first linearisation is made.
            first = first or update
            at = update.belief.mean
        assert first is not None
        return first._replace(belief=update.belief)


def observe(motion: MotionModel, sensor: type[Sensor], x: Array, scan: Scan) -> tuple[Array, Array]:
    """Return the measurement ``(m, ...)`` predicted from a state ``(n, ...)``, and its derivative ``(m, n, ...)``."""
    target = motion.to_cartesian(x)
    expected = sensor.measure(target, scan.sensor_pose, scan.sensor_velocity)
    h = sensor.jacobian(target, scan.sensor_pose, scan.sensor_velocity)
    slope = motion.cartesian_jacobian(x)
    h = h if slope.shape == (4, 4) else linalg.matmul(h, slope)
    errors = motion.sensor_errors(scan)
    if errors is None:
        return expected, h
    gain = errors.gain
    return expected + linalg.matvec(gain, x), linalg.expand(h, gain) + linalg.expand(gain, h)


def factor_of(belief: Belief) -> Array:
    """Return the Cholesky factor ``(n, n, ...)`` of a belief that stores one."""
    assert belief.factor is not None
    return belief.factor


@dataclass(frozen=True)
class SymmetricSet:
    """Rule for sigma points: the mean, and a pair of points along each column of the covariance's Cholesky factor.

    Source: Julier (2002), "The scaled unscented transformation". With alpha 1, beta 0 and ``kappa`` None the points are
    the original ones of Julier and Uhlmann (1997), equations 11 and 12.
    """

    alpha: float
    beta: float
    kappa: float | None
    """Scaling parameter kappa of the unscented transformation; None for three minus the dimension."""

    def weights(self, dimension: int) -> tuple[float, float, float, float]:
        """Return the distance of the points from the mean, in standard deviations, and three weights of points.

        The weights are the mean point's in means, the mean point's in covariances, and any other point's.
        """
        kappa = 3.0 - dimension if self.kappa is None else self.kappa
        scaled = self.alpha**2 * (dimension + kappa)
        centre = (scaled - dimension) / scaled
        return np.sqrt(scaled), centre, centre + 1.0 - self.alpha**2 + self.beta, 0.5 / scaled


#: Third-degree spherical-radial cubature: the centre has no weight. Source: Arasaratnam and Haykin (2009).
CUBATURE = SymmetricSet(1.0, 0.0, 0.0)


@dataclass(frozen=True)
class SigmaPointFilter(SingleModelFilter):
    """Unscented Kalman filter, or cubature Kalman filter with the rule ``CUBATURE``.

    If ``augmented``, the driving noise is part of the state whose points go through the transition, and the update uses
    the predicted points. Otherwise the process noise is added to the predicted covariance, which gives new points.
    Source: Wan and van der Merwe (2000), algorithm 2.1; Särkkä (2013), algorithms 5.14 and 5.15.
    """

    rule: SymmetricSet
    augmented: bool = True

    def predict(self, belief: Belief, dt: float) -> Belief:
        motion = self.motion
        belief = belief if belief.factor is not None else with_factor(belief)
        noises = self._noise_count
        distance, _, centre_weight, weight = self.rule.weights(len(belief.mean) + noises)
        moved = motion.transition(_points(belief, distance), dt)
        if noises:
            push = distance * linalg.expand(scaled_noise_gain(motion, belief.mean, dt), belief.mean[:, None])
            moved = np.concatenate([moved, moved[:, :1] + push, moved[:, :1] - push], axis=1)
        deviations = difference(moved, moved[:, :1], motion.angular)
        shift = weight * deviations.sum(axis=1)
        deviations -= shift[:, None]
        covariance = _weighted(deviations, deviations, centre_weight, weight)
        if not noises:
            covariance += linalg.expand(process_noise_covariance(motion, belief.mean, dt), covariance)
        mean = wrap_components(moved[:, 0] + shift, motion.angular)
        return Belief(mean, linalg.rounded_up(covariance), points=moved if noises else None, repaired=belief.repaired)

    def cross_covariance(self, belief: Belief, dt: float) -> Array:
        belief, size = with_factor(belief), len(belief.mean)
        distance, _, _, weight = self.rule.weights(size + self._noise_count)
        moved = self.motion.transition(_points(belief, distance), dt)
        away = difference(moved, moved[:, :1], self.motion.angular)
        # The other points, the centre and those of the noises, have no deviation in the state before.
        across = away[:, 1 : size + 1] - away[:, size + 1 :]
        return weight * distance * linalg.matmul_transposed(factor_of(belief), across)

    def predict_measurement(self, belief: Belief, scan: Scan) -> PredictedMeasurement:
        return self._predict_with_spread(belief, scan)[0]

    def _predict_with_spread(self, belief: Belief, scan: Scan) -> tuple[PredictedMeasurement, Remainder]:
        motion, sensor = self.motion, SENSOR_MODELS[scan.kind]
        points = belief.points
        if points is None:
            belief = with_factor(belief)
            columns = self.rule.weights(len(belief.mean))[0] * factor_of(belief)
            state_deviations = np.concatenate([np.zeros_like(columns[:, :1]), columns, -columns], axis=1)
            points = belief.mean[:, None] + state_deviations
        else:
            state_deviations = difference(points, belief.mean[:, None], motion.angular)
        _, _, centre_weight, weight = self.rule.weights((points.shape[1] - 1) // 2)
        weighted = partial(_weighted, centre=centre_weight, other=weight)
        seen = sensor.measure(motion.to_cartesian(points), scan.sensor_pose, scan.sensor_velocity)
        errors = motion.sensor_errors(scan)
        if errors is not None:
            seen = seen + linalg.matvec(linalg.expand(errors.gain[:, :, None], points[None]), points)
        deviations = difference(seen, seen[:, :1], sensor.angular)
        shift = weight * deviations.sum(axis=1)
        deviations -= shift[:, None]
        spread, cross = weighted(deviations, deviations), weighted(deviations, state_deviations)
        predicted = PredictedMeasurement(seen[:, 0] + shift, linalg.symmetrise(spread), cross)
        return predicted, square_root(state_deviations, deviations, self.measured(scan).noise, weighted)

    def update(self, belief: Belief, scan: Scan, predicted: PredictedMeasurement | None = None) -> Update[Belief]:
        belief, remainder = belief if belief.points is not None else with_factor(belief), None
        if predicted is None:
            predicted, remainder = self._predict_with_spread(belief, scan)
        update = linear_update(belief, predicted, self.measured(scan), scan.valid, self.motion.angular, remainder)
        return update._replace(belief=with_factor(update.belief))

    @property
    def _noise_count(self) -> int:
        return len(self.motion.noise_sigma) if self.augmented else 0


def _points(belief: Belief, distance: float) -> Array:
    """Return sigma points ``(n, 2 n + 1, ...)``: the mean, the first point of each pair, the second points."""
    centre = belief.mean[:, None]
    columns = distance * factor_of(belief)
    return np.concatenate([centre, centre + columns, centre - columns], axis=1)


def _weighted(a: Array, b: Array, centre: float, other: float) -> Array:
    """Sum ``w_s a_s b_s^T`` over deviations ``(n, s, ...)`` and ``(m, s, ...)``; the mean point comes first."""
    outer = linalg.matmul_transposed(a[:, 1:], b[:, 1:]) * other
    if centre == 0.0:
        return outer
    return outer + centre * a[:, None, 0] * b[None, :, 0]
