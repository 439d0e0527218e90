"""A sequential update of decorrelated components, with the state px, vx, py, vy."""

import numpy as np


def fixed_frame(scan, velocity=(0.0, 0.0)):
    """z, H and R: the position in the fixed frame, and of a radar the speed along the line of sight.

    An error of the azimuth turns the line of sight, along which a velocity near the predicted one is seen.
    """
    x, y, yaw = scan.sensor_pose
    if scan.kind == "lidar":
        T = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        return np.array([x, y]) + T @ scan.measurement, np.eye(2, 4), T @ scan.noise_covariance @ T.T
    r, c, s = scan.measurement[0], np.cos(yaw + scan.measurement[1]), np.sin(yaw + scan.measurement[1])
    across = s * (velocity[0] - scan.sensor_velocity[0]) - c * (velocity[1] - scan.sensor_velocity[1])
    J = np.array([[c, -r * s, 0.0], [s, r * c, 0.0], [0.0, across, 1.0]])
    H = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, c, s]])
    rate = scan.measurement[2] + c * scan.sensor_velocity[0] + s * scan.sensor_velocity[1]
    return np.array([x + r * c, y + r * s, rate]), H, J @ scan.noise_covariance @ J.T


def first(scan):
    z, _, R = fixed_frame(scan)
    P = np.diag([0.0, 0.0, 400.0, 400.0])
    P[:2, :2] = R[:2, :2]
    return np.array([z[0], z[1], 0.0, 0.0]), P


def moved(x, P, dt, sigma=3.0):
    F = np.eye(4) + dt * np.eye(4, k=2)
    G = sigma * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
    return F @ x, F @ P @ F.T + G @ G.T


ORDER = [0, 2, 1, 3]  # from px, py, vx, vy and back


class Tracker:
    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            s, C = x[ORDER], P[np.ix_(ORDER, ORDER)]
        else:
            time, s, C = state
            dt = scan.time - time
            f = np.array([[1.0, dt], [0.0, 1.0]])
            q = 9.0 * np.array([[dt**4 / 4, dt**3 / 2], [dt**3 / 2, dt**2]])
            F = np.kron(np.eye(2), f)
            s, C = F @ s, F @ C @ F.T + np.kron(np.eye(2), q)
            if scan.valid:
                z, H, R = fixed_frame(scan, s[ORDER][2:])
                L = np.linalg.cholesky(R)
                for value, h in zip(np.linalg.solve(L, z), np.linalg.solve(L, H[:, ORDER]), strict=True):
                    k = C @ h / (h @ C @ h + 1.0)
                    s = s + k * (value - h @ s)
                    C = C - np.outer(k, h @ C)
                C = (C + C.T) / 2
        return (scan.time, s, C), (s[ORDER], C[np.ix_(ORDER, ORDER)])
