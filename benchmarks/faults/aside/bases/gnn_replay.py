"""Global nearest neighbour by the Hungarian method. After a late scan, what came after it is done again."""

from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.stats import chi2

BEYOND = 1e6  # cost of a pair outside the gate


class Track(NamedTuple):
    id: int
    x: np.ndarray
    P: np.ndarray
    hits: int = 1
    scans: int = 1
    seen: float = 0.0
    used: int = -1

    @property
    def confirmed(self):
        return self.hits >= 3


class Tracker:
    identities = "hidden"

    def __init__(self, gate=0.9995, delete_after_s=1.0, memory_s=0.6):
        self.gate, self.delete_after, self.memory = gate, delete_after_s, memory_s

    def step(self, state, scan):
        """State: the latest moments, each the scan and what was known after it."""
        past = list(state or [])
        if scan.asked:
            time, _, known = past[-1] if past else (scan.time, None, (0, ()))
            return state, self.output([self.predicted(track, scan.time - time) for track in known[1]])
        later = []
        while past and past[-1][0] > scan.time:
            later.insert(0, past.pop())
        for one in [scan, *(moment[1] for moment in later)]:
            time, _, known = past[-1] if past else (one.time, None, (0, ()))
            past.append((one.time, one, self.processed(known, one, one.time - time)))
        now, (_, tracks) = past[-1][0], past[-1][2]
        if later:  # the tracks name detections of the last scan, not of this one
            tracks = [track._replace(used=-1) for track in tracks]
        return [m for m in past if now - m[0] <= self.memory], self.output(tracks)

    def processed(self, known, scan, dt):
        next_id, tracks = known
        tracks = [self.predicted(track, dt) for track in tracks]
        z, H, R = self.linear(scan)
        matched, free = self.associate(tracks, z, H, R)
        after = []
        for i, track in enumerate(tracks):
            if i in matched:
                j = matched[i]
                x, P = self.updated(track.x, track.P, z[j], H[j], R[j])
                after.append(Track(track.id, x, P, track.hits + 1, track.scans + 1, scan.time, j))
            else:
                track = track._replace(scans=track.scans + self.in_view(track.x, scan), used=-1)
                hopeless = not track.confirmed and track.scans - track.hits > 2
                if not hopeless and scan.time - track.seen <= self.delete_after:
                    after.append(track)
        for j in free:
            x, P = self.updated(np.array([*z[j][:2], 0, 0]), np.diag([1e4, 1e4, 400.0, 400.0]), z[j], H[j], R[j])
            after.append(Track(next_id, x, P, seen=scan.time, used=j))
            next_id += 1
        return next_id, tuple(after)

    def associate(self, tracks, z, H, R):
        cost = np.full((len(tracks), len(z)), BEYOND)
        for i, track in enumerate(tracks):
            for j in range(len(z)):
                y, S = z[j] - H[j] @ track.x, H[j] @ track.P @ H[j].T + R[j]
                distance = y @ np.linalg.solve(S, y)
                if distance < chi2.ppf(self.gate, len(y)):
                    cost[i, j] = distance + np.log(np.linalg.det(S))
        rows, columns = linear_sum_assignment(cost)
        matched = {i: j for i, j in zip(rows, columns, strict=True) if cost[i, j] < BEYOND}
        return matched, [j for j in range(len(z)) if j not in matched.values()]

    def predicted(self, track, dt):
        F = np.eye(4) + dt * np.eye(4, k=2)
        G = 3.0 * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
        return track._replace(x=F @ track.x, P=F @ track.P @ F.T + G @ G.T, used=-1)

    def updated(self, x, P, z, H, R):
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        A = np.eye(4) - K @ H
        return x + K @ (z - H @ x), A @ P @ A.T + K @ R @ K.T

    def in_view(self, x, scan):
        dx, dy = x[:2] - scan.sensor_pose[:2]
        off = (np.arctan2(dy, dx) - scan.sensor_pose[2] + np.pi) % (2 * np.pi) - np.pi
        return np.hypot(dx, dy) < scan.field_of_view.max_range and abs(off) < scan.field_of_view.half_angle

    def linear(self, scan):
        """z (D, m), H (D, m, 4) and R (D, m, m) in the fixed frame."""
        zs, Hs, Rs = [], [], []
        for d in scan.measurement.T:
            radar, yaw = scan.kind == "radar", scan.sensor_pose[2]
            r, angle = (d[0], yaw + d[1]) if radar else (1.0, yaw)
            c, s = np.cos(angle), np.sin(angle)
            J = np.array([[c, -r * s], [s, r * c]])
            z = scan.sensor_pose[:2] + J @ (np.array([r, 0.0]) if radar else d)
            H, R = np.eye(2, 4), J @ scan.noise_covariance[:2, :2] @ J.T
            if radar:
                z = np.append(z, d[2] + np.array([c, s]) @ scan.sensor_velocity)
                H, R = np.vstack([H, [0, 0, c, s]]), np.pad(R, (0, 1))
                R[2, 2] = scan.noise_covariance[2, 2]
            zs, Hs, Rs = [*zs, z], [*Hs, H], [*Rs, R]
        return zs, Hs, Rs

    def output(self, tracks):
        tracks = [track for track in tracks if track.confirmed]
        if not tracks:
            return None
        mean, P = np.stack([t.x for t in tracks], axis=-1), np.stack([t.P for t in tracks], axis=-1)
        return np.array([t.id for t in tracks]), mean, P, None, np.array([t.used for t in tracks])
