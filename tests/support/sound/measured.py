"""The sensors and the motion of constant velocity, shared by the sound trackers of this folder."""

import numpy as np


def wrap(angle):
    """Return the angle in [-pi, pi), rad."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def turn(yaw):
    """Return the rotation from the sensor's frame into the fixed frame."""
    return np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])


def position(scan):
    """Return the measured position in the fixed frame, m, and its covariance to first order."""
    to_fixed, z, R = turn(scan.sensor_pose[2]), scan.measurement, scan.noise_covariance
    if scan.kind == "radar":
        c, s = np.cos(z[1]), np.sin(z[1])
        J = np.array([[c, -z[0] * s], [s, z[0] * c]])
        z, R = z[0] * np.array([c, s]), J @ R[:2, :2] @ J.T
    return scan.sensor_pose[:2] + to_fixed @ z, to_fixed @ R @ to_fixed.T


def start(scan, speed_sigma=20.0):
    """Return the mean and covariance of px, py, vx, vy after the first measurement."""
    z, R = position(scan)
    P = np.diag([0.0, 0.0, speed_sigma**2, speed_sigma**2])
    P[:2, :2] = R
    return np.array([*z, 0.0, 0.0]), P


def expected(x, scan):
    """Return the measurement that a state px, py, vx, vy, ... lets expect."""
    away = x[:2] - scan.sensor_pose[:2]
    if scan.kind != "radar":
        return turn(scan.sensor_pose[2]).T @ away
    r = max(np.hypot(*away), 1e-3)
    closing = away @ (x[2:4] - scan.sensor_velocity) / r
    return np.array([r, wrap(np.arctan2(away[1], away[0]) - scan.sensor_pose[2]), closing])


def jacobian(x, scan):
    """Return the derivative of the expected measurement by px, py, vx, vy."""
    if scan.kind != "radar":
        return np.hstack([turn(scan.sensor_pose[2]).T, np.zeros((2, 2))])
    (dx, dy), (ux, uy) = x[:2] - scan.sensor_pose[:2], x[2:4] - scan.sensor_velocity
    r = max(np.hypot(dx, dy), 1e-3)
    c, s, across = dx / r, dy / r, (dx * uy - dy * ux) / r**2
    return np.array([[c, s, 0, 0], [-s / r, c / r, 0, 0], [-s * across, c * across, c, s]])


def difference(z, expectation, scan):
    """Return the innovation, with a radar's azimuth wrapped."""
    y = np.array(z, dtype=float) - expectation
    if scan.kind == "radar":
        y[1] = wrap(y[1])
    return y


def transition(dt):
    """Return the transition of px, py, vx, vy over a time step."""
    return np.eye(4) + dt * np.eye(4, k=2)


def driven(dt, sigma=3.0):
    """Return the process noise of an acceleration that is constant over the step."""
    G = sigma * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
    return G @ G.T


def predicted(x, P, dt, sigma=3.0):
    """Return the mean and covariance of px, py, vx, vy after a time step."""
    F = transition(dt)
    return F @ x, F @ P @ F.T + driven(dt, sigma)


def corrected(x, P, scan):
    """Return the mean and covariance after an EKF update of a state that begins with px, py, vx, vy."""
    H = np.zeros((scan.measurement.size, x.size))
    H[:, :4] = jacobian(x, scan)
    R = scan.noise_covariance
    K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
    A = np.eye(x.size) - K @ H
    return x + K @ difference(scan.measurement, expected(x, scan), scan), A @ P @ A.T + K @ R @ K.T


def residuals(X, scan):
    """Return the innovations (n, m) of many states (n, 4)."""
    away = X[:, :2] - scan.sensor_pose[:2]
    if scan.kind != "radar":
        return scan.measurement - away @ turn(scan.sensor_pose[2])
    r = np.hypot(*away.T)
    azimuth = np.arctan2(away[:, 1], away[:, 0]) - scan.sensor_pose[2]
    closing = np.sum(away * (X[:, 2:4] - scan.sensor_velocity), axis=1) / r
    y = scan.measurement - np.column_stack([r, azimuth, closing])
    y[:, 1] = wrap(y[:, 1])
    return y


class EachScan:
    """A filter that predicts to each scan; a subclass updates its mean and covariance with the measurement."""

    sigma = 3.0

    def update(self, x, P, scan):
        """Return the mean and covariance after a measurement."""
        raise NotImplementedError

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
            return (scan.time, x, P), (x, P)
        t, x, P = state
        x, P = predicted(x, P, scan.time - t, self.sigma)
        if scan.valid:
            x, P = self.update(x, P, scan)
        P = (P + P.T) / 2
        return (scan.time, x, P), (x, P)
