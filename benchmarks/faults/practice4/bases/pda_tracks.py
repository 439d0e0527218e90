"""Probabilistic data association, each track for itself, with objects of its own for motion, sensor and track."""

from dataclasses import dataclass, field

import numpy as np
from scipy.stats import chi2

GATE = 0.999


@dataclass
class Motion:
    dt: float = 1 / 24
    spectral: float = 2.0

    def matrices(self):
        F = np.eye(4) + self.dt * np.eye(4, k=2)
        one = np.array([[self.dt**3 / 3, self.dt**2 / 2], [self.dt**2 / 2, self.dt]])
        return F, self.spectral * np.kron(one, np.eye(2))


@dataclass(eq=False)
class Track:
    x: np.ndarray
    P: np.ndarray
    motion: Motion = field(default_factory=Motion)
    number: int = -1
    occurrences: int = 1

    def predict(self):
        F, Q = self.motion.matrices()
        self.x = F @ self.x
        self.P = F @ self.P @ F.T + Q


class View:
    """A scan, in polar coordinates for a radar."""

    def __init__(self, scan):
        self.scan = scan
        self.radar = scan.kind == "radar"
        self.R = scan.noise_covariance
        self.pd = scan.detection_probability
        self.density = scan.clutter_density
        self.gate = chi2.ppf(GATE, len(self.R))

    def predicted(self, x):
        dx, dy = x[:2] - self.scan.sensor_pose[:2]
        yaw = self.scan.sensor_pose[2]
        if not self.radar:
            J = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
            return J @ [dx, dy], np.hstack([J, np.zeros((2, 2))])
        ux, uy = x[2:] - self.scan.sensor_velocity
        r = max(np.hypot(dx, dy), 0.5)
        c, s = dx / r, dy / r
        turn = (c * uy - s * ux) / r
        H = np.array([[c, s, 0, 0], [-s / r, c / r, 0, 0], [-s * turn, c * turn, c, s]])
        return np.array([r, np.arctan2(dy, dx) - yaw, c * ux + s * uy]), H

    def innovations(self, h):
        """A row for each detection."""
        nu = self.scan.measurement.T - h
        if self.radar:
            nu[:, 1] = (nu[:, 1] + np.pi) % (2 * np.pi) - np.pi
        return nu

    def covers(self, x):
        return np.hypot(*(x[:2] - self.scan.sensor_pose[:2])) < self.scan.field_of_view.max_range

    def start(self, z):
        yaw = self.scan.sensor_pose[2]
        r, a = (z[0], yaw + z[1]) if self.radar else (1.0, yaw)
        J = np.array([[np.cos(a), -r * np.sin(a)], [np.sin(a), r * np.cos(a)]])
        x = np.zeros(4)
        x[:2] = self.scan.sensor_pose[:2] + J @ ([r, 0.0] if self.radar else z)
        P = np.diag([0.0, 0.0, 500.0, 500.0])
        P[:2, :2] = J @ self.R[:2, :2] @ J.T
        return x, P


class Tracker:
    identities = "hidden"
    CONFIRMED, HIGHEST = 3, 8

    def __init__(self):
        self.tracks = []
        self.numbers = 0
        self.latest = None

    def step(self, state, scan):
        dt = 0.0 if self.latest is None else scan.time - self.latest
        self.latest = scan.time
        view = View(scan)
        free = np.ones(scan.measurement.shape[1], dtype=bool)
        remaining = []
        for track in self.tracks:
            if self.ended(track):
                continue
            track.motion.dt = dt
            track.predict()
            remaining.append(track)
        self.tracks = self.apart(remaining)
        for track in self.tracks:
            near = self.associate(track, view)
            free[near] = False
            self.count(track, view, len(near) > 0)
        for j in np.flatnonzero(free):
            self.tracks.append(Track(*view.start(scan.measurement[:, j])))
        return None, self.published()

    def associate(self, track, view):
        """The detections in the gate, by which the track is updated."""
        h, H = view.predicted(track.x)
        nu = view.innovations(h)
        S = H @ track.P @ H.T + view.R
        d2 = np.einsum("ji,ji->j", nu, np.linalg.solve(S, nu.T).T)
        near = np.flatnonzero(d2 < view.gate)
        if len(near) == 0:
            return near
        likelihood = np.exp(-0.5 * d2[near]) / np.sqrt(np.linalg.det(2 * np.pi * S))
        weights = np.append(view.pd * likelihood / view.density, 1.0 - view.pd * GATE)
        beta = weights / weights.sum()
        beta0, beta = beta[-1], beta[:-1]
        K = np.linalg.solve(S, H @ track.P).T
        mean = beta @ nu[near]
        spread = (beta[:, None] * nu[near]).T @ nu[near] - np.outer(mean, mean)
        Pc = track.P - K @ S @ K.T
        track.x = track.x + K @ mean
        track.P = beta0 * track.P + (1 - beta0) * Pc + K @ spread @ K.T
        track.P = (track.P + track.P.T) / 2
        return near

    def count(self, track, view, seen):
        if seen:
            track.occurrences = min(track.occurrences + 1, self.HIGHEST)
        elif view.covers(track.x):
            track.occurrences -= 1
        if track.number < 0 and track.occurrences >= self.CONFIRMED:
            track.number = self.numbers
            self.numbers += 1

    def ended(self, track):
        return track.occurrences <= 0 or track.P[0, 0] + track.P[1, 1] > 50.0

    def apart(self, tracks):
        """Of two tracks of one object the older one."""
        kept = []
        for track in sorted(tracks, key=lambda t: (t.number < 0, t.number)):
            gaps = [np.abs(track.x - other.x) for other in kept]
            if all(np.hypot(*gap[:2]) > 1.0 or np.hypot(*gap[2:]) > 3.0 for gap in gaps):
                kept.append(track)
        return kept

    def published(self):
        shown = [t for t in self.tracks if t.number >= 0 and not self.ended(t)]
        if not shown:
            return None
        ids = np.array([t.number for t in shown])
        return ids, np.column_stack([t.x for t in shown]), np.dstack([t.P for t in shown])
