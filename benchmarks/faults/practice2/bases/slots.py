"""All tracks in arrays, one slot each, updated together; the nearest pairs first; positions, then the range rates."""

import numpy as np

SLOTS = 64
GATE = 18.4  # squared distance of a position


class Table:
    def __init__(self):
        self.used = np.zeros(SLOTS, dtype=bool)
        self.number = np.full(SLOTS, -1)
        self.X = np.zeros((SLOTS, 4))
        self.P = np.zeros((SLOTS, 4, 4))
        self.hits = np.zeros(SLOTS, dtype=int)
        self.missed = np.zeros(SLOTS, dtype=int)
        self.seen = np.zeros(SLOTS)

    def add(self, position, covariance, now):
        free = np.flatnonzero(~self.used)
        if len(free) == 0:
            return
        k = free[0]
        self.used[k], self.number[k] = True, -1
        self.X[k] = [position[0], position[1], 0.0, 0.0]
        self.P[k] = np.diag([0.0, 0.0, 625.0, 625.0])
        self.P[k, :2, :2] = covariance
        self.hits[k], self.missed[k], self.seen[k] = 1, 0, now

    def predict(self, dt, sigma):
        F = np.eye(4)
        F[0, 2] = F[1, 3] = dt
        G = np.kron([[dt**2 / 2], [dt]], np.eye(2))
        k = self.used
        self.X[k] = self.X[k] @ F.T
        self.P[k] = F @ self.P[k] @ F.T + sigma**2 * G @ G.T


def positions(scan):
    """(D, 2) in the fixed frame, (D, 2, 2) their covariances."""
    ex, ey, yaw = scan.sensor_pose
    m = scan.measurement
    if scan.kind == "radar":
        c, s = np.cos(m[1] + yaw), np.sin(m[1] + yaw)
        J = np.moveaxis(np.array([[c, -m[0] * s], [s, m[0] * c]]), 2, 0)
        place = np.stack([ex + m[0] * c, ey + m[0] * s], axis=1)
    else:
        c, s = np.cos(yaw), np.sin(yaw)
        J = np.broadcast_to([[c, -s], [s, c]], (m.shape[1], 2, 2))
        place = np.array([ex, ey]) + m.T @ J[0].T if m.shape[1] else np.zeros((0, 2))
    return place, J @ scan.noise_covariance[:2, :2] @ J.transpose(0, 2, 1)


class Tracker:
    identities = "hidden"

    def __init__(self, sigma=3.0, confirm=3, patience=1.0):
        self.sigma, self.confirm, self.patience = sigma, confirm, patience
        self.table = Table()
        self.counter = 0
        self.now = None

    def step(self, state, scan):
        t = self.table
        if self.now is not None:
            t.predict(scan.time - self.now, self.sigma)
        self.now = scan.time
        place, R = positions(scan)
        pairs = self.nearest_first(place, R, scan)
        for k, j in pairs:
            self.correct(k, place[j], R[j])
            if scan.kind == "radar":
                self.correct_rate(k, scan, j)
            t.hits[k] += 1
            t.missed[k] = 0
            t.seen[k] = scan.time
            if t.number[k] < 0 and t.hits[k] >= self.confirm:
                t.number[k] = self.counter
                self.counter += 1
        assigned = np.zeros(SLOTS, dtype=bool)
        assigned[[k for k, _ in pairs]] = True
        near = np.hypot(*(t.X[:, :2] - scan.sensor_pose[:2]).T) < scan.field_of_view.max_range
        t.missed[t.used & near & ~assigned] += 1
        t.used &= scan.time - t.seen <= self.patience
        t.used &= ~((t.number < 0) & (t.missed > 1))
        fresh = np.setdiff1d(np.arange(len(place)), [j for _, j in pairs])
        for j in fresh:
            t.add(place[j], R[j], scan.time)
        return None, self.show()

    def nearest_first(self, place, R, scan):
        """Pairs of slot and detection, each at most once."""
        t = self.table
        rows = np.flatnonzero(t.used)
        y = place[None] - t.X[rows, None, :2]
        S = t.P[rows, None, :2, :2] + R[None]
        d2 = np.einsum("ijk,ijkl,ijl->ij", y, np.linalg.inv(S), y)
        cost = d2 + np.log(np.linalg.det(S))
        allowed = d2 < GATE
        if scan.kind == "radar":
            allowed &= self.rate_fits(rows, scan)
        pairs, taken_rows, taken_columns = [], set(), set()
        for flat in np.argsort(cost, axis=None, kind="stable"):
            i, j = np.unravel_index(flat, cost.shape)
            if allowed[i, j] and i not in taken_rows and j not in taken_columns:
                pairs.append((rows[i], j))
                taken_rows.add(i)
                taken_columns.add(j)
        return pairs

    def sight(self, scan):
        """Over ground the speed of approach or flight, and where it points."""
        angle = scan.measurement[1] + scan.sensor_pose[2]
        e = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return scan.measurement[2] + e @ scan.sensor_velocity, e

    def rate_fits(self, rows, scan):
        t = self.table
        rate, e = self.sight(scan)
        expected = t.X[rows, 2:] @ e.T
        variance = np.einsum("jk,ikl,jl->ij", e, t.P[rows, 2:, 2:], e) + scan.noise_covariance[2, 2]
        return (rate - expected) ** 2 < 16.0 * variance

    def correct(self, k, z, R):
        t = self.table
        S = t.P[k, :2, :2] + R
        K = t.P[k, :, :2] @ np.linalg.inv(S)
        t.X[k] = t.X[k] + K @ (z - t.X[k, :2])
        t.P[k] = t.P[k] - K @ S @ K.T

    def correct_rate(self, k, scan, j):
        t = self.table
        rate, e = self.sight(scan)
        h = np.concatenate([[0.0, 0.0], e[j]])
        Ph = t.P[k] @ h
        s = h @ Ph + scan.noise_covariance[2, 2]
        t.X[k] += Ph / s * (rate[j] - h @ t.X[k])
        t.P[k] -= np.outer(Ph, Ph) / s

    def show(self):
        t = self.table
        k = np.flatnonzero(t.used & (t.number >= 0))
        if len(k) == 0:
            return None
        P = t.P[k]
        return t.number[k].copy(), t.X[k].T.copy(), np.moveaxis((P + P.transpose(0, 2, 1)) / 2, 0, 2).copy()
