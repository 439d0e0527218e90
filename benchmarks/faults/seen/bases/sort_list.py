"""In the style of SORT: a list of KalmanBoxTracker, Hungarian assignment, hit_streak and time_since_update."""

import numpy as np
from scipy.optimize import linear_sum_assignment


class KalmanFilter:
    def __init__(self, dim_x):
        self.x = np.zeros((dim_x, 1))
        self.P = np.eye(dim_x)
        self.F = np.eye(dim_x)
        self.Q = np.eye(dim_x)

    def predict(self):
        self.x = np.dot(self.F, self.x)
        self.P = np.dot(np.dot(self.F, self.P), self.F.T) + self.Q

    def update(self, z, H, R):
        y = z - np.dot(H, self.x)
        PHT = np.dot(self.P, H.T)
        S = np.dot(H, PHT) + R
        K = np.dot(PHT, np.linalg.inv(S))
        self.x = self.x + np.dot(K, y)
        I_KH = np.eye(len(self.x)) - np.dot(K, H)
        self.P = np.dot(np.dot(I_KH, self.P), I_KH.T) + np.dot(np.dot(K, R), K.T)


class KalmanBoxTracker:
    def __init__(self, z, R, id):
        self.kf = KalmanFilter(4)
        self.kf.x[:2, 0] = z
        self.kf.P[:2, :2] = R
        self.kf.P[2:, 2:] *= 600.0  # high uncertainty of the unobserved velocities
        self.id = id
        self.time_since_update = 0
        self.hits = 0
        self.hit_streak = 0
        self.age = 0

    def update(self, z, R):
        self.time_since_update = 0
        self.hits += 1
        self.hit_streak += 1
        self.kf.update(z.reshape(2, 1), np.eye(2, 4), R)

    def predict(self, dt):
        self.kf.F[0, 2] = self.kf.F[1, 3] = dt
        self.kf.Q[:2, :2] = np.eye(2) * 9.0 * dt**4 / 4
        self.kf.Q[:2, 2:] = self.kf.Q[2:, :2] = np.eye(2) * 9.0 * dt**3 / 2
        self.kf.Q[2:, 2:] = np.eye(2) * 9.0 * dt**2
        self.kf.predict()
        self.age += 1
        if self.time_since_update > 2:
            self.hit_streak = 0
        self.time_since_update += 1
        return self.kf.x[:2, 0]


def distance_batch(detections, covariances, trackers):
    """Squared Mahalanobis distances, (detections, trackers)."""
    cost = np.zeros((len(detections), len(trackers)))
    for d, (z, R) in enumerate(zip(detections, covariances, strict=True)):
        for t, trk in enumerate(trackers):
            y = z - trk.kf.x[:2, 0]
            S = trk.kf.P[:2, :2] + R
            cost[d, t] = y @ np.linalg.inv(S) @ y
    return cost


def associate_detections_to_trackers(detections, covariances, trackers, threshold):
    """Pairs, and the detections and trackers that are left."""
    if len(trackers) == 0:
        return np.empty((0, 2), dtype=int), list(range(len(detections))), []
    cost = distance_batch(detections, covariances, trackers)
    rows, columns = linear_sum_assignment(np.minimum(cost, threshold + 1e-5))
    matches, unmatched_detections = [], [d for d in range(len(detections)) if d not in rows]
    unmatched_trackers = [t for t in range(len(trackers)) if t not in columns]
    for d, t in zip(rows, columns, strict=True):
        if cost[d, t] > threshold:
            unmatched_detections.append(d)
            unmatched_trackers.append(t)
        else:
            matches.append((d, t))
    return matches, unmatched_detections, unmatched_trackers


class Sort:
    def __init__(self, max_age=20, min_hits=4, threshold=18.0):
        self.max_age = max_age
        self.min_hits = min_hits
        self.threshold = threshold
        self.trackers = []
        self.count = 0

    def update(self, detections, covariances, dt):
        for trk in self.trackers:
            trk.predict(dt)
        matched, unmatched_dets, _ = associate_detections_to_trackers(
            detections, covariances, self.trackers, self.threshold
        )
        for d, t in matched:
            self.trackers[t].update(detections[d], covariances[d])
        for d in unmatched_dets:
            self.trackers.append(KalmanBoxTracker(detections[d], covariances[d], self.count))
            self.count += 1
        ret = []
        i = len(self.trackers)
        for trk in reversed(self.trackers):
            i -= 1
            if trk.hits >= self.min_hits or trk.hit_streak >= self.min_hits:
                ret.append(trk)
            elif trk.time_since_update > 2:
                self.trackers.pop(i)
                continue
            if trk.time_since_update > self.max_age:
                self.trackers.pop(i)
        return ret


class Tracker:
    identities = "hidden"

    def __init__(self):
        self.mot = Sort()
        self.time = None

    def step(self, state, scan):
        dt = 0.0 if self.time is None else scan.time - self.time
        self.time = scan.time
        x, y, yaw = scan.sensor_pose
        dets, covs = [], []
        for m in scan.measurement.T:
            polar = scan.kind == "radar"
            r, angle = (m[0], yaw + m[1]) if polar else (1.0, yaw)
            J = np.array([[np.cos(angle), -r * np.sin(angle)], [np.sin(angle), r * np.cos(angle)]])
            dets.append(np.array([x, y]) + J @ ([r, 0.0] if polar else m))
            covs.append(J @ scan.noise_covariance[:2, :2] @ J.T)
        shown = self.mot.update(dets, covs, dt)
        if not shown:
            return None, None
        means = np.concatenate([trk.kf.x for trk in shown], axis=1)
        return None, (np.array([trk.id for trk in shown]), means, np.stack([trk.kf.P for trk in shown], axis=-1))
