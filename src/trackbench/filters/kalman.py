"""Kalman filters: linear, extended, iterated, and of sigma points."""

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
    guarded,
    linear_update,
    square_root,
    wrap_components,
)
from trackbench.models.motion import MotionModel, process_noise_covariance
from trackbench.models.motion.base import scaled_noise_gain
from trackbench.models.sensors import SENSOR_MODELS, Sensor


@lru_cache(maxsize=256)
def _constant(motion: MotionModel, dt: float) -> tuple[Array, Array]:
    """Transition and process noise of a linear model, which are the same for every state."""
    anywhere = np.zeros(len(motion.components))
    return motion.jacobian(anywhere, dt), process_noise_covariance(motion, anywhere, dt)


@dataclass(frozen=True)
class LinearisedFilter(SingleModelFilter):
    """What the filters share that linearise by Jacobians."""

    def predict(self, belief: Belief, dt: float) -> Belief:
        """Time update: ``P <- F P F^T + Q`` (Särkkä 2013, equation 5.26)."""
        motion, x, p = self.motion, belief.mean, belief.covariance
        if motion.linear and not motion.batched and isinstance(dt, float):
            f, q = _constant(motion, dt)
        else:
            f, q = motion.jacobian(x, dt), process_noise_covariance(motion, x, dt)
        mean = wrap_components(motion.transition(x, dt), motion.angular)
        return Belief(mean, linalg.rounded_up(linalg.quadratic(f, p) + linalg.expand(q, p)))

    def cross_covariance(self, belief: Belief, dt: float) -> Array:
        """Covariance of the state before and after ``dt``: ``P F^T`` (Särkkä 2013, algorithm 9.1)."""
        f = self.motion.jacobian(belief.mean, dt)
        return linalg.matmul_transposed(belief.covariance, linalg.expand(f, belief.covariance))

    def predict_measurement(self, belief: Belief, scan: Scan) -> PredictedMeasurement:
        return self._expected(guarded(belief), scan)[0]

    def update(self, belief: Belief, scan: Scan, predicted: PredictedMeasurement | None = None) -> Update[Belief]:
        measured, remainder = self.measured(scan), None
        if predicted is None:
            belief = guarded(belief)
            predicted, seen = self._expected(belief, scan)
            remainder = square_root(factor_of(belief), seen, measured.noise)
        return linear_update(belief, predicted, measured, scan.valid, self.motion.angular, remainder)

    def _expected(self, belief: Belief, scan: Scan) -> tuple[PredictedMeasurement, Array]:
        """What a belief with its factor ``L`` expects of a scan, and ``H L`` ``(m, n, ...)``."""
        expected, h = observe(self.motion, SENSOR_MODELS[scan.kind], belief.mean, scan)
        factor = factor_of(belief)
        seen = linalg.matmul(h, factor)
        spread, cross = linalg.matmul_transposed(seen, seen), linalg.matmul_transposed(seen, factor)
        return PredictedMeasurement(expected, spread, cross), seen


@dataclass(frozen=True)
class KalmanFilter(LinearisedFilter):
    """The Kalman filter: a linear motion model, and measurements converted to a position with its covariance.

    Source: Kalman (1960). The range rate of a radar is not linear in the state and is left out.
    """

    def measured(self, scan: Scan) -> Measured:
        position = SENSOR_MODELS[scan.kind].position(scan)
        like = position.mean[None]
        noise = np.where(scan.valid, linalg.expand(position.covariance, like), linalg.expand(np.eye(2), like))
        return Measured(position.mean, noise, ())

    def _expected(self, belief: Belief, scan: Scan) -> tuple[PredictedMeasurement, Array]:
        p = belief.covariance
        return PredictedMeasurement(belief.mean[:2], p[:2, :2], p[:2]), factor_of(belief)[:2]


@dataclass(frozen=True)
class ExtendedKalmanFilter(LinearisedFilter):
    """The extended Kalman filter of first order.

    Source: Särkkä (2013), "Bayesian Filtering and Smoothing", algorithm 5.4.
    """


@dataclass(frozen=True)
class IteratedExtendedKalmanFilter(LinearisedFilter):
    """The extended Kalman filter, its measurement linearised again at each corrected state (Gauss-Newton).

    Source: Bell and Cathey (1993), "The iterated Kalman filter update as a Gauss-Newton method", equation 22.
    """

    iterations: int = 5

    def update(self, belief: Belief, scan: Scan, predicted: PredictedMeasurement | None = None) -> Update[Belief]:
        sensor, angular, belief = SENSOR_MODELS[scan.kind], self.motion.angular, guarded(belief)
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
            # The covariance is that of the last linearisation.
            last = number == self.iterations - 1
            remainder = square_root(factor, seen, noise) if last else lambda _: belief.covariance
            update = correct(belief, innovation, s, cross, scan.valid, angular, remainder)
            # What the measurement said is judged against the prediction, which is the first linearisation.
            first = first or update
            at = update.belief.mean
        assert first is not None
        return first._replace(belief=update.belief)


def observe(motion: MotionModel, sensor: type[Sensor], x: Array, scan: Scan) -> tuple[Array, Array]:
    """The expected measurement ``(m, ...)`` of a state ``(n, ...)`` and its derivative ``(m, n, ...)``."""
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
    """The factor ``(n, n, ...)`` of a belief that has it."""
    assert belief.factor is not None
    return belief.factor


@dataclass(frozen=True)
class SymmetricSet:
    """A rule that places the central point and a pair of points along each column of the covariance's factor.

    Source: Julier (2002), "The scaled unscented transformation"; with alpha 1, beta 0 and no kappa the original points,
    Julier and Uhlmann (1997), equations 11 and 12.
    """

    alpha: float
    beta: float
    kappa: float | None
    """None: three minus the dimension."""

    def weights(self, dimension: int) -> tuple[float, float, float, float]:
        """Distance in standard deviations; weight of the centre in the mean and in the covariance; of each other."""
        kappa = 3.0 - dimension if self.kappa is None else self.kappa
        scaled = self.alpha**2 * (dimension + kappa)
        centre = (scaled - dimension) / scaled
        return np.sqrt(scaled), centre, centre + 1.0 - self.alpha**2 + self.beta, 0.5 / scaled


#: Third-degree spherical-radial cubature: the centre has no weight. Source: Arasaratnam and Haykin (2009).
CUBATURE = SymmetricSet(1.0, 0.0, 0.0)


@dataclass(frozen=True)
class SigmaPointFilter(SingleModelFilter):
    """The unscented Kalman filter, and with ``CUBATURE`` the cubature Kalman filter.

    ``augmented``: the driving noise is part of the state whose points go through the transition, and the points that
    the prediction moved serve the update. Otherwise the process noise is added to the predicted covariance and the
    points are drawn anew. Source: Wan and van der Merwe (2000), algorithm 2.1; Särkkä (2013), algorithms 5.14 and 5.15.
    """

    rule: SymmetricSet
    augmented: bool = True

    def predict(self, belief: Belief, dt: float) -> Belief:
        motion = self.motion
        belief = belief if belief.factor is not None else guarded(belief)
        noises = self._noises
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
        belief, size = guarded(belief), len(belief.mean)
        distance, _, _, weight = self.rule.weights(size + self._noises)
        moved = self.motion.transition(_points(belief, distance), dt)
        away = difference(moved, moved[:, :1], self.motion.angular)
        # Of the other points, the centre and those of the noises, the state before has no deviation.
        across = away[:, 1 : size + 1] - away[:, size + 1 :]
        return weight * distance * linalg.matmul_transposed(factor_of(belief), across)

    def predict_measurement(self, belief: Belief, scan: Scan) -> PredictedMeasurement:
        return self._expected(belief, scan)[0]

    def _expected(self, belief: Belief, scan: Scan) -> tuple[PredictedMeasurement, Remainder]:
        """What the belief expects of a scan, and what remains of its covariance after it."""
        motion, sensor = self.motion, SENSOR_MODELS[scan.kind]
        points = belief.points
        if points is None:
            belief = guarded(belief)
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
        belief, remainder = belief if belief.points is not None else guarded(belief), None
        if predicted is None:
            predicted, remainder = self._expected(belief, scan)
        update = linear_update(belief, predicted, self.measured(scan), scan.valid, self.motion.angular, remainder)
        return update._replace(belief=guarded(update.belief))

    @property
    def _noises(self) -> int:
        """How many driving noises are part of the state whose points go through the transition."""
        return len(self.motion.noise_sigma) if self.augmented else 0


def _points(belief: Belief, distance: float) -> Array:
    """``(n, 2 n + 1, ...)``: the centre, then one and the other point of each pair."""
    centre = belief.mean[:, None]
    columns = distance * factor_of(belief)
    return np.concatenate([centre, centre + columns, centre - columns], axis=1)


def _weighted(a: Array, b: Array, centre: float, other: float) -> Array:
    """``sum_s w_s a_s b_s^T`` of deviations ``(n, s, ...)`` and ``(m, s, ...)``; the central point comes first."""
    outer = linalg.matmul_transposed(a[:, 1:], b[:, 1:]) * other
    if centre == 0.0:
        return outer
    return outer + centre * a[:, None, 0] * b[None, :, 0]
