"""An unscented Kalman filter with constant turn rate and velocity, plain NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np

from .plain import Array, Belief, PlainTracker, symmetric, wrap

MIN_SPEED = 1e-3
MIN_YAW_RATE = 1e-6
SIZE = 5


def root(P: Array) -> Array:
    """A with A A^T = P: the Cholesky factor, or where rounding has made P indefinite, that of the nearest matrix."""
    try:
        return np.linalg.cholesky(P)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(symmetric(P))
        return vectors * np.sqrt(np.maximum(values, 1e-12))


class ConstantTurnRate(PlainTracker):
    """State px, py, v, yaw, yaw rate with white acceleration along the path and white yaw acceleration."""

    #: Standard deviation of a course of which nothing is known, rad.
    unknown_angle = np.pi / np.sqrt(3)

    def __init__(
        self,
        start: str = "two_measurements",
        velocity_sigma: float = 20.0,
        acceleration_sigma: float = 3.0,
        yaw_acceleration_sigma: float = 0.5,
        yaw_rate_sigma: float = 0.3,
    ):
        super().__init__(start, velocity_sigma, acceleration_sigma)
        self.yaw_acceleration_sigma = yaw_acceleration_sigma
        self.yaw_rate_sigma = yaw_rate_sigma

    def transition(self, x: Array, dt: float) -> Array:
        px, py, v, yaw, w = x
        dx, dy = self.displacement(v, yaw, w, dt)
        return np.array([px + dx, py + dy, v, yaw + w * dt, w])

    def displacement(self, v: float, yaw: float, w: float, dt: float) -> tuple[float, float]:
        if abs(w) < MIN_YAW_RATE:
            return v * dt * np.cos(yaw), v * dt * np.sin(yaw)
        return v / w * (np.sin(yaw + w * dt) - np.sin(yaw)), v / w * (np.cos(yaw) - np.cos(yaw + w * dt))

    def process_noise(self, x: Array, dt: float) -> Array:
        half, c, s = dt**2 / 2, np.cos(x[3]), np.sin(x[3])
        G = np.array([[half * c, 0], [half * s, 0], [dt, 0], [0, half], [0, dt]])
        return G @ np.diag([self.acceleration_sigma**2, self.yaw_acceleration_sigma**2]) @ G.T

    def from_cartesian(self, x: Array, P: Array) -> Belief:
        """To first order; of a course that the velocity leaves open, no more is said than that it is not known."""
        yaw, speed = self.course(x[2], x[3]), np.hypot(x[2], x[3])
        c, s, divisor = np.cos(yaw), np.sin(yaw), self.divisor(speed)
        T = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, c, s], [0, 0, -s / divisor, c / divisor]])
        own = np.zeros((SIZE, SIZE))
        own[:4, :4] = symmetric(T @ P @ T.T)
        shrink = min(1.0, self.unknown_angle / np.sqrt(own[3, 3]))
        own[3] *= shrink
        own[:, 3] *= shrink
        own[4, 4] = self.yaw_rate_sigma**2
        return np.array([x[0], x[1], speed, yaw, 0.0]), own

    def course(self, vx: float, vy: float) -> float:
        return np.arctan2(vy, vx)

    def divisor(self, speed: float) -> float:
        return max(speed, MIN_SPEED)

    def cartesian(self, x: Array) -> Array:
        return np.array([x[0], x[1], x[2] * np.cos(x[3]), x[2] * np.sin(x[3])])

    def output(self, x: Array, P: Array) -> Belief:
        v, c, s = x[2], np.cos(x[3]), np.sin(x[3])
        J = np.zeros((4, SIZE))
        J[0, 0] = J[1, 1] = 1
        J[2:, 2:4] = [[c, -v * s], [s, v * c]]
        across = np.array([0, 0, -s, c])
        # At rest the first order says that the velocity across the yaw is known; the second order does not.
        second = P[2, 2] * P[3, 3] + P[2, 3] ** 2
        return self.cartesian(x), J @ P @ J.T + second * np.outer(across, across)


class PlainUkf(ConstantTurnRate):
    """Radar and lidar of one target; scaled sigma points with alpha 1, beta 2, kappa 0, drawn anew for the update."""

    spread = float(SIZE)
    mean_weights = np.array([0, *[0.5 / SIZE] * 2 * SIZE])
    covariance_weights = np.array([2, *[0.5 / SIZE] * 2 * SIZE])

    def predict(self, x: Array, P: Array, dt: float) -> Belief:
        moved = np.array([self.transition(point, dt) for point in self.sigma_points(x, P)])
        mean = self.state_mean(moved, self.mean_weights)
        apart = self.state_spread(moved, mean)
        P = symmetric(apart.T * self.covariance_weights @ apart) + self.process_noise(x, dt)
        mean[3] = wrap(mean[3])
        return mean, P

    def update(self, x: Array, P: Array, scan: Any) -> Belief:
        points = self.points_for_update(x, P)
        seen = np.array([self.predicted_measurement(self.cartesian(point), scan) for point in points])
        mean = self.measurement_mean(scan.kind, seen, self.mean_weights)
        apart = self.measurement_spread(scan.kind, seen, mean)
        S = symmetric(apart.T * self.covariance_weights @ apart) + self.added_noise(scan)
        cross = self.state_spread(points, x).T * self.covariance_weights @ apart
        K = np.linalg.solve(S, cross.T).T
        return self.corrected(x, P, K, self.innovation(scan, mean), S)

    def points_for_update(self, x: Array, P: Array) -> Array:
        return self.sigma_points(x, P)

    def added_noise(self, scan: Any) -> Array:
        return self.noise(scan)

    def sigma_points(self, x: Array, P: Array) -> Array:
        """``(11, 5)``: the centre, then the points on either side."""
        rows = np.sqrt(self.spread) * self.factor(P)
        return np.vstack([x, x + rows, x - rows])

    def factor(self, P: Array) -> Array:
        """``(5, 5)`` A with A^T A = P, in whose rows the points lie."""
        return root(P).T

    def state_mean(self, points: Array, weights: Array) -> Array:
        return points[0] + weights @ self.state_spread(points, points[0])

    def state_spread(self, points: Array, centre: Array) -> Array:
        apart = points - centre
        apart[:, 3] = wrap(apart[:, 3])
        return apart

    def measurement_mean(self, kind: str, points: Array, weights: Array) -> Array:
        return points[0] + weights @ self.measurement_spread(kind, points, points[0])

    def measurement_spread(self, kind: str, points: Array, centre: Array) -> Array:
        return np.array([self.residual(kind, point, centre) for point in points])

    def corrected_mean(self, x: Array, K: Array, y: Array) -> Array:
        mean = super().corrected_mean(x, K, y)
        mean[3] = wrap(mean[3])
        return mean
