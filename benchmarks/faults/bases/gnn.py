"""Global nearest neighbours: one detection to a track by the least sum of distances, M of N to confirm."""

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.stats import chi2

NOT_ALLOWED = 1e5


class Track:
    def __init__(self, detection, time):
        z, R = detection.z, detection.R
        self.x = np.array([z[0], z[1], 0.0, 0.0])
        self.P = np.diag([0.0, 0.0, 900.0, 900.0])
        self.P[:2, :2] = R[:2, :2]
        if len(z) == 3:
            self.correct(detection, slice(2, 3))
        self.id = None
        self.hits, self.scans = 1, 1
        self.last_seen = time

    def predict(self, dt, sigma):
        F = np.eye(4)
        F[0, 2] = F[1, 3] = dt
        G = np.array([[dt**2 / 2, 0.0], [0.0, dt**2 / 2], [dt, 0.0], [0.0, dt]])
        self.x = F @ self.x
        self.P = F @ self.P @ F.T + sigma**2 * G @ G.T

    def innovation(self, detection):
        H = detection.H
        S = H @ self.P @ H.T + detection.R
        return detection.z - H @ self.x, S

    def correct(self, detection, rows=slice(None)):
        z, H, R = detection.z[rows], detection.H[rows], detection.R[rows, rows]
        S = H @ self.P @ H.T + R
        K = self.P @ H.T @ np.linalg.inv(S)
        self.x = self.x + K @ (z - H @ self.x)
        I_KH = np.eye(4) - K @ H
        self.P = I_KH @ self.P @ I_KH.T + K @ R @ K.T


class Detection:
    """Position in the fixed frame, and of a radar the speed along the line of sight."""

    def __init__(self, scan, column):
        m, R = scan.measurement[:, column], scan.noise_covariance
        x, y, yaw = scan.sensor_pose
        if scan.kind == "radar":
            c, s = np.cos(yaw + m[1]), np.sin(yaw + m[1])
            J = np.array([[c, -m[0] * s, 0.0], [s, m[0] * c, 0.0], [0.0, 0.0, 1.0]])
            speed = m[2] + c * scan.sensor_velocity[0] + s * scan.sensor_velocity[1]
            self.z = np.array([x + m[0] * c, y + m[0] * s, speed])
            self.H = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, c, s]])
        else:
            J = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
            self.z = np.array([x, y]) + J @ m
            self.H = np.eye(2, 4)
        self.R = J @ R @ J.T


class Tracker:
    identities = "hidden"

    def __init__(self, acceleration_sigma=3.0, gate=0.9999, confirm_hits=3, confirm_scans=5, max_age=1.0):
        self.sigma = acceleration_sigma
        self.gates = {m: chi2.ppf(gate, m) for m in (2, 3)}  # by the degrees of freedom
        self.confirm_hits, self.confirm_scans, self.max_age = confirm_hits, confirm_scans, max_age
        self.tracks = []
        self.next_id = 0
        self.time = None

    def step(self, state, scan):
        dt = 0.0 if self.time is None else scan.time - self.time
        self.time = scan.time
        for track in self.tracks:
            track.predict(dt, self.sigma)
        detections = [Detection(scan, column) for column in range(scan.measurement.shape[1])]
        pairs = self.assign(detections)
        for track in self.tracks:
            track.scans += self.visible(track, scan)
        for i, j in pairs:
            track = self.tracks[i]
            track.correct(detections[j])
            track.hits += 1
            track.last_seen = scan.time
            if track.id is None and track.hits >= self.confirm_hits:
                track.id = self.next_id
                self.next_id += 1
        for i in reversed(range(len(self.tracks))):
            if self.lost(self.tracks[i]):
                self.tracks.pop(i)
        taken = {j for _, j in pairs}
        self.tracks += [Track(d, scan.time) for j, d in enumerate(detections) if j not in taken]
        return None, self.output()

    def assign(self, detections):
        """Pairs of a track and a detection within its gate."""
        cost = np.full((len(self.tracks), len(detections)), NOT_ALLOWED)
        for i, track in enumerate(self.tracks):
            for j, detection in enumerate(detections):
                y, S = track.innovation(detection)
                d2 = y @ np.linalg.solve(S, y)
                if d2 <= self.gates[len(y)]:
                    cost[i, j] = d2 + np.log(np.linalg.det(S))
        rows, columns = linear_sum_assignment(cost)
        return [(i, j) for i, j in zip(rows, columns, strict=True) if cost[i, j] < NOT_ALLOWED]

    def visible(self, track, scan):
        d = track.x[:2] - scan.sensor_pose[:2]
        angle = (np.arctan2(d[1], d[0]) - scan.sensor_pose[2] + np.pi) % (2 * np.pi) - np.pi
        return np.hypot(*d) <= scan.field_of_view.max_range and abs(angle) <= scan.field_of_view.half_angle

    def lost(self, track):
        if track.id is None:
            return track.scans - track.hits > self.confirm_scans - self.confirm_hits
        return self.time - track.last_seen > self.max_age

    def output(self):
        shown = [track for track in self.tracks if track.id is not None]
        if not shown:
            return None
        return (
            np.array([track.id for track in shown]),
            np.stack([track.x for track in shown], axis=-1),
            np.stack([track.P for track in shown], axis=-1),
        )
