"""Joint probabilistic data association with all joint events of each cluster, tracks confirmed by M of N."""

from itertools import product
from typing import NamedTuple

import numpy as np

GATE = 16.0


class Track(NamedTuple):
    id: int
    x: np.ndarray
    P: np.ndarray
    hits: int = 1
    scans: int = 1
    lost: int = 0
    used: int = -1


class Tracker:
    identities = "hidden"

    def step(self, state, scan):
        time, count, tracks = state or (scan.time, 0, [])
        tracks = [self.predict(t, scan.time - time) for t in tracks]
        z, R = self.positions(scan)
        gated = [[j for j in range(len(z)) if self.distance(t, z[j], R[j]) < GATE] for t in tracks]
        density = scan.clutter_density or 1e-6
        beta = self.marginals(tracks, gated, z, R, scan, density)
        after = []
        for i, t in enumerate(tracks):
            x, P = self.update(t, gated[i], beta[i], z, R)
            hit = bool(gated[i]) and beta[i][-1] < 0.5
            seen = self.in_view(t.x, scan)
            used = gated[i][int(np.argmax(beta[i][:-1]))] if hit else -1
            t = Track(t.id, x, P, t.hits + hit, t.scans + seen, 0 if hit else t.lost + seen, used)
            if t.lost <= (8 if t.hits >= 5 else 1) and np.trace(t.P[:2, :2]) < 9:
                after.append(t)
        taken = {j for choice in gated for j in choice}
        for j in set(range(len(z))) - taken:
            P = np.diag([0.0, 0.0, 400.0, 400.0])
            P[:2, :2] = R[j]
            after.append(Track(count, np.array([*z[j], 0.0, 0.0]), P, used=j))
            count += 1
        return (scan.time, count, after), self.output([t for t in after if t.hits >= 5])

    def predict(self, t, dt):
        F = np.eye(4) + dt * np.eye(4, k=2)
        G = 3.0 * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
        return t._replace(x=F @ t.x, P=F @ t.P @ F.T + G @ G.T)

    def distance(self, t, z, R):
        y = z - t.x[:2]
        return y @ np.linalg.solve(t.P[:2, :2] + R, y)

    def marginals(self, tracks, gated, z, R, scan, density):
        """For each track the probabilities of its gated detections, and at last that of none."""
        pd = min(scan.detection_probability, 0.98)  # no sensor is perfect
        beta = [np.zeros(len(choice) + 1) for choice in gated]
        for cluster in self.clusters(gated):
            weights = []
            for i in cluster:
                S = [tracks[i].P[:2, :2] + R[j] for j in gated[i]]
                gain = [pd * np.exp(-self.distance(tracks[i], z[j], R[j]) / 2) for j in gated[i]]
                area = [
                    2 * np.pi * np.sqrt(np.linalg.det(s)) * density * self.volume(scan, z[j])
                    for s, j in zip(S, gated[i], strict=True)
                ]
                weights.append(
                    [*(g / a for g, a in zip(gain, area, strict=True)), 1 - pd * self.in_view(tracks[i].x, scan)]
                )
            for event in product(*[range(len(w)) for w in weights]):
                named = [gated[i][k] for i, k in zip(cluster, event, strict=True) if k < len(gated[i])]
                if len(named) == len(set(named)):
                    probability = np.prod([w[k] for w, k in zip(weights, event, strict=True)])
                    for i, k in zip(cluster, event, strict=True):
                        beta[i][k] += probability
            for i in cluster:
                beta[i] = beta[i] / beta[i].sum()
        return beta

    def clusters(self, gated):
        """Groups of at most five tracks that share detections; a track beyond that stands alone."""
        groups = []
        for i, choice in enumerate(gated):
            shared = [g for g in groups if any(set(choice) & set(gated[k]) for k in g)]
            if sum(map(len, shared)) >= 5:
                groups.append([i])
                continue
            groups = [g for g in groups if g not in shared] + [[i, *(k for g in shared for k in g)]]
        return groups

    def volume(self, scan, z):
        """Turns the stated density of clutter into one per m²: a radar states it per m, rad and m/s."""
        if scan.kind != "radar":
            return 1.0
        return 60.0 / np.hypot(*(z - scan.sensor_pose[:2]))

    def update(self, t, choice, beta, z, R):
        x, P = t.x, t.P
        if not choice:
            return x, P
        noise = sum(b * R[j] for b, j in zip(beta, choice, strict=False)) / max(beta[:-1].sum(), 1e-12)
        innovations = [z[j] - x[:2] for j in choice]
        y = sum(b * v for b, v in zip(beta, innovations, strict=False))
        K = P[:, :2] @ np.linalg.inv(P[:2, :2] + noise)
        A = np.eye(4) - K @ np.eye(2, 4)
        spread = np.zeros((2, 2))
        for b, v in zip(beta, innovations, strict=False):
            spread += b * np.outer(v, v)
        spread -= np.outer(y, y)
        updated = A @ P @ A.T + K @ noise @ K.T
        return x + K @ y, beta[-1] * P + (1 - beta[-1]) * updated + K @ spread @ K.T

    def in_view(self, x, scan):
        dx, dy = x[:2] - scan.sensor_pose[:2]
        off = (np.arctan2(dy, dx) - scan.sensor_pose[2] + np.pi) % (2 * np.pi) - np.pi
        return bool(np.hypot(dx, dy) < scan.field_of_view.max_range and abs(off) < scan.field_of_view.half_angle)

    def positions(self, scan):
        zs, Rs, yaw = [], [], scan.sensor_pose[2]
        for d in scan.measurement.T:
            r, angle = (d[0], yaw + d[1]) if scan.kind == "radar" else (1.0, yaw)
            J = np.array([[np.cos(angle), -r * np.sin(angle)], [np.sin(angle), r * np.cos(angle)]])
            zs.append(scan.sensor_pose[:2] + J @ (np.array([r, 0.0]) if scan.kind == "radar" else d))
            Rs.append(J @ scan.noise_covariance[:2, :2] @ J.T)
        return zs, Rs

    def output(self, tracks):
        if not tracks:
            return None
        mean, P = np.stack([t.x for t in tracks], axis=-1), np.stack([t.P for t in tracks], axis=-1)
        return np.array([t.id for t in tracks]), mean, P, None, np.array([t.used for t in tracks])
