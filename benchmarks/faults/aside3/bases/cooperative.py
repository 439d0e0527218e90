"""After C++ for cooperative perception: tracks by key, maps of scores and of associations, a manager of statuses."""

from enum import Enum

import numpy as np
from scipy.optimize import linear_sum_assignment

GATE = {"radar": 17.7, "lidar": 15.2}
NEVER = 1e6


class Status(Enum):
    TENTATIVE = 0
    CONFIRMED = 1


def rotation(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def rotated(covariance, angle):
    turn = rotation(angle)
    return turn @ covariance @ turn.T


def make_detections(scan):
    """By key: position and rate, observation matrix, covariance."""
    x, y, yaw = scan.sensor_pose
    R, made = scan.noise_covariance, {}
    for key, m in enumerate(scan.measurement.T):
        if scan.kind == "radar":
            angle = yaw + m[1]
            ray = rotation(angle)[:, 0]
            spread = np.array([[R[0, 0], m[0] * R[0, 1]], [m[0] * R[1, 0], m[0] ** 2 * R[1, 1]]])
            covariance = np.zeros((3, 3))
            covariance[:2, :2] = rotated(spread, angle)
            covariance[2, 2] = R[2, 2] + 0.15**2
            H = np.zeros((3, 4))
            H[0, 0] = H[1, 1] = 1.0
            H[2, 2:] = ray
            value = np.array([x + m[0] * ray[0], y + m[0] * ray[1], m[2] + ray @ scan.sensor_velocity])
        else:
            value = np.array([x, y]) + rotation(yaw) @ m
            H, covariance = np.eye(2, 4), rotated(R, yaw)
        made[key] = value, H, covariance
    return made


class Track:
    def __init__(self, detection, time):
        value, _, covariance = detection
        self.state = np.array([value[0], value[1], 0.0, 0.0])
        self.covariance = np.diag([0.0, 0.0, 420.0, 420.0])
        self.covariance[:2, :2] = covariance[:2, :2]
        self.status = Status.TENTATIVE
        self.hits, self.misses = 1, 0
        self.seen = time
        self.last_observation = self.state

    def propagate(self, dt):
        F = np.kron(np.array([[1.0, dt], [0.0, 1.0]]), np.eye(2))
        Q = 2.8 * np.kron(np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]), np.eye(2))
        self.state = F @ self.state
        self.covariance = F @ self.covariance @ F.T + Q

    def score(self, detection):
        value, H, R = detection
        nu, S = value - H @ self.state, H @ self.covariance @ H.T + R
        return nu @ np.linalg.solve(S, nu), np.linalg.slogdet(S)[1]

    def fuse(self, detection, time):
        value, H, R = detection
        S = H @ self.covariance @ H.T + R
        K = self.covariance @ H.T @ np.linalg.inv(S)
        A = np.eye(4) - K @ H
        self.state = self.state + K @ (value - H @ self.state)
        self.covariance = A @ self.covariance @ A.T + K @ R @ K.T
        self.hits += 1
        self.misses = 0
        self.seen = time
        self.last_observation = self.state

    def report(self):
        return self.state, self.covariance


def score_tracks_and_detections(tracks, detections, gate):
    scores = {}
    for t, track in tracks.items():
        for d, detection in detections.items():
            distance, volume = track.score(detection)
            if distance < gate:
                scores[t, d] = distance + volume
    return scores


def associate(scores):
    """The key of a track to that of its detection."""
    rows = sorted({t for t, _ in scores})
    columns = sorted({d for _, d in scores})
    if not scores:
        return {}
    cost = np.array([[scores.get((t, d), NEVER) for d in columns] for t in rows])
    pairs = zip(*linear_sum_assignment(cost), strict=True)
    return {rows[i]: columns[j] for i, j in pairs if cost[i, j] < NEVER}


class TrackManager:
    PROMOTION, TENTATIVE_MISSES = 3, 2
    PATIENCE = 0.8  # s

    def __init__(self):
        self.tracks = {}
        self.numbers = 0

    def add(self, detection, time):
        self.tracks[self.numbers] = Track(detection, time)
        self.numbers += 1

    def update_statuses(self, associations, scan):
        for key, track in list(self.tracks.items()):
            if key in associations:
                if track.hits >= self.PROMOTION:
                    track.status = Status.CONFIRMED
                continue
            if np.hypot(*(track.state[:2] - scan.sensor_pose[:2])) < scan.field_of_view.max_range:
                track.misses += 1
            patience = self.PATIENCE if track.status is Status.CONFIRMED else self.PATIENCE / 2
            tired = track.status is Status.TENTATIVE and track.misses > self.TENTATIVE_MISSES
            if tired or scan.time - track.seen > patience:
                del self.tracks[key]

    def confirmed(self):
        return {key: track for key, track in self.tracks.items() if track.status is Status.CONFIRMED}


class Tracker:
    identities = "hidden"

    def __init__(self):
        self.manager = TrackManager()
        self.time = None

    def step(self, state, scan):
        dt = 0.0 if self.time is None else scan.time - self.time
        self.time = scan.time
        detections = make_detections(scan)
        for track in self.manager.tracks.values():
            track.propagate(dt)
        scores = score_tracks_and_detections(self.manager.tracks, detections, GATE[scan.kind])
        associations = associate(scores)
        for t, d in associations.items():
            self.manager.tracks[t].fuse(detections[d], scan.time)
        self.manager.update_statuses(associations, scan)
        for d in sorted(set(detections) - set(associations.values())):
            self.manager.add(detections[d], scan.time)
        shown = self.manager.confirmed()
        if not shown:
            return None, None
        reports = [track.report() for track in shown.values()]
        return None, (
            np.array(list(shown)),
            np.stack([x for x, _ in reports], -1),
            np.stack([P for _, P in reports], -1),
        )
