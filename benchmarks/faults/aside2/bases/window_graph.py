"""A graph of the last two states: factors are whitened and solved by Gauss and Newton; the older is removed."""

import numpy as np


class Gaussian:
    """Of a factor's error: what it is multiplied by to have unit covariance."""

    def __init__(self, covariance):
        self.root = np.linalg.inv(np.linalg.cholesky(covariance))

    @classmethod
    def sigmas(cls, sigmas):
        return cls(np.diag(np.asarray(sigmas) ** 2))

    def whiten(self, matrix):
        return self.root @ matrix


class PriorFactor:
    """The error is the prior less the value; the root is that of the information."""

    def __init__(self, key, prior, root):
        self.keys, self.prior, self.root = (key,), prior, root

    def linearize(self, values):
        error = self.prior - values[self.keys[0]]
        J = -np.eye(len(error))
        return self.root @ error, [self.root @ J]


class MotionFactor:
    def __init__(self, old, new, dt, density=0.6):
        self.keys = (old, new)
        self.F = np.eye(4) + dt * np.eye(4, k=2)
        block = density * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        self.noise = Gaussian(np.kron(block, np.eye(2)))

    def linearize(self, values):
        old, new = (values[key] for key in self.keys)
        error = new - self.F @ old
        return self.noise.whiten(error), [self.noise.whiten(-self.F), self.noise.whiten(np.eye(4))]


class ScanFactor:
    def __init__(self, key, scan):
        self.keys = (key,)
        self.scan = scan
        self.measured = np.array(scan.measurement, dtype=float)
        self.noise = Gaussian(np.asarray(scan.noise_covariance))

    def linearize(self, values):
        expected, H = self.expected(values[self.keys[0]])
        error = expected - self.measured
        if self.scan.kind == "radar":
            error[1] = np.remainder(error[1] + np.pi, 2 * np.pi) - np.pi
        return self.noise.whiten(error), [self.noise.whiten(H)]

    def expected(self, x):
        sx, sy, yaw = self.scan.sensor_pose
        d = x[:2] - [sx, sy]
        if self.scan.kind != "radar":
            turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
            return turn @ d, np.hstack([turn, np.zeros((2, 2))])
        u = x[2:] - self.scan.sensor_velocity
        r = max(np.linalg.norm(d), 0.1)
        rate = d @ u / r
        H = np.zeros((3, 4))
        H[0, :2] = d / r
        H[1, :2] = -d[1] / r**2, d[0] / r**2
        H[2] = np.concatenate([u / r - rate * d / r**2, d / r])
        return np.array([r, np.arctan2(d[1], d[0]) - yaw, rate]), H


class Graph:
    def __init__(self, order):
        self.order, self.factors = order, []

    def add(self, factor):
        self.factors.append(factor)

    def stack(self, values):
        rows, errors = [], []
        for factor in self.factors:
            error, blocks = factor.linearize(values)
            row = np.zeros((len(error), 4 * len(self.order)))
            for key, block in zip(factor.keys, blocks, strict=True):
                at = 4 * self.order.index(key)
                row[:, at : at + 4] = block
            rows.append(row)
            errors.append(error)
        return np.vstack(rows), np.concatenate(errors)

    def optimize(self, values, iterations=3):
        for _ in range(iterations):
            A, e = self.stack(values)
            Q, R = np.linalg.qr(A)
            step = np.linalg.solve(R, -Q.T @ e)
            values = {key: values[key] + step[4 * i : 4 * i + 4] for i, key in enumerate(self.order)}
        return values

    def root_of_last(self, values):
        """The root of the information of the last key, the others being eliminated."""
        A, _ = self.stack(values)
        R = np.linalg.qr(A, mode="r")
        return R[-4:, -4:]


def place(scan):
    sx, sy, yaw = scan.sensor_pose
    z, R = np.array(scan.measurement), np.asarray(scan.noise_covariance)[:2, :2]
    r, angle = (z[0], yaw + z[1]) if scan.kind == "radar" else (1.0, yaw)
    c, s = np.cos(angle), np.sin(angle)
    J = np.array([[c, -r * s], [s, r * c]])
    local = np.array([r, 0.0]) if scan.kind == "radar" else z
    return np.array([sx, sy]) + J @ local, J @ R @ J.T


class Tracker:
    def step(self, state, scan):
        if state is None:
            position, R = place(scan)
            P = np.diag([0.0, 0.0, 400.0, 400.0])
            P[:2, :2] = R
            x, root = np.concatenate([position, np.zeros(2)]), np.linalg.inv(np.linalg.cholesky(P))
        else:
            time, x, root = state
            dt = scan.time - time
            if dt < 1e-6:
                graph, values = Graph(["now"]), {"now": x}
                graph.add(PriorFactor("now", x, root))
            else:
                graph = Graph(["before", "now"])
                motion = MotionFactor("before", "now", dt)
                values = {"before": x, "now": motion.F @ x}
                graph.add(PriorFactor("before", x, root))
                graph.add(motion)
            if scan.valid:
                graph.add(ScanFactor("now", scan))
            values = graph.optimize(values)
            x, root = values["now"], graph.root_of_last(values)
        inverse = np.linalg.inv(root)
        time = scan.time if state is None else max(time, scan.time)
        return (time, x, root), (x, inverse @ inverse.T)
