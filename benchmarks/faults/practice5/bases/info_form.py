"""An extended information filter as in a thesis: Y is the inverse covariance, and sensors add to it."""

import numpy as np


class Contribution:
    """What one observation says: a vector and a matrix, both in the state's coordinates."""

    def __init__(self, vector, matrix):
        self.vector, self.matrix = vector, matrix


class RadarNode:
    def __init__(self, scan):
        self.pose, self.velocity = np.asarray(scan.sensor_pose), np.asarray(scan.sensor_velocity)
        self.z, self.information = np.asarray(scan.measurement), np.linalg.inv(scan.noise_covariance)

    def predicted(self, x):
        d, u = x[:2] - self.pose[:2], x[2:] - self.velocity
        r = max(np.sqrt(d @ d), 0.01)
        return np.array([r, np.arctan2(d[1], d[0]) - self.pose[2], d @ u / r])

    def jacobian(self, x):
        d, u = x[:2] - self.pose[:2], x[2:] - self.velocity
        r2 = max(d @ d, 1e-4)
        r = np.sqrt(r2)
        r3 = r2 * r
        cross = u[0] * d[1] - u[1] * d[0]
        return np.array(
            [
                [d[0] / r, d[1] / r, 0.0, 0.0],
                [-d[1] / r2, d[0] / r2, 0.0, 0.0],
                [d[1] * cross / r3, -d[0] * cross / r3, d[0] / r, d[1] / r],
            ]
        )

    def contribution(self, x):
        H = self.jacobian(x)
        nu = self.z - self.predicted(x)
        nu[1] = np.remainder(nu[1] + np.pi, 2 * np.pi) - np.pi
        return Contribution(H.T @ self.information @ (nu + H @ x), H.T @ self.information @ H)


class LidarNode:
    def __init__(self, scan):
        x, y, yaw = scan.sensor_pose
        c, s = np.cos(yaw), np.sin(yaw)
        self.C = np.array([[c, s], [-s, c]])
        self.z = np.asarray(scan.measurement) + self.C @ np.array([x, y])
        self.information = np.linalg.inv(scan.noise_covariance)

    def contribution(self, x):
        H = np.hstack([self.C, np.zeros((2, 2))])
        return Contribution(H.T @ self.information @ self.z, H.T @ self.information @ H)


class InformationFilter:
    sigma = 3.0

    def __init__(self, time, y, Y):
        self.time, self.y, self.Y = time, y, Y

    def mean(self):
        return np.linalg.solve(self.Y, self.y)

    def covariance(self):
        P = np.linalg.inv(self.Y)
        return 0.5 * (P + P.T)

    def predicted(self, time):
        dt = time - self.time
        # M is the information carried over without noise, and the noise takes away some of it.
        Phi = np.eye(4) - dt * np.eye(4, k=2)  # backwards
        G = np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
        M = Phi.T @ self.Y @ Phi
        L = M @ G @ np.linalg.inv(G.T @ M @ G + np.eye(2) / self.sigma**2)
        keep = np.eye(4) - L @ G.T
        Y = keep @ M
        y = keep @ Phi.T @ self.y
        return InformationFilter(time, y, 0.5 * (Y + Y.T))

    def fused(self, contributions):
        y, Y = self.y.copy(), self.Y.copy()
        for one in contributions:
            y = y + one.vector
            Y = Y + one.matrix
        return InformationFilter(self.time, y, Y)


def opened(scan):
    """From one observation; of the velocity it is known that cars are no faster than about 50 m/s."""
    x, y, yaw = scan.sensor_pose
    if scan.kind == "radar":
        r, a = scan.measurement[0], yaw + scan.measurement[1]
        J = np.array([[np.cos(a), -r * np.sin(a)], [np.sin(a), r * np.cos(a)]])
        place = np.array([x + r * np.cos(a), y + r * np.sin(a)])
    else:
        J = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        place = np.array([x, y]) + J @ scan.measurement
    Y = np.zeros((4, 4))
    Y[:2, :2] = np.linalg.inv(J @ scan.noise_covariance[:2, :2] @ J.T)
    Y[2:, 2:] = np.eye(2) / 20.0**2
    return InformationFilter(scan.time, Y @ np.array([*place, 0.0, 0.0]), Y)


class Tracker:
    def __init__(self):
        self.nodes = {"radar": RadarNode, "lidar": LidarNode}

    def step(self, state, scan):
        if state is None:
            state = opened(scan)
        else:
            state = state.predicted(scan.time)
            if scan.valid:
                node = self.nodes[scan.kind](scan)
                state = state.fused([node.contribution(state.mean())])
        return state, (state.mean(), state.covariance())
