"""As in a course on sensor fusion: parameters, Kalman filter, tracks with a score, association by the nearest pair."""

import numpy as np
from scipy.stats import chi2


class params:
    q = 3.0  # (m/s^2)^2 s
    sigma_p44 = 22.0  # m/s
    window = 6
    confirmed_threshold = 0.5
    delete_threshold = 0.2
    max_P = 10**2
    unseen = 1.0  # s
    gating_threshold = 0.9995


class Sensor:
    def __init__(self, scan):
        self.name = scan.kind
        self.pos, self.yaw, self.vel = scan.sensor_pose[:2], scan.sensor_pose[2], scan.sensor_velocity
        self.R = scan.noise_covariance
        self.dim_meas = len(self.R)
        self.range = scan.field_of_view.max_range
        self.sens_to_veh = np.array([[np.cos(self.yaw), -np.sin(self.yaw)], [np.sin(self.yaw), np.cos(self.yaw)]])

    def in_fov(self, x):
        return np.linalg.norm(x[:2] - self.pos) < self.range

    def get_hx(self, x):
        d = x[:2] - self.pos
        if self.name == "lidar":
            return self.sens_to_veh.T @ d
        r = max(np.linalg.norm(d), 0.5)
        return np.array([r, np.arctan2(d[1], d[0]) - self.yaw, d @ (x[2:] - self.vel) / r])

    def get_H(self, x):
        H = np.zeros((self.dim_meas, 4))
        if self.name == "lidar":
            H[:, :2] = self.sens_to_veh.T
            return H
        d, u = x[:2] - self.pos, x[2:] - self.vel
        r = max(np.linalg.norm(d), 0.5)
        H[0, :2] = d / r
        H[1, :2] = [-d[1] / r**2, d[0] / r**2]
        H[2, :2] = u / r - d * (d @ u) / r**3
        H[2, 2:] = d / r
        return H

    def generate(self, z):
        """Place and covariance of a measurement."""
        if self.name == "lidar":
            return self.pos + self.sens_to_veh @ z, self.sens_to_veh @ self.R @ self.sens_to_veh.T
        c, s = np.cos(self.yaw + z[1]), np.sin(self.yaw + z[1])
        J = np.array([[c, -z[0] * s], [s, z[0] * c]])
        return self.pos + z[0] * np.array([c, s]), J @ self.R[:2, :2] @ J.T


class Filter:
    def F(self, dt):
        return np.array([[1, 0, dt, 0], [0, 1, 0, dt], [0, 0, 1, 0], [0, 0, 0, 1]], dtype=float)

    def Q(self, dt):
        q1, q2, q3 = params.q * dt**3 / 3, params.q * dt**2 / 2, params.q * dt
        return np.array([[q1, 0, q2, 0], [0, q1, 0, q2], [q2, 0, q3, 0], [0, q2, 0, q3]])

    def predict(self, track, dt):
        F = self.F(dt)
        track.x = F @ track.x
        track.P = F @ track.P @ F.T + self.Q(dt)

    def gamma(self, track, z, sensor):
        g = z - sensor.get_hx(track.x)
        if sensor.name == "radar":
            g[1] = np.arctan2(np.sin(g[1]), np.cos(g[1]))
        return g

    def S(self, track, H, sensor):
        return H @ track.P @ H.T + sensor.R

    def update(self, track, z, sensor):
        H = sensor.get_H(track.x)
        K = track.P @ H.T @ np.linalg.inv(self.S(track, H, sensor))
        track.x = track.x + K @ self.gamma(track, z, sensor)
        I_KH = np.eye(4) - K @ H
        track.P = I_KH @ track.P @ I_KH.T + K @ sensor.R @ K.T


class Track:
    def __init__(self, z, sensor):
        pos, cov = sensor.generate(z)
        self.x = np.concatenate([pos, np.zeros(2)])
        self.P = np.diag([0.0, 0.0, params.sigma_p44**2, params.sigma_p44**2])
        self.P[:2, :2] = cov
        self.id = None
        self.state = "initialized"
        self.score = 1 / params.window
        self.unseen = 0.0


class Trackmanagement:
    def __init__(self):
        self.track_list = []
        self.last_id = -1

    def manage_tracks(self, unassigned_tracks, unassigned_meas, meas_list, sensor):
        for i in unassigned_tracks:
            track = self.track_list[i]
            if sensor.in_fov(track.x):
                track.score -= 1 / params.window
        self.track_list = [track for track in self.track_list if not self.is_lost(track)]
        for j in unassigned_meas:
            self.track_list.append(Track(meas_list[j], sensor))

    def is_lost(self, track):
        if max(track.P[0, 0], track.P[1, 1]) > params.max_P or track.unseen > 4 * params.unseen:
            return True
        if track.state == "confirmed":
            return track.score < params.delete_threshold
        return track.score < 1e-6 or track.unseen > params.unseen

    def handle_updated_track(self, track):
        track.score = min(track.score + 1 / params.window, 1.0)
        track.unseen = 0.0
        if track.state != "confirmed" and track.score > params.confirmed_threshold - 1e-6:
            track.state = "confirmed"
            self.last_id += 1
            track.id = self.last_id
        elif track.state == "initialized":
            track.state = "tentative"


class Association:
    def associate(self, track_list, meas_list, sensor, KF):
        matrix = np.inf * np.ones((len(track_list), len(meas_list)))
        for i, track in enumerate(track_list):
            H = sensor.get_H(track.x)
            S = KF.S(track, H, sensor)
            for j, z in enumerate(meas_list):
                g = KF.gamma(track, z, sensor)
                MHD = g @ np.linalg.inv(S) @ g
                if self.gating(MHD, sensor):
                    matrix[i, j] = MHD + np.log(np.linalg.det(S))
        return matrix

    def gating(self, MHD, sensor):
        limit = chi2.ppf(params.gating_threshold, df=sensor.dim_meas)
        return limit > MHD

    def pairs(self, matrix):
        """The nearest pair first, whose row and column are then left out."""
        matrix, found = matrix.copy(), []
        while matrix.size and np.min(matrix) < np.inf:
            i, j = np.unravel_index(np.argmin(matrix), matrix.shape)
            found.append((i, j))
            matrix[i, :] = np.inf
            matrix[:, j] = np.inf
        return found


class Tracker:
    identities = "hidden"

    def __init__(self):
        self.KF = Filter()
        self.manager = Trackmanagement()
        self.association = Association()
        self.t = None

    def step(self, state, scan):
        dt = 0.0 if self.t is None else scan.time - self.t
        self.t = scan.time
        sensor, meas_list = Sensor(scan), list(scan.measurement.T)
        tracks = self.manager.track_list
        for track in tracks:
            self.KF.predict(track, dt)
            track.unseen += dt
        pairs = self.association.pairs(self.association.associate(tracks, meas_list, sensor, self.KF))
        for i, j in pairs:
            self.KF.update(tracks[i], meas_list[j], sensor)
            self.manager.handle_updated_track(tracks[i])
        unassigned_tracks = sorted(set(range(len(tracks))) - {i for i, _ in pairs})
        unassigned_meas = sorted(set(range(len(meas_list))) - {j for _, j in pairs})
        self.manager.manage_tracks(unassigned_tracks, unassigned_meas, meas_list, sensor)
        shown = [track for track in self.manager.track_list if track.state == "confirmed"]
        if not shown:
            return None, None
        ids = np.array([track.id for track in shown])
        return None, (ids, np.stack([track.x for track in shown], -1), np.stack([track.P for track in shown], -1))
