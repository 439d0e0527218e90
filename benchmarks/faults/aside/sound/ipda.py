"""Integrated probabilistic data association: a track weighs all detections in its gate, and states its existence."""

from typing import NamedTuple

import numpy as np
from benchmarks.faults.parts import in_view, linear, moved, updated
from scipy.stats import chi2


class Track(NamedTuple):
    id: int
    x: np.ndarray
    P: np.ndarray
    existence: float
    confirmed: bool = False
    used: int = -1


class Tracker:
    identities = "hidden"

    def __init__(self, gate=0.9995, lifetime_s=20.0):
        self.gate, self.lifetime = gate, lifetime_s

    def step(self, state, scan):
        time, count, tracks = state or (scan.time, 0, [])
        dt = scan.time - time
        detections = [linear(scan, d) for d in scan.measurement.T]
        survival = np.exp(-max(dt, 0.0) / self.lifetime)
        taken, after = set(), []
        for t in tracks:
            x, P = moved(t.x, t.P, dt)
            t = t._replace(x=x, P=P, existence=t.existence * survival)
            t, near = self.updated(t, detections, scan)
            taken |= near
            t = t._replace(confirmed=t.confirmed or t.existence > 0.98)
            if t.existence > 0.005:
                after.append(t)
        for j, (z, H, R) in enumerate(detections):
            if j not in taken:
                x, P = updated(np.array([*z[:2], 0.0, 0.0]), np.diag([1e4, 1e4, 400.0, 400.0]), z, H, R)
                after.append(Track(count, x, P, 0.15, used=j))
                count += 1
        return (scan.time, count, self.distinct(after)), self.output([t for t in self.distinct(after) if t.confirmed])

    def updated(self, t, detections, scan):
        pd = min(scan.detection_probability or 0.0, 0.9) * in_view(t.x, scan)  # no sensor is perfect
        near, ratios, parts = [], [], []
        for j, (z, H, R) in enumerate(detections):
            y, S = z - H @ t.x, H @ t.P @ H.T + R
            distance = y @ np.linalg.solve(S, y)
            if distance < chi2.ppf(self.gate, len(y)):
                likelihood = np.exp(-distance / 2) / np.sqrt(np.linalg.det(2 * np.pi * S))
                near.append(j)
                ratios.append(pd * likelihood / self.density(scan, z))
                parts.append(updated(t.x, t.P, z, H, R))
        total = 1 - pd * self.gate + sum(ratios)
        existence = total * t.existence / (1 - t.existence + total * t.existence)
        if not near:
            return t._replace(existence=existence, used=-1), set()
        weights = np.array([1 - pd * self.gate, *ratios]) / total
        parts = [(t.x, t.P), *parts]
        x = sum(w * m for w, (m, _) in zip(weights, parts, strict=True))
        P = sum(w * (C + np.outer(m - x, m - x)) for w, (m, C) in zip(weights, parts, strict=True))
        best = int(np.argmax(weights))
        return t._replace(x=x, P=P, existence=existence, used=near[best - 1] if best else -1), set(near)

    def density(self, scan, z):
        """Of clutter in the space of z: a radar states it per m, rad and m/s."""
        stated = max(scan.clutter_density or 0.0, 1e-9)
        return stated / np.hypot(*(z[:2] - scan.sensor_pose[:2])) if scan.kind == "radar" else stated

    def distinct(self, tracks):
        """Of two tracks that have come together the older one stays."""
        kept = []
        for t in sorted(tracks, key=lambda t: (not t.confirmed, t.id)):
            gaps = [(t.x - k.x, t.P + k.P) for k in kept]
            if all(d @ np.linalg.solve(S, d) > 1.0 for d, S in gaps):
                kept.append(t)
        return kept

    def output(self, tracks):
        if not tracks:
            return None
        mean, P = np.stack([t.x for t in tracks], axis=-1), np.stack([t.P for t in tracks], axis=-1)
        existence = np.array([min(t.existence, 1.0) for t in tracks])
        return np.array([t.id for t in tracks]), mean, P, existence, np.array([t.used for t in tracks])
