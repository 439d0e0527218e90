"""Singer's model: the acceleration is correlated over a second."""

import numpy as np


def position(scan):
    """The position in the fixed frame and its covariance."""
    x, y, yaw = scan.sensor_pose
    radar = scan.kind == "radar"
    r, angle = (scan.measurement[0], yaw + scan.measurement[1]) if radar else (1.0, yaw)
    c, s = np.cos(angle), np.sin(angle)
    J = np.array([[c, -r * s], [s, r * c]])
    local = np.array([r, 0.0]) if radar else scan.measurement
    return np.array([x, y]) + J @ local, J @ scan.noise_covariance[:2, :2] @ J.T


class Tracker:
    def __init__(self, time_constant=1.0, acceleration_sigma=2.5):
        self.tau, self.sigma = time_constant, acceleration_sigma

    def step(self, state, scan):
        if state is None:
            z, R = position(scan)
            x, P = np.zeros(6), np.diag([0.0, 400.0, self.sigma**2] * 2)
            x[[0, 3]] = z
            P[np.ix_([0, 3], [0, 3])] = R
        else:
            time, x, P = state
            F, Q = self.model(scan.time - time)
            x, P = F @ x, F @ P @ F.T + Q
            if scan.valid:
                z, R = position(scan)
                H = np.eye(6)[[0, 3]]
                K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
                A = np.eye(6) - K @ H
                x, P = x + K @ (z - H @ x), A @ P @ A.T + K @ R @ K.T
        out = [0, 3, 1, 4]
        return (scan.time, x, P), (x[out], P[np.ix_(out, out)])

    def model(self, dt):
        """The noise by Gauss-Legendre quadrature over the interval."""
        F = self.transition(dt)
        places, weights = np.polynomial.legendre.leggauss(5)
        Q = np.zeros((3, 3))
        for place, weight in zip(places, weights, strict=True):
            push = self.transition(dt * (1 + place) / 2)[:, 2]
            Q += weight * dt / 2 * 2 * self.sigma**2 / self.tau * np.outer(push, push)
        return np.kron(np.eye(2), F), np.kron(np.eye(2), Q)

    def transition(self, dt):
        a, e = 1 / self.tau, np.exp(-dt / self.tau)
        return np.array([[1, dt, (a * dt - 1 + e) / a**2], [0, 1, (1 - e) / a], [0, 0, e]])
