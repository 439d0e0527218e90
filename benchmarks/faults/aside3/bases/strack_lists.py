"""Tracks as in trackers of boxes in images: predicted all together, kept in lists of tracked and of lost ones."""

import numpy as np
from scipy.optimize import linear_sum_assignment

GATES = {2: 14.5, 3: 17.0}


class TrackState:
    New, Tracked, Lost, Removed = range(4)


class KalmanFilter:
    _acceleration = 2.5

    def initiate(self, det):
        mean = np.zeros(4)
        mean[:2] = det.z[:2]
        covariance = np.diag([0.0, 0.0, 480.0, 480.0])
        covariance[:2, :2] = det.R[:2, :2]
        return mean, covariance

    def multi_predict(self, mean, covariance, dt):
        """All tracks at once: (N, 4) and (N, 4, 4)."""
        motion = np.eye(4) + dt * np.eye(4, k=2)
        block = np.array([[dt**4 / 4, dt**3 / 2], [dt**3 / 2, dt**2]]) + 0.02 * np.array([[0.0, 0.0], [0.0, dt]])
        noise = self._acceleration**2 * np.kron(block, np.eye(2))
        return mean @ motion.T, motion @ covariance @ motion.T + noise

    def project(self, covariance, det):
        return det.H @ covariance @ det.H.T + det.R

    def update(self, mean, covariance, det):
        S = self.project(covariance, det)
        gain = np.linalg.solve(S, det.H @ covariance).T
        covariance = covariance - gain @ S @ gain.T
        return mean + gain @ (det.z - det.H @ mean), (covariance + covariance.T) / 2


class Detection:
    """In the plane; with the rate along the ray for a radar."""

    def __init__(self, m, scan):
        x, y, yaw = scan.sensor_pose
        if scan.kind == "radar":
            r, a = m[0], yaw + m[1]
            c, s = np.cos(a), np.sin(a)
            J = np.array([[c, -r * s, 0], [s, r * c, 0], [0, 0, 1]])
            self.z = np.array([x + r * c, y + r * s, m[2] + np.array([c, s]) @ scan.sensor_velocity])
            self.H = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, c, s]])
            self.R = J @ scan.noise_covariance @ J.T + np.diag([0.0, 0.0, 0.15**2])
        else:
            J = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
            self.z, self.H, self.R = np.array([x, y]) + J @ m, np.eye(2, 4), J @ scan.noise_covariance @ J.T
        self.gate = GATES[len(self.z)]


class STrack:
    shared_kalman = KalmanFilter()

    def __init__(self, det, time):
        self.mean, self.covariance = self.shared_kalman.initiate(det)
        self.track_id = 0
        self.is_activated = False
        self.state = TrackState.New
        self.tracklet_len = 1
        self.frame_time = time
        self.static_box()

    def static_box(self):
        """What the association compares with detections."""
        self.box = self.mean.copy()

    @staticmethod
    def multi_predict(stracks, dt):
        if not stracks:
            return
        multi_mean = np.asarray([st.mean for st in stracks])
        multi_covariance = np.asarray([st.covariance for st in stracks])
        multi_mean, multi_covariance = STrack.shared_kalman.multi_predict(multi_mean, multi_covariance, dt)
        for st, mean, covariance in zip(stracks, multi_mean, multi_covariance, strict=True):
            st.mean, st.covariance = mean, covariance
            st.static_box()

    def update(self, det, time):
        self.mean, self.covariance = self.shared_kalman.update(self.mean, self.covariance, det)
        self.static_box()
        self.frame_time = time
        self.tracklet_len += 1
        if self.is_activated:
            self.state = TrackState.Tracked


def distances(stracks, dets):
    cost = np.full((len(stracks), len(dets)), np.inf)
    for i, st in enumerate(stracks):
        for j, det in enumerate(dets):
            S = STrack.shared_kalman.project(st.covariance, det)
            nu = det.z - det.H @ st.box
            d2 = nu @ np.linalg.solve(S, nu)
            if d2 < det.gate:
                cost[i, j] = d2 + np.linalg.slogdet(S)[1]
    return cost


def linear_assignment(cost):
    """Pairs, rows that are left, columns that are left."""
    if cost.size == 0:
        return [], list(range(cost.shape[0])), list(range(cost.shape[1]))
    rows, columns = linear_sum_assignment(np.where(np.isfinite(cost), cost, 1e5))
    matches = [(i, j) for i, j in zip(rows, columns, strict=True) if np.isfinite(cost[i, j])]
    u_a = [i for i in range(cost.shape[0]) if i not in {a for a, _ in matches}]
    u_b = [j for j in range(cost.shape[1]) if j not in {b for _, b in matches}]
    return matches, u_a, u_b


class Tracker:
    identities = "hidden"
    min_hits = 3
    max_time_lost, max_time_new = 0.9, 0.25  # s

    def __init__(self):
        self.tracked_stracks = []
        self.lost_stracks = []
        self._count = 0
        self.time = None

    def step(self, state, scan):
        dt = 0.0 if self.time is None else scan.time - self.time
        self.time = scan.time
        dets = [Detection(m, scan) for m in scan.measurement.T]
        unconfirmed = [st for st in self.tracked_stracks if not st.is_activated]
        tracked = [st for st in self.tracked_stracks if st.is_activated]
        pool = tracked + self.lost_stracks
        STrack.multi_predict(pool + unconfirmed, dt)

        matches, u_track, u_det = linear_assignment(distances(pool, dets))
        for i, j in matches:
            pool[i].update(dets[j], scan.time)
        for i in u_track:
            self.mark_missed(pool[i])

        dets = [dets[j] for j in u_det]
        matches, u_unconfirmed, u_det = linear_assignment(distances(unconfirmed, dets))
        for i, j in matches:
            st = unconfirmed[i]
            st.update(dets[j], scan.time)
            if st.tracklet_len >= self.min_hits:
                self.activate(st)
        for i in u_unconfirmed:
            if scan.time - unconfirmed[i].frame_time > self.max_time_new:
                unconfirmed[i].state = TrackState.Removed

        new = [STrack(dets[j], scan.time) for j in u_det]
        everything = [st for st in pool + unconfirmed + new if st.state != TrackState.Removed]
        self.tracked_stracks = [st for st in everything if st.state != TrackState.Lost]
        self.lost_stracks = [st for st in everything if st.state == TrackState.Lost]
        return None, self.output()

    def activate(self, st):
        self._count += 1
        st.track_id = self._count
        st.is_activated = True
        st.state = TrackState.Tracked

    def mark_missed(self, st):
        st.state = TrackState.Removed if self.time - st.frame_time > self.max_time_lost else TrackState.Lost

    def output(self):
        shown = [st for st in self.tracked_stracks + self.lost_stracks if st.is_activated]
        if not shown:
            return None
        covariances = np.moveaxis(np.array([st.covariance for st in shown]), 0, 2)
        return np.array([st.track_id for st in shown]), np.array([st.mean for st in shown]).T, covariances
