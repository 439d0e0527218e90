"""A track begins with two places of different scans in reach, with the velocity between; EKF in polar."""

import numpy as np
from benchmarks.faults import parts
from scipy.optimize import linear_sum_assignment

GATE = {2: 18.42, 3: 21.11}
FASTEST = 45.0  # m/s


class Track:
    def __init__(self, early, late):
        (t0, z0, R0), (t1, z1, R1) = early, late
        dt = t1 - t0
        self.x = np.append(z1, (z1 - z0) / dt)
        noise = (R0 + R1) / dt**2 + 9.0 * dt**2 / 4 * np.eye(2)
        self.P = np.block([[R1, R1 / dt], [R1 / dt, noise]])
        self.seen, self.hits, self.looks, self.id = t1, 2, 2, -1

    def innovation(self, z, scan):
        h, H = parts.expected(self.x, scan)
        return parts.difference(z, h, scan), H @ self.P @ H.T + scan.noise_covariance, H


class Tracker:
    identities = "hidden"

    def __init__(self):
        self.tracks, self.singles, self.time, self.count = [], [], None, 0

    def step(self, state, scan):
        dt = 0.0 if self.time is None else scan.time - self.time
        self.time = scan.time
        for t in self.tracks:
            t.x, t.P = parts.moved(t.x, t.P, dt)
        Z = scan.measurement.T
        pairs = self.assigned(Z, scan)
        for i, j in pairs.items():
            self.correct(self.tracks[i], Z[j], scan)
        for t in self.tracks:
            t.looks += parts.in_view(t.x, scan)
        self.tracks = [t for t in self.tracks if self.stays(t)]
        self.begin([parts.position(scan, Z[j]) for j in range(len(Z)) if j not in pairs.values()])
        shown = [t for t in self.tracks if t.id >= 0]
        if not shown:
            return None, None
        ids = np.array([t.id for t in shown])
        return None, (ids, np.stack([t.x for t in shown], axis=1), np.stack([t.P for t in shown], axis=2))

    def assigned(self, Z, scan):
        cost = np.full((len(self.tracks), len(Z)), 1e4)
        for i, t in enumerate(self.tracks):
            for j, z in enumerate(Z):
                y, S, _ = t.innovation(z, scan)
                d2 = y @ np.linalg.solve(S, y)
                if d2 < GATE[len(z)]:
                    cost[i, j] = d2
        rows, columns = linear_sum_assignment(cost)
        return {i: j for i, j in zip(rows, columns, strict=True) if cost[i, j] < 1e4}

    def correct(self, t, z, scan):
        y, S, H = t.innovation(z, scan)
        K = np.linalg.solve(S, H @ t.P).T
        P = t.P - K @ S @ K.T
        t.x, t.P = t.x + K @ y, (P + P.T) / 2
        t.seen, t.hits = scan.time, t.hits + 1
        if t.id < 0 and t.hits >= 4:
            t.id, self.count = self.count, self.count + 1

    def stays(self, t):
        if t.id < 0:
            return t.looks - t.hits < 2 and self.time - t.seen < 0.4
        return self.time - t.seen <= 1.0

    def begin(self, places):
        """With the nearest earlier place in reach, of those that are left over."""
        late = [(self.time, z, R) for z, R in places]
        self.singles = [s for s in self.singles if self.time - s[0] < 0.25]
        left = []
        for new in late:
            reach = []
            for k, (time, z, R) in enumerate(self.singles):
                dt, gap = new[0] - time, np.hypot(*(new[1] - z))
                if dt > 0.02 and gap < FASTEST * dt + 2 * np.sqrt(np.trace(R + new[2])):
                    reach.append((gap, k))
            if reach:
                self.tracks.append(Track(self.singles.pop(min(reach)[1]), new))
            else:
                left.append(new)
        self.singles += left
