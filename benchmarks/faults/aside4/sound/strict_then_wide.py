"""After two-stage trackers: tracked ones match strictly, what is left and lost ones widely, new ones at last."""

from enum import Enum
from typing import ClassVar

import numpy as np
from benchmarks.faults import parts
from scipy.optimize import linear_sum_assignment


class TrackState(Enum):
    NEW = 0
    TRACKED = 1
    LOST = 2
    REMOVED = 3


class STrack:
    def __init__(self, det, now):
        z, H, R = det
        self.mean = np.array([z[0], z[1], 0.0, 0.0])
        self.covariance = np.diag([0.0, 0.0, 625.0, 625.0])
        self.covariance[:2, :2] = R[:2, :2]
        if len(z) == 3:
            self.mean, self.covariance = parts.updated(self.mean, self.covariance, z[2:], H[2:], R[2:, 2:])
        self.state = TrackState.NEW
        self.track_id, self.tracklet_len, self.misses = -1, 1, 0
        self.end = now

    def update(self, det, now):
        self.mean, P = parts.updated(self.mean, self.covariance, *det)
        self.covariance = (P + P.T) / 2
        self.tracklet_len += 1
        self.end = now


def gating_distance(track, det):
    z, H, R = det
    d = z - H @ track.mean
    return d @ np.linalg.solve(H @ track.covariance @ H.T + R, d)


def linear_assignment(tracks, dets, left, thresh):
    """Pairs; the lists of what is left."""
    cost = np.full((len(tracks), len(left)), 1e5)
    for a, track in enumerate(tracks):
        for b, j in enumerate(left):
            d = gating_distance(track, dets[j])
            if d < thresh[len(dets[j][0])]:
                cost[a, b] = d
    pairs = [(a, b) for a, b in zip(*linear_sum_assignment(cost), strict=True) if cost[a, b] < 1e5]
    rows, columns = {a for a, _ in pairs}, {b for _, b in pairs}
    u_track = [t for a, t in enumerate(tracks) if a not in rows]
    return [(tracks[a], left[b]) for a, b in pairs], u_track, [j for b, j in enumerate(left) if b not in columns]


class Tracker:
    identities = "hidden"
    strict: ClassVar = {2: 9.21, 3: 11.34}
    wide: ClassVar = {2: 21.0, 3: 24.0}
    track_buffer = 1.0

    def __init__(self):
        self.stracks, self.frame_time, self.count = [], None, 0

    def step(self, state, scan):
        dt = 0.0 if self.frame_time is None else scan.time - self.frame_time
        self.frame_time = now = scan.time
        for t in self.stracks:
            t.mean, t.covariance = parts.moved(t.mean, t.covariance, dt)
        dets = [parts.linear(scan, column) for column in scan.measurement.T]
        tracked = [t for t in self.stracks if t.state is TrackState.TRACKED]
        lost = [t for t in self.stracks if t.state is TrackState.LOST]
        unconfirmed = [t for t in self.stracks if t.state is TrackState.NEW]
        first, rest, left = linear_assignment(tracked, dets, list(range(len(dets))), self.strict)
        second, rest, left = linear_assignment(rest + lost, dets, left, self.wide)
        third, gone, left = linear_assignment(unconfirmed, dets, left, self.wide)
        for t, j in first + second:
            t.update(dets[j], now)
            t.state = TrackState.TRACKED
        for t, j in third:
            t.update(dets[j], now)
            if t.tracklet_len == 3:
                t.state, t.track_id, self.count = TrackState.TRACKED, self.count, self.count + 1
        for t in rest:
            t.state = TrackState.REMOVED if now - t.end > self.track_buffer else TrackState.LOST
        for t in gone:
            t.misses += parts.in_view(t.mean, scan)
            if t.misses > 2 or now - t.end > 0.5:
                t.state = TrackState.REMOVED
        self.stracks = [t for t in self.stracks if t.state is not TrackState.REMOVED]
        self.stracks += [STrack(dets[j], now) for j in left]
        output = [t for t in self.stracks if t.track_id >= 0]
        if not output:
            return None, None
        means = np.array([t.mean for t in output]).T
        return None, (np.array([t.track_id for t in output]), means, np.dstack([t.covariance for t in output]))
