"""An interacting-multiple-model filter: constant velocity, quiet and agile, on positions and speeds along the ray."""

import numpy as np

TRANSITIONS = np.array([[0.97, 0.03], [0.06, 0.94]])  # row: from, column: to, per scan


class Tracker:
    def __init__(self, sigmas=(1.5, 8.0)):
        self.sigmas = sigmas

    def step(self, state, scan):
        if state is None:
            z, H, R = self.linear(scan)
            mean, P = np.array([z[0], z[1], 0.0, 0.0]), np.diag([0.0, 0.0, 400.0, 400.0])
            P[:2, :2] = R[:2, :2]
            means, covariances, mu = [mean, mean], [P, P], np.array([0.7, 0.3])
            return (scan.time, means, covariances, mu), (mean, P)
        time, means, covariances, mu = state
        dt = scan.time - time
        mu_predicted = TRANSITIONS.T @ mu
        means, covariances = self.mix(means, covariances, mu, mu_predicted)
        for j, sigma in enumerate(self.sigmas):
            means[j], covariances[j] = self.predict(means[j], covariances[j], dt, sigma)
        mu = mu_predicted
        if scan.valid:
            z, H, R = self.linear(scan)
            log_likelihood = np.zeros(2)
            for j in range(2):
                means[j], covariances[j], log_likelihood[j] = self.update(means[j], covariances[j], z, H, R)
            weight = mu * np.exp(log_likelihood - log_likelihood.max())
            mu = weight / weight.sum()
        return (scan.time, means, covariances, mu), self.combine(means, covariances, mu)

    def mix(self, means, covariances, mu, mu_predicted):
        mixing = TRANSITIONS * mu[:, None] / mu_predicted  # i, j: came from i, given that it is j now
        x0 = [sum(mixing[i, j] * means[i] for i in range(2)) for j in range(2)]
        P0 = []
        for j in range(2):
            P = np.zeros((4, 4))
            for i in range(2):
                d = means[i] - x0[j]
                P += mixing[i, j] * (covariances[i] + np.outer(d, d))
            P0.append(P)
        return x0, P0

    def predict(self, mean, P, dt, sigma):
        F = np.eye(4) + dt * np.eye(4, k=2)
        G = sigma * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
        return F @ mean, F @ P @ F.T + G @ G.T

    def update(self, mean, P, z, H, R):
        y = z - H @ mean
        S = H @ P @ H.T + R
        K = np.linalg.solve(S, H @ P).T
        A = np.eye(4) - K @ H
        _, log_det = np.linalg.slogdet(S)
        log_likelihood = -0.5 * (y @ np.linalg.solve(S, y) + log_det)
        return mean + K @ y, A @ P @ A.T + K @ R @ K.T, log_likelihood

    def combine(self, means, covariances, mu):
        mean = mu[0] * means[0] + mu[1] * means[1]
        P = np.zeros((4, 4))
        for weight, x, covariance in zip(mu, means, covariances, strict=True):
            gap = x - mean
            P += weight * (covariance + np.outer(gap, gap))
        return mean, P

    def linear(self, scan):
        """z, H, R in the fixed frame: position, and of a radar the speed over ground along the ray."""
        x, y, yaw = scan.sensor_pose
        radar = scan.kind == "radar"
        r, angle = (scan.measurement[0], yaw + scan.measurement[1]) if radar else (1.0, yaw)
        c, s = np.cos(angle), np.sin(angle)
        J = np.array([[c, -r * s], [s, r * c]])
        z = np.array([x, y]) + J @ (np.array([r, 0.0]) if radar else scan.measurement)
        H, R = np.eye(2, 4), J @ scan.noise_covariance[:2, :2] @ J.T
        if radar:
            z = np.append(z, scan.measurement[2] + c * scan.sensor_velocity[0] + s * scan.sensor_velocity[1])
            H = np.vstack([H, [0.0, 0.0, c, s]])
            R = np.pad(R, (0, 1))
            R[2, 2] = scan.noise_covariance[2, 2] + 0.15**2  # the ray is that of the measured azimuth
        return z, H, R
