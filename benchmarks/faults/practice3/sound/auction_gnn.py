"""Global nearest neighbours by an auction: tracks bid for detections, and a price rises until nobody offers more."""

from collections import deque

import numpy as np
from benchmarks.faults import parts

GATE = {2: 18.42, 3: 21.11}  # 0.9999 by degrees of freedom
NEVER = -1e6
NONE_WORTH = -60.0  # to a track, of no detection at all
STEP = 0.02


def auction(worth):
    """Column of each row, or -1: the greatest sum of ``worth`` within ``STEP`` per row. Bertsekas' forward auction."""
    rows, columns = worth.shape
    own = np.where(np.eye(rows, dtype=bool), NONE_WORTH, NEVER)  # what a row gets that takes none
    value = np.hstack([worth, own])
    price, owner, taken = np.zeros(columns + rows), {}, np.full(rows, -1)
    waiting = deque(range(rows))
    while waiting:
        i = waiting.popleft()
        gain = value[i] - price
        j = int(gain.argmax())
        best, gain[j] = gain[j], -np.inf
        price[j] += best - max(gain.max(), best - 1e3) + STEP
        if j in owner:
            waiting.append(owner[j])
            taken[owner[j]] = -1
        owner[j], taken[i] = i, j
    return np.where(taken < columns, taken, -1)


class Track:
    __slots__ = ("P", "hits", "id", "lookouts", "seen", "x")

    def __init__(self, detection, time):
        z, H, R = detection
        self.x, self.P = np.array([z[0], z[1], 0.0, 0.0]), np.diag([0.0, 0.0, 900.0, 900.0])
        self.P[:2, :2] = R[:2, :2]
        if len(z) == 3:
            self.x, self.P = parts.updated(self.x, self.P, z[2:], H[2:], R[2:, 2:])
        self.id, self.hits, self.lookouts, self.seen = None, 1, 1, time


class Tracker:
    identities = "hidden"

    def __init__(self, sigma=3.0, needed=3, of=5, keep_s=1.0):
        self.sigma, self.needed, self.of, self.keep_s = sigma, needed, of, keep_s
        self.tracks, self.time, self.last_id = [], None, -1

    def step(self, state, scan):
        dt = scan.time - self.time if self.time is not None else 0.0
        self.time = scan.time
        for track in self.tracks:
            track.x, track.P = parts.moved(track.x, track.P, dt, self.sigma)
        detections = [parts.linear(scan, column) for column in scan.measurement.T]
        taken = auction(self.worth(detections))
        for track, j in zip(self.tracks, taken, strict=True):
            track.lookouts += parts.in_view(track.x, scan)
            if j >= 0:
                track.x, track.P = parts.updated(track.x, track.P, *detections[j])
                track.P = (track.P + track.P.T) / 2
                track.hits, track.seen = track.hits + 1, scan.time
                if track.id is None and track.hits >= self.needed:
                    self.last_id += 1
                    track.id = self.last_id
        self.tracks = [track for track in self.tracks if self.stays(track)]
        self.tracks += [Track(d, scan.time) for j, d in enumerate(detections) if j not in taken]
        return None, self.confirmed()

    def worth(self, detections):
        table = np.full((len(self.tracks), len(detections)), NEVER)
        for i, track in enumerate(self.tracks):
            for j, (z, H, R) in enumerate(detections):
                y, S = z - H @ track.x, H @ track.P @ H.T + R
                d2 = y @ np.linalg.solve(S, y)
                if d2 < GATE[len(z)]:
                    table[i, j] = -d2 - np.linalg.slogdet(S)[1]
        return table

    def stays(self, track):
        if track.id is None and track.lookouts - track.hits > self.of - self.needed:
            return False
        return self.time - track.seen <= self.keep_s

    def confirmed(self):
        shown = [track for track in self.tracks if track.id is not None]
        if not shown:
            return None
        ids = np.array([track.id for track in shown])
        return ids, np.stack([track.x for track in shown], axis=-1), np.stack([track.P for track in shown], axis=-1)
