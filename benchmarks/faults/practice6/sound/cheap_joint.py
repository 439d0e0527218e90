"""Joint association by Fitzgerald's cheap formula: each weight is divided by the sums of its row and its column."""

import numpy as np
from benchmarks.faults import parts

GATES = {2: 16.3, 3: 18.9}
LOST, TENTATIVE = 0.9, 0.21  # s without a detection
HITS = 4


class Track:
    def __init__(self, x, P, time):
        self.x, self.P, self.seen = x, P, time
        self.hits, self.number = 1, -1


class Tracker:
    identities = "hidden"

    def __init__(self):
        self.tracks, self.time, self.numbers = [], None, 0

    def step(self, state, scan):
        dt = 0.0 if self.time is None else scan.time - self.time
        self.time = scan.time
        for t in self.tracks:
            t.x, t.P = parts.moved(t.x, t.P, dt, 2.5)
        detections = [parts.linear(scan, d) for d in scan.measurement.T]
        G = self.densities(detections, scan)
        free = np.ones(len(detections), dtype=bool)
        old = [i for i, t in enumerate(self.tracks) if t.number >= 0]
        new = [i for i, t in enumerate(self.tracks) if t.number < 0]
        for group in (old, new):  # what established tracks claim is not offered to others
            columns = np.flatnonzero(free)
            claimed = self.shared(group, columns, G, detections, scan)
            free[columns[claimed]] = False
        self.tracks = [t for t in self.tracks if self.kept(t)]
        self.tracks = self.apart(self.tracks)
        for j in np.flatnonzero(free):
            z, _, R = detections[j]
            P = np.diag([0.0, 0.0, 400.0, 400.0])
            P[:2, :2] = R[:2, :2]
            self.tracks.append(Track(np.array([*z[:2], 0.0, 0.0]), P, scan.time))
        return None, self.shown()

    def densities(self, detections, scan):
        """Of each detection for each track, over that of false alarms."""
        G = np.zeros((len(self.tracks), len(detections)))
        for i, t in enumerate(self.tracks):
            for j, (z, H, R) in enumerate(detections):
                y, S = z - H @ t.x, H @ t.P @ H.T + R
                d2 = y @ np.linalg.solve(S, y)
                if d2 < GATES[len(z)]:
                    r = max(scan.measurement[0, j], 1.0) if scan.kind == "radar" else 1.0
                    G[i, j] = (
                        np.exp(-d2 / 2) / np.sqrt(np.linalg.det(2 * np.pi * S)) / (scan.clutter_density / r + 1e-9)
                    )
        return G

    def shared(self, group, columns, G, detections, scan):
        g = scan.detection_probability * G[np.ix_(group, columns)]
        if g.size and self.tracks[group[0]].number < 0:  # a new track takes one detection, and is its best one
            g = np.where((g == g.max(axis=1, keepdims=True)) & (g == g.max(axis=0, keepdims=True)), g, 0.0)
        miss = 1 - scan.detection_probability
        total = g.sum(axis=1, keepdims=True) + g.sum(axis=0, keepdims=True) - g + miss
        beta = g / total
        for i, row in zip(group, beta, strict=True):
            t = self.tracks[i]
            if row.sum() > 0.5:
                t.hits, t.seen = t.hits + 1, scan.time
                if t.number < 0 and t.hits >= HITS:
                    t.number, self.numbers = self.numbers, self.numbers + 1
            terms = [(1 - row.sum(), t.x, t.P)]
            terms += [(b, *parts.updated(t.x, t.P, *detections[j])) for b, j in zip(row, columns, strict=True) if b > 0]
            x = sum(w * m for w, m, _ in terms)
            P = sum(w * (C + np.outer(m - x, m - x)) for w, m, C in terms)
            t.x, t.P = x, (P + P.T) / 2
        return np.flatnonzero(g.sum(axis=0) > 1.0)

    def kept(self, t):
        return self.time - t.seen <= (TENTATIVE if t.number < 0 else LOST)

    def apart(self, tracks):
        result = []
        for t in sorted(tracks, key=lambda t: (t.number < 0, t.number)):
            gaps = [np.abs(t.x - o.x) for o in result]
            if all(np.hypot(*gap[:2]) > 1.0 or np.hypot(*gap[2:]) > 6.0 for gap in gaps):
                result.append(t)
        return result

    def shown(self):
        ts = [t for t in self.tracks if t.number >= 0]
        if not ts:
            return None
        return np.array([t.number for t in ts]), np.array([t.x for t in ts]).T, np.stack([t.P for t in ts], axis=-1)
