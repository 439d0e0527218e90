"""In the style of Deep SORT: a stateless KalmanFilter, Track with a state, Tracker with min_cost_matching."""

import numpy as np
import scipy.linalg
from scipy.optimize import linear_sum_assignment

INFTY_COST = 1e5
chi2inv9999 = {2: 18.42, 3: 21.11}
TENTATIVE, CONFIRMED, DELETED = 1, 2, 3


class KalmanFilter:
    """mean and covariance come in and go out."""

    std_acceleration = 3.0

    def initiate(self, measurement, H, R):
        mean = np.r_[measurement[:2], 0.0, 0.0]
        covariance = np.diag([1e4, 1e4, 625.0, 625.0])
        return self.update(mean, covariance, measurement, H, R)

    def predict(self, mean, covariance, dt):
        motion_mat = np.eye(4)
        for i in range(2):
            motion_mat[i, 2 + i] = dt
        G = np.array([[dt**2 / 2, 0.0], [0.0, dt**2 / 2], [dt, 0.0], [0.0, dt]])
        motion_cov = self.std_acceleration**2 * G @ G.T
        mean = np.dot(motion_mat, mean)
        covariance = np.linalg.multi_dot((motion_mat, covariance, motion_mat.T)) + motion_cov
        return mean, covariance

    def project(self, mean, covariance, H, R):
        innovation_cov = R
        mean = np.dot(H, mean)
        covariance = np.linalg.multi_dot((H, covariance, H.T))
        return mean, covariance + innovation_cov

    def update(self, mean, covariance, measurement, H, R):
        projected_mean, projected_cov = self.project(mean, covariance, H, R)
        chol_factor, lower = scipy.linalg.cho_factor(projected_cov, lower=True, check_finite=False)
        kalman_gain = scipy.linalg.cho_solve((chol_factor, lower), np.dot(covariance, H.T).T, check_finite=False).T
        innovation = measurement - projected_mean
        new_mean = mean + np.dot(innovation, kalman_gain.T)
        new_covariance = covariance - np.linalg.multi_dot((kalman_gain, projected_cov, kalman_gain.T))
        return new_mean, (new_covariance + new_covariance.T) / 2

    def gating_distance(self, mean, covariance, measurement, H, R):
        mean, covariance = self.project(mean, covariance, H, R)
        cholesky_factor = np.linalg.cholesky(covariance)
        d = measurement - mean
        z = scipy.linalg.solve_triangular(cholesky_factor, d, lower=True)
        return np.sum(z * z)


class Track:
    def __init__(self, mean, covariance, track_id, n_init, max_age):
        self.mean = mean
        self.covariance = covariance
        self.track_id = track_id
        self.hits = 1
        self.age = 1
        self.time_since_update = 0
        self.state = TENTATIVE
        self._n_init = n_init
        self._max_age = max_age

    def predict(self, kf, dt):
        self.mean, self.covariance = kf.predict(self.mean, self.covariance, dt)
        self.age += 1
        self.time_since_update += 1

    def update(self, kf, detection):
        self.mean, self.covariance = kf.update(self.mean, self.covariance, *detection)
        self.hits += 1
        self.time_since_update = 0
        if self.state == TENTATIVE and self.hits >= self._n_init:
            self.state = CONFIRMED

    def mark_missed(self):
        if self.time_since_update > (2 if self.state == TENTATIVE else self._max_age):
            self.state = DELETED


class MultiTracker:
    def __init__(self, max_age=20, n_init=4):
        self.max_age = max_age
        self.n_init = n_init
        self.kf = KalmanFilter()
        self.tracks = []
        self._next_id = 1

    def predict(self, dt):
        for track in self.tracks:
            track.predict(self.kf, dt)

    def update(self, detections):
        matches, unmatched_tracks, unmatched_detections = self.min_cost_matching(detections)
        for track_idx, detection_idx in matches:
            self.tracks[track_idx].update(self.kf, detections[detection_idx])
        for track_idx in unmatched_tracks:
            self.tracks[track_idx].mark_missed()
        for detection_idx in unmatched_detections:
            self._initiate_track(detections[detection_idx])
        self.tracks = [t for t in self.tracks if t.state != DELETED]

    def gated_cost(self, detections):
        cost_matrix = np.zeros((len(self.tracks), len(detections)))
        for row, track in enumerate(self.tracks):
            for col, (measurement, H, R) in enumerate(detections):
                d = self.kf.gating_distance(track.mean, track.covariance, measurement, H, R)
                cost_matrix[row, col] = d if d <= chi2inv9999[len(measurement)] else INFTY_COST
        return cost_matrix

    def min_cost_matching(self, detections):
        cost_matrix = self.gated_cost(detections)
        indices = np.array(linear_sum_assignment(cost_matrix)).T
        matches = [(row, col) for row, col in indices if cost_matrix[row, col] < INFTY_COST]
        unmatched_tracks = [row for row in range(len(self.tracks)) if row not in {m[0] for m in matches}]
        unmatched_detections = [col for col in range(len(detections)) if col not in {m[1] for m in matches}]
        return matches, unmatched_tracks, unmatched_detections

    def _initiate_track(self, detection):
        mean, covariance = self.kf.initiate(*detection)
        self.tracks.append(Track(mean, covariance, self._next_id, self.n_init, self.max_age))
        self._next_id += 1


def to_detections(scan):
    """Position in the fixed frame, and of a radar the speed along the line of sight; with H and R."""
    x, y, yaw = scan.sensor_pose
    out = []
    for m in scan.measurement.T:
        if scan.kind == "lidar":
            T = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
            out.append((np.array([x, y]) + T @ m, np.eye(2, 4), T @ scan.noise_covariance @ T.T))
            continue
        c, s = np.cos(yaw + m[1]), np.sin(yaw + m[1])
        J = np.array([[c, -m[0] * s, 0.0], [s, m[0] * c, 0.0], [0.0, 0.0, 1.0]])
        H = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, c, s]])
        speed = m[2] + np.dot([c, s], scan.sensor_velocity)
        out.append((np.array([x + m[0] * c, y + m[0] * s, speed]), H, J @ scan.noise_covariance @ J.T))
    return out


class Tracker:
    identities = "hidden"

    def __init__(self):
        self.tracker = MultiTracker()
        self.time = None

    def step(self, state, scan):
        self.tracker.predict(0.0 if self.time is None else scan.time - self.time)
        self.time = scan.time
        self.tracker.update(to_detections(scan))
        shown = [t for t in self.tracker.tracks if t.state == CONFIRMED]
        if not shown:
            return None, None
        ids = np.array([t.track_id for t in shown])
        return None, (ids, np.stack([t.mean for t in shown], -1), np.stack([t.covariance for t in shown], -1))
