"""After a 3D multi-object tracker: a KF per object, confirmed tracks matched first, then what is left."""

import numpy as np
from scipy.optimize import linear_sum_assignment

LIMIT = {2: 13.8, 3: 16.3}  # squared distance, by the numbers in a detection


class KF:
    count = 0

    def __init__(self, z, R, dt=0.05):
        self.dt = dt
        self.kf_x = np.zeros(4)
        self.kf_x[:2] = z[:2]
        self.kf_P = np.diag([0.0, 0.0, 625.0, 625.0])
        self.kf_P[:2, :2] = R[:2, :2]
        self.id = -1
        self.hits = 1
        self.misses = 0
        self.lost = 0.0

    def predict(self):
        F = np.eye(4)
        F[0, 2] = F[1, 3] = self.dt
        g = np.array([self.dt**2 / 2, self.dt])
        self.kf_x = F @ self.kf_x
        self.kf_P = F @ self.kf_P @ F.T + 9.0 * np.kron(np.outer(g, g), np.eye(2))
        self.lost += self.dt

    def distance(self, det):
        z, H, R = det
        nu = z - H @ self.kf_x
        S = H @ self.kf_P @ H.T + R
        return nu @ np.linalg.solve(S, nu)

    def update(self, det):
        z, H, R = det
        S = H @ self.kf_P @ H.T + R
        K = self.kf_P @ H.T @ np.linalg.inv(S)
        self.kf_x = self.kf_x + K @ (z - H @ self.kf_x)
        IKH = np.eye(4) - K @ H
        self.kf_P = IKH @ self.kf_P @ IKH.T + K @ R @ K.T
        self.hits += 1
        self.misses = 0
        self.lost = 0.0


def in_world(scan):
    """z, H, R of every detection."""
    x, y, yaw = scan.sensor_pose
    dets = []
    for m in scan.measurement.T:
        if scan.kind == "radar":
            c, s = np.cos(yaw + m[1]), np.sin(yaw + m[1])
            J = np.array([[c, -m[0] * s, 0], [s, m[0] * c, 0], [0, 0, 1]])
            z = np.array([x + m[0] * c, y + m[0] * s, m[2] + c * scan.sensor_velocity[0] + s * scan.sensor_velocity[1]])
            dets.append((z, np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, c, s]]), J @ scan.noise_covariance @ J.T))
        else:
            J = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
            dets.append((np.array([x, y]) + J @ m, np.eye(2, 4), J @ scan.noise_covariance @ J.T))
    return dets


def hungarian(trks, dets, rows, cols):
    """Matched pairs, rows and columns that are left."""
    cost = np.full((len(rows), len(cols)), 1e4)
    for a, i in enumerate(rows):
        for b, j in enumerate(cols):
            d = trks[i].distance(dets[j])
            if d < LIMIT[len(dets[j][0])]:
                cost[a, b] = d
    matches = [(rows[a], cols[b]) for a, b in zip(*linear_sum_assignment(cost), strict=True) if cost[a, b] < 1e4]
    taken_rows, taken_cols = {i for i, _ in matches}, {j for _, j in matches}
    return matches, [i for i in rows if i not in taken_rows], [j for j in cols if j not in taken_cols]


def greedy(trks, dets, rows, cols):
    """As hungarian; the nearest pair first."""
    pairs = []
    for i in rows:
        for j in cols:
            d = trks[i].distance(dets[j])
            if d < LIMIT[len(dets[j][0])]:
                pairs.append((d, i, j))
    match = {}
    for _, i, j in sorted(pairs):
        if i in match or j in match.values():
            continue
        match[i] = j
    matches = list(match.items())
    left = [j for j in cols if j not in match.values()]
    return matches, [i for i in rows if i not in match], left


class Tracker:
    identities = "hidden"

    def __init__(self, max_age=0.8, min_hits=3):
        self.max_age, self.min_hits = max_age, min_hits
        self.trks = []
        self.next_id = 0
        self.stamp = None

    def step(self, state, scan):
        dt = 0.0 if self.stamp is None else scan.time - self.stamp
        self.stamp = scan.time
        for trk in self.trks:
            trk.dt = dt
            trk.predict()
        dets = in_world(scan)
        self.associate(scan, dets)
        return None, self.output()

    def associate(self, scan, dets):
        confirmed = [i for i, trk in enumerate(self.trks) if trk.id >= 0]
        others = [i for i, trk in enumerate(self.trks) if trk.id < 0]
        matches_a, unmatched_a, left = greedy(self.trks, dets, confirmed, list(range(len(dets))))
        candidates = others + [i for i in unmatched_a if self.trks[i].lost < 0.3]
        unmatched_a = [i for i in unmatched_a if self.trks[i].lost >= 0.3]
        matches_b, unmatched_b, left = hungarian(self.trks, dets, candidates, left)
        for i, j in matches_a + matches_b:
            self.trks[i].update(dets[j])
            if self.trks[i].id < 0 and self.trks[i].hits >= self.min_hits:
                self.trks[i].id = self.next_id
                self.next_id += 1
        x, y, _ = scan.sensor_pose
        for i in unmatched_a + unmatched_b:
            trk = self.trks[i]
            if np.hypot(trk.kf_x[0] - x, trk.kf_x[1] - y) < scan.field_of_view.max_range:
                trk.misses += 1
        self.delete()
        for j in left:
            self.trks.append(KF(dets[j][0], dets[j][2]))

    def delete(self):
        del_tracks = []
        for i, trk in enumerate(self.trks):
            if trk.lost > self.max_age or (trk.id < 0 and trk.misses > 1):
                del_tracks.append(i)
        for i in del_tracks[::-1]:
            if i < len(self.trks):
                del self.trks[i]

    def output(self):
        shown = [trk for trk in self.trks if trk.id >= 0]
        if not shown:
            return None
        P = np.stack([trk.kf_P for trk in shown], axis=2)
        return np.array([trk.id for trk in shown]), np.stack([trk.kf_x for trk in shown], axis=1), P
