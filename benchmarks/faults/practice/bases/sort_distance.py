"""SORT with Mahalanobis distances in place of overlaps: predict all, match, update, forget."""

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.stats import chi2


class KalmanPointTracker:
    count = 0

    def __init__(self, det, number):
        self.x = np.array([det["xy"][0], det["xy"][1], 0.0, 0.0])
        self.P = np.diag([0.0, 0.0, 25.0**2, 25.0**2])
        self.P[:2, :2] = det["R"][:2, :2]
        if len(det["z"]) == 3:
            self.fuse(det["z"][2:], det["H"][2:], det["R"][2:, 2:])
        self.id = number
        self.time_since_update = 0.0
        self.hits = 1
        self.confirmed = False

    def predict(self, dt, q):
        F = np.eye(4)
        F[0, 2] = F[1, 3] = dt
        Q = np.zeros((4, 4))
        for i in (0, 1):
            Q[i, i], Q[i, i + 2], Q[i + 2, i], Q[i + 2, i + 2] = dt**4 / 4, dt**3 / 2, dt**3 / 2, dt**2
        self.x = F @ self.x
        self.P = F @ self.P @ F.T + q**2 * Q
        self.time_since_update += dt

    def residual(self, det):
        return det["z"] - det["H"] @ self.x, det["H"] @ self.P @ det["H"].T + det["R"]

    def update(self, det):
        self.time_since_update = 0.0
        self.hits += 1
        self.fuse(det["z"], det["H"], det["R"])

    def fuse(self, z, H, R):
        S = H @ self.P @ H.T + R
        K = self.P @ H.T @ np.linalg.inv(S)
        self.x = self.x + K @ (z - H @ self.x)
        M = np.eye(4) - K @ H
        self.P = M @ self.P @ M.T + K @ R @ K.T


def associate(detections, trackers, confidence):
    """Matches, and the detections that no tracker matches."""
    if not trackers or not detections:
        return [], list(range(len(detections)))
    distance = np.zeros((len(trackers), len(detections)))
    allowed = np.zeros_like(distance, dtype=bool)
    limit = {m: chi2.ppf(confidence, m) for m in (2, 3)}
    for t, trk in enumerate(trackers):
        for d, det in enumerate(detections):
            y, S = trk.residual(det)
            d2 = y @ np.linalg.inv(S) @ y
            allowed[t, d] = d2 < limit[len(y)]
            distance[t, d] = d2 + np.linalg.slogdet(S)[1]
    cost = np.where(allowed, distance, 1e4)
    rows, cols = linear_sum_assignment(cost)
    matches = [(t, d) for t, d in zip(rows, cols, strict=True) if allowed[t, d]]
    matched = {d for _, d in matches}
    return matches, [d for d in range(len(detections)) if d not in matched]


class Tracker:
    identities = "hidden"

    def __init__(self, max_age=1.0, min_hits=3, probation=0.3, gate=0.999):
        self.max_age, self.min_hits, self.probation, self.gate = max_age, min_hits, probation, gate
        self.trackers = []
        self.now = None
        self.births = 0

    def step(self, state, scan):
        dt = 0.0 if self.now is None else scan.time - self.now
        self.now = scan.time
        for trk in self.trackers:
            trk.predict(dt, q=3.0)
        dets = self.read(scan)
        matches, unmatched = associate(dets, self.trackers, self.gate)
        for t, d in matches:
            self.trackers[t].update(dets[d])
            if self.trackers[t].hits >= self.min_hits:
                self.trackers[t].confirmed = True
        for d in unmatched:
            self.births += 1
            self.trackers.append(KalmanPointTracker(dets[d], self.births))
        i = len(self.trackers)
        for trk in reversed(self.trackers):
            i -= 1
            if trk.time_since_update > (self.max_age if trk.confirmed else self.probation):
                self.trackers.pop(i)
        return None, self.shown()

    def read(self, scan):
        px, py, yaw = scan.sensor_pose
        out = []
        for m in scan.measurement.T:
            if scan.kind == "radar":
                c, s = np.cos(yaw + m[1]), np.sin(yaw + m[1])
                J = np.array([[c, -m[0] * s, 0.0], [s, m[0] * c, 0.0], [0.0, 0.0, 1.0]])
                xy = np.array([px + m[0] * c, py + m[0] * s])
                z = np.array([*xy, m[2] + scan.sensor_velocity @ [c, s]])
                H = np.array([[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, c, s]])
            else:
                J = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
                xy = z = np.array([px, py]) + J @ m
                H = np.eye(2, 4)
            out.append({"xy": xy, "z": z, "H": H, "R": J @ scan.noise_covariance @ J.T})
        return out

    def shown(self):
        ret = [trk for trk in self.trackers if trk.confirmed]
        if not ret:
            return None
        ids = np.array([trk.id for trk in ret])
        return ids, np.array([trk.x for trk in ret]).T, np.moveaxis(np.array([trk.P for trk in ret]), 0, -1)
