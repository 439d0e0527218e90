"""Two models in course and speed, straight and turning: an interacting-multiple-model filter.

State px, py, speed, course, turn rate. A linear filter runs until the object has a course.
"""

import numpy as np

STAY = np.array([[0.98, 0.02], [0.05, 0.95]])


def wrap(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


class Tracker:
    def __init__(self, acceleration_sigma=3.0, turn_sigmas=(0.02, 0.5)):
        self.sigma_a, self.turn_sigmas = acceleration_sigma, turn_sigmas

    def step(self, state, scan):
        z, R = self.position(scan) if scan.valid else (None, None)
        if state is None:
            x, P = np.array([*z, 0.0, 0.0]), np.diag([0.0, 0.0, 400.0, 400.0])
            P[:2, :2] = R
            return ("linear", scan.time, scan.time, x, P), (x, P)
        if state[0] == "linear":
            return self.linear_step(state[1:], scan, z, R)
        time, xs, Ps, mu = state
        predicted_mu = mu @ STAY
        xs, Ps = self.mixed(xs, Ps, mu, predicted_mu)
        xs, Ps = zip(
            *[self.predict(xs[j], Ps[j], scan.time - time, self.turn_sigmas[j]) for j in range(2)], strict=True
        )
        mu = predicted_mu
        if scan.valid:
            xs, Ps, log = zip(*[self.update(xs[j], Ps[j], z, R) for j in range(2)], strict=True)
            mu = mu * np.exp(np.array(log) - max(log))
            mu = mu / mu.sum()
        x, P = self.average(xs, Ps, mu)
        return (scan.time, xs, Ps, mu), self.cartesian(x, P)

    def linear_step(self, state, scan, z, R):
        time, begun, x, P = state
        dt = scan.time - time
        F = np.eye(4) + dt * np.eye(4, k=2)
        G = 2 * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
        x, P = F @ x, F @ P @ F.T + G @ G.T
        if scan.valid:
            K = P[:, :2] @ np.linalg.inv(P[:2, :2] + R)
            x, P = x + K @ (z - x[:2]), P - K @ P[:2]
            P = (P + P.T) / 2
        speed = np.hypot(x[2], x[3])
        if scan.time - begun < 1 or speed < 2:
            return ("linear", scan.time, begun, x, P), (x, P)
        c, s = x[2:] / speed
        J = np.zeros((5, 4))
        J[:2, :2], J[2, 2:], J[3, 2:] = np.eye(2), [c, s], [-s / speed, c / speed]
        start, spread = J @ x, J @ P @ J.T + np.diag([0, 0, 0, 0, 0.01])
        start[3] = np.arctan2(s, c)
        return (scan.time, (start, start), (spread, spread), np.array([0.8, 0.2])), (x, P)

    def mixed(self, xs, Ps, mu, predicted_mu):
        weights = STAY * mu[:, None] / predicted_mu
        return zip(*[self.average(xs, Ps, weights[:, j]) for j in range(2)], strict=True)

    def average(self, xs, Ps, weights):
        """The mean and the covariance of the mixture, courses about that of the first model."""
        offsets = [x - xs[0] for x in xs]
        for offset in offsets:
            offset[3] = wrap(offset[3])
        shift = sum(w * offset for w, offset in zip(weights, offsets, strict=True))
        P = sum(w * (Pi + np.outer(o - shift, o - shift)) for w, o, Pi in zip(weights, offsets, Ps, strict=True))
        x = xs[0] + shift
        x[3] = wrap(x[3])
        return x, P

    def predict(self, x, P, dt, turn_sigma):
        _, _, v, course, turn = x
        mid = course + turn * dt / 2
        moved = x + np.array([v * dt * np.cos(mid), v * dt * np.sin(mid), 0.0, turn * dt, 0.0])
        moved[3] = wrap(moved[3])
        c, s = dt * np.cos(mid), dt * np.sin(mid)
        F = np.eye(5)
        F[0, 2:] = [c, -v * s, -v * s * dt / 2]
        F[1, 2:] = [s, v * c, v * c * dt / 2]
        F[3, 4] = dt
        g = np.array([c * dt / 2, s * dt / 2, dt, 0.0, 0.0]) * self.sigma_a
        Q = np.outer(g, g) + np.diag([0, 0, 0, turn_sigma**2 * dt**3 / 3, turn_sigma**2 * dt])
        Q[3, 4] = Q[4, 3] = turn_sigma**2 * dt**2 / 2
        across = np.array([-v * s, v * c])
        Q[:2, :2] += turn_sigma**2 * dt**3 / 20 * np.outer(across, across)
        return moved, F @ P @ F.T + Q

    def update(self, x, P, z, R):
        y, S = z - x[:2], P[:2, :2] + R
        K = P[:, :2] @ np.linalg.inv(S)
        x = x + K @ y
        x[3] = wrap(x[3])
        A = np.eye(5) - K @ np.eye(2, 5)
        return x, A @ P @ A.T + K @ R @ K.T, -0.5 * (y @ np.linalg.inv(S) @ y + np.log(np.linalg.det(S)))

    def cartesian(self, x, P):
        v, c, s = x[2], np.cos(x[3]), np.sin(x[3])
        J = np.eye(4, 5)
        J[2:, 2:] = [[c, -v * s, 0], [s, v * c, 0]]
        return np.array([x[0], x[1], v * c, v * s]), J @ P @ J.T + 1e-9 * np.eye(4)

    def position(self, scan):
        radar, yaw = scan.kind == "radar", scan.sensor_pose[2]
        r, angle = (scan.measurement[0], yaw + scan.measurement[1]) if radar else (1.0, yaw)
        c, s = np.cos(angle), np.sin(angle)
        J = np.array([[c, -r * s], [s, r * c]])
        z = scan.sensor_pose[:2] + J @ (np.array([r, 0.0]) if radar else scan.measurement)
        return z, J @ scan.noise_covariance[:2, :2] @ J.T
