"""Multiple hypotheses: the five most likely ways to explain all scans are kept, and the most likely one is shown."""

from typing import NamedTuple

import numpy as np
from benchmarks.faults import parts
from scipy.optimize import linear_sum_assignment

GATE = {2: 18.42, 3: 21.11}
FAR = 1e6
NEW = -1.0  # logarithm of the density of new objects over that of clutter
KEPT, BRANCHES = 5, 3


class Track(NamedTuple):
    key: int  # of the detection that it began with, the same in all hypotheses
    x: np.ndarray
    P: np.ndarray
    seen: float
    hits: int = 1
    missed: int = 0


class Tracker:
    identities = "hidden"

    def __init__(self):
        self.hypotheses = [(0.0, ())]
        self.time, self.keys, self.ids = None, 0, {}

    def step(self, state, scan):
        dt = 0.0 if self.time is None else scan.time - self.time
        self.time = scan.time
        detections = [parts.linear(scan, column) for column in scan.measurement.T]
        areas = scan.measurement[0] if scan.kind == "radar" else np.ones(len(detections))
        clutter = np.log(np.maximum(scan.clutter_density / np.maximum(areas, 1e-3), 1e-9))
        children = []
        for score, tracks in self.hypotheses:
            tracks = [t._replace(**dict(zip("xP", parts.moved(t.x, t.P, dt), strict=True))) for t in tracks]
            children += self.branches(score, tracks, detections, clutter, scan)
        self.keys += len(detections)
        self.hypotheses = self.best(children)
        return None, self.shown(self.hypotheses[0][1])

    def branches(self, score, tracks, detections, clutter, scan):
        T, D = len(tracks), len(detections)
        cost = np.full((T, D + T), FAR)
        visible = [parts.in_view(t.x, scan) for t in tracks]
        for i, track in enumerate(tracks):
            detected = scan.detection_probability if visible[i] else 0.05
            cost[i, D + i] = -np.log(max(1 - detected, 1e-3))
            for j, (z, H, R) in enumerate(detections):
                y, S = z - H @ track.x, H @ track.P @ H.T + R
                d2 = y @ np.linalg.solve(S, y)
                if d2 < GATE[len(z)]:
                    cost[i, j] = (d2 + np.linalg.slogdet(2 * np.pi * S)[1]) / 2 - np.log(detected) + clutter[j] + NEW
        for loss, columns in assignments(cost):
            taken = set(columns)
            after = [self.next(*item, detections, visible) for item in zip(tracks, columns, range(T), strict=True)]
            after = [t for t in after if (t.missed < 3 or t.hits > 2) and self.time - t.seen <= 1.0]
            after += [self.begun(j, d) for j, d in enumerate(detections) if j not in taken]
            yield score - loss, tuple(after)

    def next(self, track, column, i, detections, visible):
        if column >= len(detections):
            return track._replace(missed=track.missed + visible[i])
        x, P = parts.updated(track.x, track.P, *detections[column])
        return Track(track.key, x, (P + P.T) / 2, self.time, track.hits + 1)

    def begun(self, j, detection):
        z, H, R = detection
        start = np.array([*z[:2], 0.0, 0.0]), np.diag([1e4, 1e4, 400.0, 400.0])
        return Track(self.keys + j, *parts.updated(*start, z, H, R), self.time)

    def best(self, children):
        kept, known = [], set()
        for score, tracks in sorted(children, key=lambda child: -child[0]):
            content = tuple((t.key, t.seen, t.hits) for t in tracks if t.hits > 1)
            if content not in known:
                known.add(content)
                kept.append((score, tracks))
        return [(score - kept[0][0], tracks) for score, tracks in kept[:KEPT]]

    def shown(self, tracks):
        tracks = [t for t in tracks if t.hits > 2]
        if not tracks:
            return None
        ids = np.array([self.ids.setdefault(t.key, len(self.ids)) for t in tracks])
        return ids, np.stack([t.x for t in tracks], axis=-1), np.stack([t.P for t in tracks], axis=-1)


def assignments(cost):
    """The best one, and the best ones that leave out one of its pairs."""
    if not len(cost):
        return [(0.0, ())]
    found = [solved(cost)]
    for i, j in enumerate(found[0][1]):
        if (cost[i] < FAR).sum() < 3 and (cost[:, j] < FAR).sum() < 2:
            continue  # nothing else is likely
        without = cost.copy()
        without[i, j] = FAR
        found.append(solved(without))
    return sorted((f for f in found if f[0] < FAR / 2), key=lambda f: f[0])[:BRANCHES]


def solved(cost):
    rows, columns = linear_sum_assignment(cost)
    return cost[rows, columns].sum(), tuple(int(j) for j in columns)
