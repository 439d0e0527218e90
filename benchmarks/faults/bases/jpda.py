"""Joint probabilistic data association: a track is corrected by all detections in its gate, by their probability."""

from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

GATE = 0.999
LIMITS = {m: chi2.ppf(GATE, m) for m in (2, 3)}  # by the degrees of freedom


class Track(NamedTuple):
    x: np.ndarray  # px, py, vx, vy
    P: np.ndarray
    seen: float  # s, of the last scan in which it was probably detected
    hits: int = 1
    scans: int = 1
    id: int = -1


class Tracker:
    identities = "hidden"

    def __init__(self, acceleration_sigma=3.0, confirm=(3, 5), delete_after=1.0):
        self.sigma, self.confirm, self.delete_after = acceleration_sigma, confirm, delete_after

    def step(self, state, scan):
        time, count, tracks = (scan.time, 0, []) if state is None else state
        tracks = [self.predicted(track, scan.time - time) for track in tracks]
        found = points(scan)
        likelihood = self.likelihoods(tracks, found, scan)
        beta = association(likelihood, 1 - scan.detection_probability * GATE)
        after = []
        for track, weights in zip(tracks, beta, strict=True):
            track = self.updated(track, found, weights, scan)
            if track.id < 0 and track.hits >= self.confirm[0]:
                track = track._replace(id=count)
                count += 1
            if self.stays(track, scan.time):
                after.append(track)
        free = 1 - beta[:, 1:].sum(axis=0)
        after += [new_track(found, j, scan.time) for j in range(len(free)) if free[j] > 0.9]
        return (scan.time, count, after), output(after)

    def predicted(self, track, dt):
        F = np.eye(4) + dt * np.eye(4, k=2)
        G = self.sigma * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
        return track._replace(x=F @ track.x, P=F @ track.P @ F.T + G @ G.T)

    def likelihoods(self, tracks, found, scan):
        """Of each detection from each track over that of clutter; 0 outside of the gate."""
        z, H, R, density = found
        ratio = np.zeros((len(tracks), len(z)))
        for i, track in enumerate(tracks):
            for j in range(len(z)):
                y = z[j] - H[j] @ track.x
                S = H[j] @ track.P @ H[j].T + R[j]
                d2 = y @ np.linalg.solve(S, y)
                if d2 < LIMITS[len(y)]:
                    pdf = np.exp(-d2 / 2) / np.sqrt(np.linalg.det(2 * np.pi * S))
                    ratio[i, j] = scan.detection_probability * pdf / density[j]
        return ratio

    def updated(self, track, found, weights, scan):
        """Each gain with its own S, and the spread of the means (Bar-Shalom, Daum and Huang 2009)."""
        z, H, R, _ = found
        x, P = track.x, track.P
        means, covariances, shares = [x], [P], [weights[0]]
        for j in np.flatnonzero(weights[1:]):
            S = H[j] @ P @ H[j].T + R[j]
            K = P @ H[j].T @ np.linalg.inv(S)
            means.append(x + K @ (z[j] - H[j] @ x))
            covariances.append(P - K @ S @ K.T)
            shares.append(weights[j + 1])
        mean = sum(share * m for share, m in zip(shares, means, strict=True))
        P = np.zeros((4, 4))
        for share, m, C in zip(shares, means, covariances, strict=True):
            P += share * (C + np.outer(m - mean, m - mean))
        detected = weights[0] < 0.5
        return track._replace(
            x=mean,
            P=(P + P.T) / 2,
            seen=scan.time if detected else track.seen,
            hits=track.hits + detected,
            scans=track.scans + 1,
        )

    def stays(self, track, time):
        if track.id < 0:
            return track.scans - track.hits <= self.confirm[1] - self.confirm[0]
        return time - track.seen <= self.delete_after


def association(likelihood, missed):
    """(tracks, 1 + detections): marginal probabilities, first that of no detection, by all joint events."""
    T, D = likelihood.shape
    beta = np.zeros((T, D + 1))
    open_tracks = set(range(T))
    while open_tracks:
        cluster, border = [], [open_tracks.pop()]
        while border:
            i = border.pop()
            cluster.append(i)
            near = {k for k in open_tracks if (likelihood[i] * likelihood[k]).any()}
            open_tracks -= near
            border += near

        def events(rest, used, weight, chosen, cluster=cluster):
            if not rest:
                for i, j in zip(cluster, chosen, strict=True):
                    beta[i, j] += weight
                return
            events(rest[1:], used, weight * missed, [*chosen, 0])
            for j in np.flatnonzero(likelihood[rest[0]]):
                if j not in used:
                    events(rest[1:], used | {j}, weight * likelihood[rest[0], j], [*chosen, j + 1])

        events(cluster, frozenset(), 1.0, [])
    return beta / beta.sum(axis=1, keepdims=True)


def points(scan):
    """z, H, R of the detections in the fixed frame, and the density of clutter there."""
    x, y, yaw = scan.sensor_pose
    zs, Hs, Rs, densities = [], [], [], []
    for m in scan.measurement.T:
        if scan.kind == "radar":
            r, c, s = max(m[0], 1e-3), np.cos(yaw + m[1]), np.sin(yaw + m[1])
            J = np.array([[c, -r * s, 0.0], [s, r * c, 0.0], [0.0, 0.0, 1.0]])
            zs.append(np.array([x + r * c, y + r * s, m[2] + np.dot([c, s], scan.sensor_velocity)]))
            Hs.append(np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, c, s]]))
            densities.append(scan.clutter_density / r)
        else:
            J = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
            zs.append(np.array([x, y]) + J @ m)
            Hs.append(np.eye(2, 4))
            densities.append(scan.clutter_density)
        Rs.append(J @ scan.noise_covariance @ J.T)
    return zs, Hs, Rs, np.maximum(densities, 1e-9)


def new_track(found, j, time):
    z, H, R, _ = found
    x, P = np.array([z[j][0], z[j][1], 0.0, 0.0]), np.diag([1e4, 1e4, 900.0, 900.0])
    K = P @ H[j].T @ np.linalg.inv(H[j] @ P @ H[j].T + R[j])
    A = np.eye(4) - K @ H[j]
    return Track(x + K @ (z[j] - H[j] @ x), A @ P @ A.T + K @ R[j] @ K.T, time)


def output(tracks):
    shown = [track for track in tracks if track.id >= 0]
    if not shown:
        return None
    ids = np.array([track.id for track in shown])
    return ids, np.stack([track.x for track in shown], -1), np.stack([track.P for track in shown], -1)
