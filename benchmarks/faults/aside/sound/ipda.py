"""Integrated probabilistic data association: a track weighs all detections in its gate, and states its existence."""

from typing import NamedTuple

import numpy as np
from scipy.stats import chi2


def linear(scan, d):
    """z, H and R of a detection, fixed frame: the position, and of a radar the speed over ground along the ray."""
    radar, yaw = scan.kind == "radar", scan.sensor_pose[2]
    r, angle = (d[0], yaw + d[1]) if radar else (1.0, yaw)
    c, s = np.cos(angle), np.sin(angle)
    J = np.array([[c, -r * s], [s, r * c]])
    z = scan.sensor_pose[:2] + J @ (np.array([r, 0.0]) if radar else d)
    H, R = np.eye(2, 4), J @ scan.noise_covariance[:2, :2] @ J.T
    if radar:
        z = np.append(z, d[2] + np.array([c, s]) @ scan.sensor_velocity)
        H = np.vstack([H, [0.0, 0.0, c, s]])
        R = np.pad(R, (0, 1))
        R[2, 2] = scan.noise_covariance[2, 2] + 0.15**2  # the ray is that of the measured azimuth
    return z, H, R


def in_view(x, scan):
    dx, dy = x[:2] - scan.sensor_pose[:2]
    off = (np.arctan2(dy, dx) - scan.sensor_pose[2] + np.pi) % (2 * np.pi) - np.pi
    return bool(np.hypot(dx, dy) < scan.field_of_view.max_range and abs(off) < scan.field_of_view.half_angle)


def constant_velocity(dt, sigma=3.0):
    F = np.eye(4) + dt * np.eye(4, k=2)
    G = sigma * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
    return F, G @ G.T


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
        F, Q = constant_velocity(dt)
        survival = np.exp(-max(dt, 0.0) / self.lifetime)
        taken, after = set(), []
        for t in tracks:
            t = t._replace(x=F @ t.x, P=F @ t.P @ F.T + Q, existence=t.existence * survival)
            t, near = self.updated(t, detections, scan)
            taken |= near
            t = t._replace(confirmed=t.confirmed or t.existence > 0.98)
            if t.existence > 0.005:
                after.append(t)
        for j, (z, H, R) in enumerate(detections):
            if j not in taken:
                P = np.diag([1e4, 1e4, 400.0, 400.0])
                K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
                A, x = np.eye(4) - K @ H, np.array([z[0], z[1], 0.0, 0.0])
                after.append(Track(count, x + K @ (z - H @ x), A @ P @ A.T + K @ R @ K.T, 0.15, used=j))
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
                K = np.linalg.solve(S, H @ t.P).T
                A = np.eye(4) - K @ H
                near.append(j)
                ratios.append(pd * likelihood / self.density(scan, z))
                parts.append((t.x + K @ y, A @ t.P @ A.T + K @ R @ K.T))
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
