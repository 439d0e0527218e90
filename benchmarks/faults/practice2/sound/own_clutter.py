"""Joint probabilistic data association that counts the false alarms itself, and states their density from that."""

import math

import numpy as np
from benchmarks.faults import parts

GATES = {2: 18.42, 3: 21.11}


class Track:
    def __init__(self, scan, detection):
        z, H, R = parts.linear(scan, detection)
        self.x, self.P = np.array([z[0], z[1], 0.0, 0.0]), np.diag([0.0, 0.0, 400.0, 400.0])
        self.P[:2, :2] = R[:2, :2]
        if len(z) == 3:
            self.x, self.P = parts.updated(self.x, self.P, z[2:], H[2:], R[2:, 2:])
        self.hits, self.missed, self.seen, self.number = 1, 0, scan.time, None


class Tracker:
    identities = "hidden"

    def __init__(self):
        self.tracks, self.given, self.time = [], 0, None
        self.false = {"radar": 2.0, "lidar": 2.0}  # false alarms in a scan, as counted so far

    def step(self, state, scan):
        dt = 0.0 if self.time is None else scan.time - self.time
        self.time = scan.time
        columns = [parts.linear(scan, d) for d in scan.measurement.T]
        for track in self.tracks:
            track.x, track.P = parts.moved(track.x, track.P, dt, 2.5)
        seen = [scan.detection_probability if parts.in_view(t.x, scan) else 0.05 for t in self.tracks]
        weights = self.weights(columns, seen, scan)
        explained = weights.sum(axis=0)
        rate = self.false[scan.kind]
        self.false[scan.kind] = max(0.95 * rate + 0.05 * (1 - np.minimum(explained, 1.0)).sum(), 0.2)
        for track, own, visible in zip(self.tracks, weights, seen, strict=True):
            self.correct(track, own, columns, scan.time, visible)
        self.tracks = [track for track in self.tracks if self.alive(track)]
        self.tracks += [Track(scan, d) for d, p in zip(scan.measurement.T, explained, strict=True) if p < 0.2]
        shown = [track for track in self.tracks if track.number is not None]
        if not shown:
            return None, None
        means, covariances = np.stack([t.x for t in shown], axis=1), np.stack([t.P for t in shown], axis=2)
        return None, (np.array([t.number for t in shown]), means, covariances)

    def weights(self, columns, seen, scan):
        """Of each track (rows) the probability that it caused each detection: Fitzgerald's approximation of JPDA."""
        reach = scan.field_of_view.max_range
        extent = math.pi * reach**2 * (60.0 if scan.kind == "radar" else 1.0)
        density = self.false[scan.kind] / extent
        G = np.zeros((len(self.tracks), len(columns)))
        for i, track in enumerate(self.tracks):
            for j, (z, H, R) in enumerate(columns):
                S = H @ track.P @ H.T + R
                y = z - H @ track.x
                d2 = y @ np.linalg.solve(S, y)
                if d2 < GATES[len(z)]:
                    G[i, j] = seen[i] * math.exp(-d2 / 2) / math.sqrt(np.linalg.det(2 * math.pi * S))
        missed = density * (1 - np.array(seen))[:, None]
        return G / np.maximum(G.sum(axis=0) + G.sum(axis=1, keepdims=True) - G + missed, 1e-300)

    def correct(self, track, own, columns, time, visible):
        total = own.sum()
        if total <= 0.5:
            track.missed += visible > 0.5
        else:
            track.hits, track.missed, track.seen = track.hits + 1, 0, time
            if track.number is None and track.hits > 2:
                track.number = self.given
                self.given += 1
        mixture = [(max(1 - total, 0.0), track.x, track.P)]
        mixture += [(w, *parts.updated(track.x, track.P, *columns[j])) for j, w in enumerate(own) if w > 1e-9]
        whole = sum(w for w, _, _ in mixture)
        mean = sum(w / whole * x for w, x, _ in mixture)
        P = sum(w / whole * (C + np.outer(x - mean, x - mean)) for w, x, C in mixture)
        track.x, track.P = mean, (P + P.T) / 2

    def alive(self, track):
        return track.missed < 2 if track.number is None else self.time - track.seen < 1.0
