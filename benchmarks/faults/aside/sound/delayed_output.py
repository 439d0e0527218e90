"""It gives nothing until a line is fitted through three positions or more, and is then a Kalman filter."""

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


def constant_velocity(dt, sigma=3.0):
    F = np.eye(4) + dt * np.eye(4, k=2)
    G = sigma * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
    return F, G @ G.T


class Tracker:
    def step(self, state, scan):
        found = position(scan) if scan.valid else None
        if state is None or state[0] == "collecting":
            return self.collect(() if state is None else state[1], scan, found)
        _, time, x, P = state
        F, Q = constant_velocity(scan.time - time)
        x, P = F @ x, F @ P @ F.T + Q
        if found:
            z, R = found
            K = np.linalg.solve(P[:2, :2] + R, P[:2]).T
            A = np.eye(4) - K @ np.eye(2, 4)
            x, P = x + K @ (z - x[:2]), A @ P @ A.T + K @ R @ K.T
        return ("tracking", scan.time, x, P), (x, P)

    def collect(self, seen, scan, found):
        seen = (*seen, (scan.time, *found)) if found else seen
        if len(seen) < 3 or seen[-1][0] - seen[0][0] < 0.1 or not found:
            return ("collecting", seen), None
        information, total = np.zeros((4, 4)), np.zeros(4)
        for time, z, R in seen:
            H = np.hstack([np.eye(2), (time - scan.time) * np.eye(2)])
            # beyond its own noise, a straight line is wrong by what the object accelerates
            weight = np.linalg.inv(R + (1.5 * (time - scan.time) ** 2) ** 2 * np.eye(2))
            information, total = information + H.T @ weight @ H, total + H.T @ weight @ z
        P = np.linalg.inv(information)
        x = P @ total
        return ("tracking", scan.time, x, (P + P.T) / 2), (x, P)
