"""An extended Kalman filter with constant velocity; each piece that somebody could get wrong is a method of its own."""

from typing import NamedTuple

import numpy as np

MIN_RANGE = 1e-6


class Track(NamedTuple):
    time: float
    mean: np.ndarray
    covariance: np.ndarray


def wrap(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def symmetric(P):
    return (P + P.T) / 2


def rotation(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


class Tracker:
    """State px, py, vx, vy; radar (range, azimuth, range rate) and lidar (x, y) of one target."""

    def __init__(self, velocity_sigma=20.0, acceleration_sigma=3.0):
        self.velocity_sigma = velocity_sigma
        self.acceleration_sigma = acceleration_sigma

    def step(self, state, scan):
        if state is None:
            if not scan.valid:
                return None, None
            state = Track(scan.time, *self.one_measurement(*self.position(scan), scan))
        else:
            state = self.advance(state, scan)
        return state, self.output(state.mean, state.covariance)

    def advance(self, track, scan):
        x, P = self.predict(track.mean, track.covariance, scan.time - track.time)
        if self.usable(scan):
            x, P = self.update(x, P, scan)
        return Track(scan.time, x, P)

    def usable(self, scan):
        return bool(scan.valid)

    def one_measurement(self, position, noise, scan):
        P = np.zeros((4, 4))
        P[:2, :2] = noise
        P[2, 2] = P[3, 3] = self.velocity_sigma**2
        return np.concatenate([position, np.zeros(2)]), P

    def output(self, x, P):
        return x, P

    def predict(self, x, P, dt):
        F = self.transition_matrix(dt)
        return F @ x, symmetric(F @ P @ F.T) + self.process_noise(x, dt)

    def transition_matrix(self, dt):
        return np.array([[1, 0, dt, 0], [0, 1, 0, dt], [0, 0, 1, 0], [0, 0, 0, 1.0]])

    def process_noise(self, x, dt):
        G = np.array([[dt**2 / 2, 0], [0, dt**2 / 2], [dt, 0], [0, dt]])
        return self.acceleration_sigma**2 * G @ G.T

    def update(self, x, P, scan):
        y = self.innovation(scan, self.predicted_measurement(x, scan))
        H = self.sensor_jacobian(x, scan)
        S = H @ P @ H.T + self.noise(scan)
        K = np.linalg.solve(S, H @ P).T
        return self.corrected_mean(x, K, y), self.corrected_covariance(P, K, S)

    def corrected_mean(self, x, K, y):
        return x + K @ y

    def corrected_covariance(self, P, K, S):
        return symmetric(P - K @ S @ K.T)

    def noise(self, scan):
        return scan.noise_covariance

    def position(self, scan):
        """The position in the fixed frame that a measurement gives, and its covariance to first order."""
        R = self.noise(scan)
        if scan.kind == "radar":
            r, azimuth = scan.measurement[:2]
            local = r * np.array([np.cos(azimuth), np.sin(azimuth)])
            J = rotation(azimuth + scan.sensor_pose[2]) @ np.diag([1.0, r])
        else:
            local, J = scan.measurement, rotation(scan.sensor_pose[2])
        return scan.sensor_pose[:2] + rotation(scan.sensor_pose[2]) @ local, J @ R[:2, :2] @ J.T

    def predicted_measurement(self, target, scan):
        dx, dy = target[:2] - scan.sensor_pose[:2]
        x, y = rotation(scan.sensor_pose[2]).T @ [dx, dy]
        if scan.kind == "lidar":
            return np.array([x, y])
        return np.array([self.range(dx, dy), self.azimuth(x, y), self.range_rate(target, scan)])

    def range(self, dx, dy):
        return max(np.hypot(dx, dy), MIN_RANGE)

    def azimuth(self, x, y):
        return np.arctan2(y, x)

    def range_rate(self, target, scan):
        dx, dy = target[:2] - scan.sensor_pose[:2]
        vx, vy = target[2:] - scan.sensor_velocity
        return (dx * vx + dy * vy) / self.range(dx, dy)

    def residual(self, kind, a, b):
        d = a - b
        if kind == "radar":
            d[1] = wrap(d[1])
        return d

    def innovation(self, scan, predicted):
        return self.residual(scan.kind, scan.measurement, predicted)

    def sensor_jacobian(self, x, scan):
        if scan.kind == "lidar":
            return np.hstack([rotation(scan.sensor_pose[2]).T, np.zeros((2, 2))])
        dx, dy = x[:2] - scan.sensor_pose[:2]
        vx, vy = x[2:] - scan.sensor_velocity
        r = self.range(dx, dy)
        across = (vx * dy - vy * dx) / r**3
        return np.array(
            [
                [dx / r, dy / r, 0, 0],
                [-dy / r**2, dx / r**2, 0, 0],
                [dy * across, -dx * across, dx / r, dy / r],
            ]
        )
