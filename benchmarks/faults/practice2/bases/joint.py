"""Joint probabilistic data association in the space of the measurements, by enumeration."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

GATE_PROBABILITY = 0.9999


@dataclass
class Target:
    mean: np.ndarray
    cov: np.ndarray
    label: int = -1
    score: float = 0.0


class Sensor:
    """What a sensor would measure of a target."""

    def __init__(self, scan):
        self.radar = scan.kind == "radar"
        self.place, self.yaw, self.velocity = scan.sensor_pose[:2], scan.sensor_pose[2], scan.sensor_velocity
        self.R = scan.noise_covariance
        self.reach = scan.field_of_view.max_range
        self.detection, self.clutter = scan.detection_probability, scan.clutter_density

    def expect(self, mean):
        d = mean[:2] - self.place
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        if not self.radar:
            A = np.array([[c, s], [-s, c]])
            return A @ d, np.hstack([A, np.zeros((2, 2))])
        v = mean[2:] - self.velocity
        r = max(math.hypot(d[0], d[1]), 0.1)
        e = d / r
        n = np.array([-e[1], e[0]])
        H = np.zeros((3, 4))
        H[0, :2], H[1, :2], H[2, :2], H[2, 2:] = e, n / r, n * (n @ v) / r, e
        return np.array([r, math.atan2(d[1], d[0]) - self.yaw, e @ v]), H

    def difference(self, z, h):
        y = z - h
        if self.radar:
            y[1] = math.remainder(y[1], 2 * math.pi)
        return y

    def sees(self, mean):
        return math.hypot(*(mean[:2] - self.place)) < self.reach

    def birth(self, z):
        if self.radar:
            c, s = math.cos(self.yaw + z[1]), math.sin(self.yaw + z[1])
            J = np.array([[c, -z[0] * s], [s, z[0] * c]])
            where = self.place + z[0] * np.array([c, s])
        else:
            c, s = math.cos(self.yaw), math.sin(self.yaw)
            J = np.array([[c, -s], [s, c]])
            where = self.place + J @ z
        cov = np.zeros((4, 4))
        cov[:2, :2] = J @ self.R[:2, :2] @ J.T
        cov[2:, 2:] = 25.0**2 * np.eye(2)
        target = Target(np.concatenate([where, np.zeros(2)]), cov)
        if self.radar:
            h, H = self.expect(target.mean)
            H = H[2:]
            S = (H @ cov @ H.T + self.R[2:, 2:])[0, 0]
            K = cov @ H.T / S
            target.mean = target.mean + K[:, 0] * (z[2] - h[2])
            target.cov = cov - K @ K.T * S
        return target


def joint_probabilities(likelihood, detection, clutter):
    """Of each target (rows) that it caused each detection (columns), and last that it caused none."""
    n, m = likelihood.shape
    beta = np.zeros((n, m + 1))

    def enumerate_events(i, weight, used, chosen):
        if i == n:
            for row, column in enumerate(chosen):
                beta[row, column] += weight
            return
        enumerate_events(i + 1, weight * (1.0 - detection[i] * GATE_PROBABILITY), used, [*chosen, m])
        for j in range(m):
            if likelihood[i, j] > 0 and j not in used:
                gain = detection[i] * likelihood[i, j] / clutter
                enumerate_events(i + 1, weight * gain, used | {j}, [*chosen, j])

    enumerate_events(0, 1.0, frozenset(), [])
    return beta / beta.sum(axis=1, keepdims=True)


def clusters(likelihood):
    """Targets that share detections."""
    groups = []
    for i in range(len(likelihood)):
        mine = {i}
        columns = set(np.flatnonzero(likelihood[i]))
        rest = []
        for rows, taken in groups:
            if taken & columns:
                mine, columns = mine | rows, columns | taken
            else:
                rest.append((rows, taken))
        groups = [*rest, (mine, columns)]
    return [(sorted(rows), sorted(columns)) for rows, columns in groups]


class Tracker:
    identities = "hidden"
    CONFIRM, DELETE, BIRTH = 7.0, -4.0, 0.05

    def __init__(self, spectral_density=1.5):
        self.q = spectral_density
        self.targets = []
        self.labels = 0
        self.clock = None

    def step(self, state, scan):
        if self.clock is not None:
            self.predict(scan.time - self.clock)
        self.clock = scan.time
        sensor = Sensor(scan)
        zs = list(scan.measurement.T)
        explained = self.update(sensor, zs)
        self.targets = [t for t in self.targets if t.score > self.DELETE and t.cov[0, 0] + t.cov[1, 1] < 60.0]
        for t in self.targets:
            if t.label < 0 and t.score > self.CONFIRM:
                t.label = self.labels
                self.labels += 1
        for z, probability in zip(zs, explained, strict=True):
            if probability < self.BIRTH:
                self.targets.append(sensor.birth(z))
        return None, self.report()

    def predict(self, dt):
        F = np.eye(4)
        F[0, 2] = F[1, 3] = dt
        Q = np.zeros((4, 4))
        for a in (0, 1):
            Q[a, a], Q[a, a + 2], Q[a + 2, a], Q[a + 2, a + 2] = dt**3 / 3, dt**2 / 2, dt**2 / 2, dt
        for t in self.targets:
            t.mean = F @ t.mean
            t.cov = F @ t.cov @ F.T + self.q * Q

    def update(self, sensor, zs):
        n, m = len(self.targets), len(zs)
        likelihood = np.zeros((n, m))
        models, ys = [], {}
        for i, t in enumerate(self.targets):
            h, H = sensor.expect(t.mean)
            S = H @ t.cov @ H.T + sensor.R
            models.append((H, S))
            for j, z in enumerate(zs):
                y = ys[i, j] = sensor.difference(z, h)
                d2 = y @ np.linalg.solve(S, y)
                if d2 < chi2.ppf(GATE_PROBABILITY, len(z)):
                    likelihood[i, j] = math.exp(-d2 / 2) / math.sqrt(np.linalg.det(2 * math.pi * S))
        detection = np.array([sensor.detection if sensor.sees(t.mean) else 0.05 for t in self.targets])
        explained = np.zeros(m)
        for rows, columns in clusters(likelihood):
            beta = joint_probabilities(likelihood[np.ix_(rows, columns)], detection[rows], sensor.clutter)
            for k, i in enumerate(rows):
                explained[columns] += beta[k, :-1]
                self.mix(self.targets[i], models[i], [ys[i, j] for j in columns], beta[k], sensor.R)
                ratio = 1 - detection[i] + detection[i] * likelihood[i].sum() / sensor.clutter
                self.targets[i].score = min(self.targets[i].score + math.log(ratio), 12.0)
        return explained

    def mix(self, t, model, ys, beta, R):
        if not ys:
            return
        H, S = model
        K = np.linalg.solve(S, H @ t.cov).T
        nu = sum(b * y for b, y in zip(beta[:-1], ys, strict=True))
        spread = sum(b * np.outer(y, y) for b, y in zip(beta[:-1], ys, strict=True)) - np.outer(nu, nu)
        updated = t.cov - K @ S @ K.T
        t.mean = t.mean + K @ nu
        t.cov = beta[-1] * t.cov + (1 - beta[-1]) * updated + K @ spread @ K.T
        t.cov = (t.cov + t.cov.T) / 2

    def report(self):
        shown = [t for t in self.targets if t.label >= 0]
        if not shown:
            return None
        means = np.array([t.mean for t in shown]).T
        return np.array([t.label for t in shown]), means, np.array([t.cov for t in shown]).transpose(1, 2, 0)
