"""An interacting multiple model filter of straight motion and a coordinated turn, with stacked arrays."""

import numpy as np

STRAIGHT, TURN = 0, 1
PI = np.array([[0.97, 0.03], [0.10, 0.90]])  # a row is the model before, a column the model after
ACCELERATION = (1.0, 3.0)  # m/s^2, of each model
TURN_RATE = (0.01, 0.4)  # rad/s per square root of a second


def transition(model, x, dt):
    """The moved state px, py, vx, vy, w, and its derivative."""
    vx, vy, w = x[2:]
    F = np.eye(5)
    if model == STRAIGHT:
        F[0, 2] = F[1, 3] = dt
        F[4, 4] = 0.0  # it does not turn
        return F @ x, F
    angle = w * dt
    if abs(angle) < 1e-6:
        angle = 1e-6
        w = angle / dt if dt > 0 else 1.0
    s, c = np.sin(angle), np.cos(angle)
    a, b = s / w, (1 - c) / w
    F[0, 2], F[0, 3], F[1, 2], F[1, 3] = a, -b, b, a
    F[2, 2], F[2, 3], F[3, 2], F[3, 3] = c, -s, s, c
    moved = F @ x
    da, db = (dt * c - a) / w, (dt * s - b) / w
    F[:4, 4] = da * vx - db * vy, db * vx + da * vy, -dt * moved[3], dt * moved[2]
    return moved, F


def process_noise(model, dt):
    Q = np.zeros((5, 5))
    G = np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
    Q[:4, :4] = ACCELERATION[model] ** 2 * G @ G.T
    Q[4, 4] = TURN_RATE[model] ** 2 * dt + (model == STRAIGHT) * 1e-4
    return Q


def measurement(x, scan):
    yaw = scan.sensor_pose[2]
    dx, dy = x[:2] - scan.sensor_pose[:2]
    if scan.kind == "lidar":
        T = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
        return T @ [dx, dy], np.hstack([T, np.zeros((2, 3))])
    vx, vy = x[2:4] - scan.sensor_velocity
    r = max(np.hypot(dx, dy), 1e-3)
    cross = (dx * vy - dy * vx) / r**3
    H = np.array(
        [
            [dx / r, dy / r, 0.0, 0.0, 0.0],
            [-dy / r**2, dx / r**2, 0.0, 0.0, 0.0],
            [-dy * cross, dx * cross, dx / r, dy / r, 0.0],
        ]
    )
    return np.array([r, np.arctan2(dy, dx) - yaw, (dx * vx + dy * vy) / r]), H


def mixed(X, P, mu):
    """Mean and covariance of a mixture."""
    x = X @ mu
    spread = X - x[:, None]
    return x, P @ mu + spread @ np.diag(mu) @ spread.T


class Tracker:
    def step(self, state, scan):
        if state is None:
            X, P, mu = self.initial(scan)
        else:
            time, X, P, mu = state
            X, P, mu = self.interact(X, P, mu)
            X, P = self.predict(X, P, scan.time - time)
            if scan.valid:
                X, P, mu = self.update(X, P, mu, scan)
        x, covariance = mixed(X, P, mu)
        return (scan.time, X, P, mu), (x[:4], covariance[:4, :4])

    def initial(self, scan):
        x, y, yaw = scan.sensor_pose
        if scan.kind == "radar":
            r, angle = scan.measurement[0], yaw + scan.measurement[1]
            c, s = np.cos(angle), np.sin(angle)
            local, J = r * np.array([c, s]), np.array([[c, -r * s], [s, r * c]])
        else:
            J = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
            local = J @ scan.measurement
        start = np.array([x + local[0], y + local[1], 0.0, 0.0, 0.0])
        P = np.diag([0.0, 0.0, 400.0, 400.0, 0.1])
        P[:2, :2] = J @ scan.noise_covariance[:2, :2] @ J.T
        return np.stack([start, start], axis=-1), np.stack([P, P], axis=-1), np.array([0.8, 0.2])

    def interact(self, X, P, mu):
        joint = PI * mu[:, None]
        predicted = joint.sum(axis=0)
        backward = joint / predicted
        both = [mixed(X, P, backward[:, j]) for j in (STRAIGHT, TURN)]
        return (
            np.stack([x for x, _ in both], axis=-1),
            np.stack([p for _, p in both], axis=-1),
            predicted / predicted.sum(),
        )

    def predict(self, X, P, dt):
        X, P = X.copy(), P.copy()
        for j in (STRAIGHT, TURN):
            X[:, j], F = transition(j, X[:, j], dt)
            P[..., j] = F @ P[..., j] @ F.T + process_noise(j, dt)
        return X, P

    def update(self, X, P, mu, scan):
        X, P = X.copy(), P.copy()
        log = np.log(mu)
        for j in (STRAIGHT, TURN):
            h, H = measurement(X[:, j], scan)
            y = scan.measurement - h
            if scan.kind == "radar":
                y[1] = np.arctan2(np.sin(y[1]), np.cos(y[1]))
            S = H @ P[..., j] @ H.T + scan.noise_covariance
            Si = np.linalg.inv(S)
            K = P[..., j] @ H.T @ Si
            log[j] -= 0.5 * (y @ Si @ y + np.linalg.slogdet(S)[1])
            X[:, j] = X[:, j] + K @ y
            P[..., j] = P[..., j] - K @ S @ K.T
            P[..., j] = (P[..., j] + P[..., j].T) / 2
        weight = np.exp(log - log.max())
        return X, P, weight / weight.sum()
