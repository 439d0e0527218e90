"""After SORT: KalmanTracker per object, associate_detections_to_trackers, max_age and min_hits."""

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.stats import chi2

INFTY_COST = 1e5
chi2inv = {2: chi2.ppf(0.999, 2), 3: chi2.ppf(0.999, 3)}


def linear_assignment(cost_matrix, thresh):
    """Pairs of a row and a column."""
    x, y = linear_sum_assignment(cost_matrix)
    return [(i, j) for i, j in zip(x, y, strict=True) if cost_matrix[i, j] <= thresh]


def to_fixed_frame(scan):
    """Of each detection z, H and R in the fixed frame."""
    ex, ey, yaw = scan.sensor_pose
    found = []
    for m in scan.measurement.T:
        if scan.kind == "radar":
            c, s = np.cos(m[1] + yaw), np.sin(m[1] + yaw)
            v = m[2] + scan.sensor_velocity @ [c, s]
            z = np.array([ex + m[0] * c, ey + m[0] * s, v])
            H = np.array([[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, c, s]])
            T = np.array([[c, -m[0] * s, 0], [s, m[0] * c, 0], [0, 0, 1.0]])
        else:
            T = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
            z, H = scan.sensor_pose[:2] + T @ m, np.eye(2, 4)
        found.append((z, H, T @ scan.noise_covariance @ T.T))
    return found


class KalmanTracker:
    def __init__(self, det):
        z, _, R = det
        self.x = np.array([z[0], z[1], 0.0, 0.0])
        self.P = np.diag([1.0, 1.0, 600.0, 600.0])
        self.P[:2, :2] = R[:2, :2]
        self.id = -1
        self.hits = 1
        self.misses = 0
        self.age = 0.0
        self.time_since_update = 0.0

    def predict(self, dt, q):
        self.x = self.x + dt * np.array([self.x[2], self.x[3], 0.0, 0.0])
        F = np.eye(4) + dt * np.eye(4, k=2)
        one = np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        self.P = F @ self.P @ F.T + q * np.kron(one, np.eye(2))
        self.age += dt
        self.time_since_update += dt

    def gating_distance(self, det):
        z, H, R = det
        S = H @ self.P @ H.T + R
        d = z - H @ self.x
        L = np.linalg.cholesky(S)
        u = np.linalg.solve(L, d)
        return u @ u, 2.0 * np.log(np.diag(L)).sum()

    def update(self, det):
        z, H, R = det
        self.time_since_update = 0.0
        self.hits += 1
        self.misses = 0
        S = H @ self.P @ H.T + R
        K = np.linalg.solve(S, H @ self.P).T
        self.x = self.x + K @ (z - H @ self.x)
        self.P = self.P - K @ S @ K.T
        self.P = (self.P + self.P.T) / 2


def associate_detections_to_trackers(dets, trks):
    """Matches, unmatched detections, unmatched trackers."""
    cost = np.full((len(trks), len(dets)), INFTY_COST)
    for i, trk in enumerate(trks):
        for j, det in enumerate(dets):
            maha, logdet = trk.gating_distance(det)
            if maha <= chi2inv[len(det[0])]:
                cost[i, j] = maha + logdet
    matches = linear_assignment(cost, INFTY_COST / 2)
    taken_trks = {i for i, _ in matches}
    taken_dets = {j for _, j in matches}
    unmatched_dets = [j for j in range(len(dets)) if j not in taken_dets]
    unmatched_trks = [i for i in range(len(trks)) if i not in taken_trks]
    return matches, unmatched_dets, unmatched_trks


class Tracker:
    identities = "hidden"

    def __init__(self, max_age=0.8, min_hits=3, q=1.5):
        self.max_age, self.min_hits, self.q = max_age, min_hits, q
        self.trackers = []
        self.count = 0
        self.stamp = None

    def step(self, state, scan):
        dt = 0.0 if self.stamp is None else scan.time - self.stamp
        self.stamp = scan.time
        for trk in self.trackers:
            trk.predict(dt, self.q)
        dets = to_fixed_frame(scan)
        matches, unmatched_dets, unmatched_trks = associate_detections_to_trackers(dets, self.trackers)
        for i, j in matches:
            trk = self.trackers[i]
            trk.update(dets[j])
            if trk.id < 0 and trk.hits >= self.min_hits:
                trk.id = self.count
                self.count += 1
        for i in unmatched_trks:
            trk = self.trackers[i]
            if np.hypot(*(trk.x[:2] - scan.sensor_pose[:2])) < scan.field_of_view.max_range:
                trk.misses += 1
        i = len(self.trackers)
        for trk in reversed(self.trackers.copy()):
            i -= 1
            dead = trk.misses > 1 if trk.id < 0 else trk.time_since_update > self.max_age
            if dead or trk.time_since_update > self.max_age:
                self.trackers.pop(i)
        for j in unmatched_dets:
            self.trackers.append(KalmanTracker(dets[j]))
        return None, self.results()

    def results(self):
        ret = [trk for trk in self.trackers if trk.id >= 0]
        if not ret:
            return None
        ids = np.array([trk.id for trk in ret])
        return ids, np.column_stack([trk.x for trk in ret]), np.stack([trk.P for trk in ret], axis=2)
