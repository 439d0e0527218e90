"""In the style of SORT: a list of Kalman trackers of single objects, Hungarian assignment, counters of losses."""

from copy import deepcopy

import numpy as np
from scipy.optimize import linear_sum_assignment


class KalmanTrack:
    def __init__(self, number, position, noise):
        self.id = number
        self.x = np.array([[position[0]], [position[1]], [0.0], [0.0]])
        self.P = np.diag([1.0, 1.0, 400.0, 400.0])
        self.P[:2, :2] = noise
        self.H = np.array([[1.0, 0, 0, 0], [0, 1.0, 0, 0]])
        self.hits, self.no_losses = 1, 0
        self.detection = -1

    def predict(self, dt):
        F = np.array([[1, 0, dt, 0], [0, 1, 0, dt], [0, 0, 1, 0], [0, 0, 0, 1.0]])
        one = np.array([[dt**4 / 4, dt**3 / 2], [dt**3 / 2, dt**2]])
        self.x = F @ self.x
        self.P = F @ self.P @ F.T + 9.0 * np.kron(one, np.eye(2))

    def update(self, position, noise):
        y = np.reshape(position, (2, 1)) - self.H @ self.x
        S = self.H @ self.P @ self.H.T + noise
        K = self.P @ self.H.T @ np.linalg.inv(S)
        self.x = self.x + K @ y
        A = np.eye(4) - K @ self.H
        self.P = A @ self.P @ A.T + K @ noise @ K.T

    def distance(self, position, noise):
        y = np.reshape(position, (2, 1)) - self.H @ self.x
        return (y.T @ np.linalg.inv(self.H @ self.P @ self.H.T + noise) @ y).item()


class Sort:
    def __init__(self, max_losses=8, min_hits=5, gate=16.0):
        self.max_losses, self.min_hits, self.gate = max_losses, min_hits, gate
        self.trackers, self.count, self.time = [], 0, None

    def update(self, positions, noises, time, looked):
        """`looked` says of a position whether the sensor could see it."""
        dt = 0.0 if self.time is None else time - self.time
        self.time = time
        for trk in self.trackers:
            trk.predict(dt)
            trk.detection = -1
        matches, unmatched_dets, unmatched_trks = self.assign(positions, noises)
        for t, d in matches:
            trk = self.trackers[t]
            trk.update(positions[d], noises[d])
            trk.hits += 1
            trk.no_losses = 0
            trk.detection = d
        for t in unmatched_trks:
            trk = self.trackers[t]
            trk.no_losses += looked(trk.x[:2, 0])
        self.trackers = [t for t in self.trackers if t.no_losses <= (self.max_losses if t.hits >= self.min_hits else 1)]
        for d in unmatched_dets:
            trk = KalmanTrack(self.count, positions[d], noises[d])
            trk.detection = d
            self.trackers.append(trk)
            self.count += 1
        return [trk for trk in self.trackers if trk.hits >= self.min_hits]

    def assign(self, positions, noises):
        cost = np.array([[t.distance(p, n) for p, n in zip(positions, noises, strict=True)] for t in self.trackers])
        cost = cost.reshape(len(self.trackers), len(positions))
        rows, columns = linear_sum_assignment(np.minimum(cost, self.gate))
        matches = [(t, d) for t, d in zip(rows, columns, strict=True) if cost[t, d] < self.gate]
        taken_t, taken_d = {t for t, _ in matches}, {d for _, d in matches}
        unmatched_trks = [t for t in range(len(self.trackers)) if t not in taken_t]
        return matches, [d for d in range(len(positions)) if d not in taken_d], unmatched_trks


class Tracker:
    identities = "hidden"

    def step(self, state, scan):
        sort = deepcopy(state) if state is not None else Sort()
        positions, noises = self.detections(scan)
        tracks = sort.update(positions, noises, scan.time, lambda position: self.in_view(position, scan))
        if not tracks:
            return sort, None
        ids, used = np.array([t.id for t in tracks]), np.array([t.detection for t in tracks])
        mean, P = np.hstack([t.x for t in tracks]), np.stack([t.P for t in tracks], axis=-1)
        return sort, (ids, mean, P, None, used)

    def in_view(self, position, scan):
        dx, dy = position - scan.sensor_pose[:2]
        off = (np.arctan2(dy, dx) - scan.sensor_pose[2] + np.pi) % (2 * np.pi) - np.pi
        return bool(np.hypot(dx, dy) < scan.field_of_view.max_range and abs(off) < scan.field_of_view.half_angle)

    def detections(self, scan):
        positions, noises, yaw = [], [], scan.sensor_pose[2]
        for d in scan.measurement.T:
            r, angle = (d[0], yaw + d[1]) if scan.kind == "radar" else (1.0, yaw)
            J = np.array([[np.cos(angle), -r * np.sin(angle)], [np.sin(angle), r * np.cos(angle)]])
            local = np.array([r, 0.0]) if scan.kind == "radar" else d
            positions.append(scan.sensor_pose[:2] + J @ local)
            noises.append(J @ scan.noise_covariance[:2, :2] @ J.T)
        return positions, noises
