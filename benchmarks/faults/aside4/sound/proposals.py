"""Tracks propose to detections, nearest first; a detection keeps its best suitor: a stable matching."""

from collections import deque

import numpy as np
from benchmarks.faults import parts

GATE = {2: 18.42, 3: 21.11}


class Track:
    def __init__(self, detection, time):
        z, H, R = detection
        self.x, self.P = parts.updated(np.array([*z[:2], 0.0, 0.0]), np.diag([1e4, 1e4, 625.0, 625.0]), z, H, R)
        self.seen, self.hits, self.looks, self.id = time, 1, 1, None

    def cost(self, detection):
        z, H, R = detection
        y, S = z - H @ self.x, H @ self.P @ H.T + R
        d2 = y @ np.linalg.solve(S, y)
        return d2 + np.linalg.slogdet(S)[1] if d2 < GATE[len(z)] else np.inf

    def take(self, detection, time):
        x, P = parts.updated(self.x, self.P, *detection)
        self.x, self.P, self.seen, self.hits = x, (P + P.T) / 2, time, self.hits + 1


def matched(costs):
    """Detection of each track that has one."""
    lists = [deque(sorted(np.flatnonzero(np.isfinite(row)), key=row.__getitem__)) for row in costs]
    engaged, waiting = {}, deque(range(len(lists)))
    while waiting:  # each turn ends a track's wait or shortens a list
        i = waiting.popleft()
        if not lists[i]:
            continue
        j = lists[i].popleft()
        rival = engaged.get(j)
        if rival is None or costs[i, j] < costs[rival, j]:
            engaged[j] = i
            if rival is not None:
                waiting.append(rival)
        else:
            waiting.append(i)
    return {i: j for j, i in engaged.items()}


class Tracker:
    identities = "hidden"

    def __init__(self):
        self.tracks, self.time, self.given = [], None, 0

    def step(self, state, scan):
        dt = 0.0 if self.time is None else scan.time - self.time
        self.time = scan.time
        for track in self.tracks:
            track.x, track.P = parts.moved(track.x, track.P, dt)
        found = [parts.linear(scan, column) for column in scan.measurement.T]
        costs = np.array([[t.cost(d) for d in found] for t in self.tracks]).reshape(len(self.tracks), len(found))
        pairs = matched(costs)
        for i, track in enumerate(self.tracks):
            track.looks += parts.in_view(track.x, scan)
            if i in pairs:
                track.take(found[pairs[i]], scan.time)
            if track.id is None and track.hits == 3:
                track.id, self.given = self.given, self.given + 1
        self.tracks = [t for t in self.tracks if self.lives(t)]
        self.tracks += [Track(d, scan.time) for j, d in enumerate(found) if j not in pairs.values()]
        shown = [t for t in self.tracks if t.id is not None]
        if not shown:
            return None, None
        ids = np.array([t.id for t in shown])
        return None, (ids, np.stack([t.x for t in shown], axis=1), np.stack([t.P for t in shown], axis=2))

    def lives(self, track):
        if track.id is None:
            return track.looks - track.hits < 3 and self.time - track.seen < 0.5
        return self.time - track.seen <= 1.0
