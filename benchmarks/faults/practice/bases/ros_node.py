"""Transcribed from a ROS node in C++: stamps of seconds and nanoseconds, angles in degrees, its own matrices."""

import copy
import math

import numpy as np

RAD2DEG = 180.0 / math.pi
DEG2RAD = math.pi / 180.0


class Matrix:
    """Rows of numbers."""

    def __init__(self, rows):
        self.m = [list(map(float, row)) for row in rows]

    @classmethod
    def zeros(cls, r, c):
        return cls([[0.0] * c for _ in range(r)])

    @classmethod
    def identity(cls, n):
        return cls([[1.0 if i == j else 0.0 for j in range(n)] for i in range(n)])

    def __call__(self, i, j):
        return self.m[i][j]

    def set(self, i, j, value):
        self.m[i][j] = float(value)

    def row(self, i):
        return list(self.m[i])

    def transpose(self):
        return Matrix(zip(*self.m, strict=True))

    def __mul__(self, other):
        columns = list(zip(*other.m, strict=True))
        return Matrix([[sum(a * b for a, b in zip(row, col, strict=True)) for col in columns] for row in self.m])

    def __add__(self, other):
        return Matrix([[a + b for a, b in zip(p, q, strict=True)] for p, q in zip(self.m, other.m, strict=True)])


def stamp_of(seconds):
    """header.stamp"""
    sec = math.floor(seconds)
    return {"sec": sec, "nanosec": round((seconds - sec) * 1e9)}


def duration(now, before):
    sec = now["sec"] - before["sec"]
    nsec = now["nanosec"] - before["nanosec"]
    return sec + nsec * 1e-9


def normalize_deg(a):
    while a > 180.0:
        a -= 360.0
    while a <= -180.0:
        a += 360.0
    return a


class Filter:
    ACC_NOISE = 3.0

    def __init__(self):
        self.X = [0.0, 0.0, 0.0, 0.0]
        self.P = Matrix.zeros(4, 4)
        self.stamp = None

    def initialise(self, msg):
        px, py, yaw = msg["pose"]
        if msg["sensor"] == "radar":
            r, azimuth = msg["data"][0], msg["data"][1]
            a = (yaw + azimuth) * DEG2RAD
            x, y = px + r * math.cos(a), py + r * math.sin(a)
            J = Matrix([[math.cos(a), -r * math.sin(a) * DEG2RAD], [math.sin(a), r * math.cos(a) * DEG2RAD]])
        else:
            c, s = math.cos(yaw * DEG2RAD), math.sin(yaw * DEG2RAD)
            u, v = msg["data"]
            x, y = px + c * u - s * v, py + s * u + c * v
            J = Matrix([[c, -s], [s, c]])
        var = msg["variance"]
        C = J * Matrix([[var[0], 0.0], [0.0, var[1]]]) * J.transpose()
        self.X = [x, y, 0.0, 0.0]
        for i in range(2):
            for j in range(2):
                self.P.set(i, j, C(i, j))
            self.P.set(i + 2, i + 2, 20.0 * 20.0)
        self.stamp = msg["stamp"]

    def predict(self, stamp):
        dt = duration(stamp, self.stamp)
        self.stamp = stamp
        F = Matrix.identity(4)
        F.set(0, 2, dt)
        F.set(1, 3, dt)
        Q = Matrix.zeros(4, 4)
        q = self.ACC_NOISE * self.ACC_NOISE
        for i in range(2):
            Q.set(i, i, q * dt**4 / 4)
            Q.set(i, i + 2, q * dt**3 / 2)
            Q.set(i + 2, i, q * dt**3 / 2)
            Q.set(i + 2, i + 2, q * dt**2)
        self.X = [self.X[0] + dt * self.X[2], self.X[1] + dt * self.X[3], self.X[2], self.X[3]]
        self.P = F * self.P * F.transpose() + Q

    def expected(self, msg):
        """What the sensor would say, and one row of H for each number."""
        px, py, yaw = msg["pose"]
        dx, dy = self.X[0] - px, self.X[1] - py
        if msg["sensor"] == "lidar":
            c, s = math.cos(yaw * DEG2RAD), math.sin(yaw * DEG2RAD)
            return [c * dx + s * dy, -s * dx + c * dy], [[c, s, 0.0, 0.0], [-s, c, 0.0, 0.0]]
        ux, uy = self.X[2] - msg["twist"][0], self.X[3] - msg["twist"][1]
        r = math.sqrt(dx * dx + dy * dy)
        azimuth = math.atan2(dy, dx) * RAD2DEG - yaw
        rate = (dx * ux + dy * uy) / r
        rows = [
            [dx / r, dy / r, 0.0, 0.0],
            [-dy / (r * r) * RAD2DEG, dx / (r * r) * RAD2DEG, 0.0, 0.0],
            [ux / r - rate * dx / (r * r), uy / r - rate * dy / (r * r), dx / r, dy / r],
        ]
        return [r, azimuth, rate], rows

    def correct(self, msg):
        """One number after another, linearised where the prediction is."""
        h, H = self.expected(msg)
        start = list(self.X)
        for k, measured in enumerate(msg["data"]):
            residual = measured - h[k]
            if msg["sensor"] == "radar" and k == 1:
                residual = normalize_deg(residual)
            residual -= sum(H[k][i] * (self.X[i] - start[i]) for i in range(4))
            PHt = [sum(self.P(i, j) * H[k][j] for j in range(4)) for i in range(4)]
            S = sum(H[k][i] * PHt[i] for i in range(4)) + msg["variance"][k]
            gain = [value / S for value in PHt]
            for i in range(4):
                self.X[i] += gain[i] * residual
            for i in range(4):
                for j in range(4):
                    self.P.set(i, j, self.P(i, j) - gain[i] * PHt[j])


class Tracker:
    def step(self, state, scan):
        msg = self.message(scan)
        node = Filter() if state is None else copy.deepcopy(state)
        if state is None:
            node.initialise(msg)
        else:
            node.predict(msg["stamp"])
            if scan.valid:
                node.correct(msg)
        P = np.array(node.P.m)
        return node, (np.array(node.X), (P + P.T) / 2)

    def message(self, scan):
        variance = np.diag(scan.noise_covariance).tolist()
        data = scan.measurement.tolist()
        if scan.kind == "radar":
            data[1] *= RAD2DEG
            variance[1] *= RAD2DEG * RAD2DEG
        return {
            "sensor": scan.kind,
            "stamp": stamp_of(scan.time),
            "data": data,
            "variance": variance,
            "pose": [scan.sensor_pose[0], scan.sensor_pose[1], scan.sensor_pose[2] * RAD2DEG],
            "twist": scan.sensor_velocity.tolist(),
        }
