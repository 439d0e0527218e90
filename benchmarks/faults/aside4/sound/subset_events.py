"""Joint probabilities of association, exact: a table over subsets of detections, in clusters, so that it is small."""

import numpy as np
from benchmarks.faults import parts

GATE = {2: 14.0, 3: 16.5}


class Track:
    def __init__(self, detection, time):
        z, H, R = detection
        self.x, self.P = parts.updated(np.array([*z[:2], 0.0, 0.0]), np.diag([1e4, 1e4, 625.0, 625.0]), z, H, R)
        self.seen, self.hits, self.misses, self.id = time, 1.0, 0, -1


def forward(rows, start):
    """Sums over the ways in which rows take columns, by the set that is taken."""
    tables = [start]
    for row in rows:
        table = {}
        for used, value in tables[-1].items():
            for j, weight in row.items():
                if j < 0 or not used >> j & 1:
                    after = used if j < 0 else used | 1 << j
                    table[after] = table.get(after, 0.0) + value * weight
        tables.append(table)
    return tables


def marginals(rows):
    """Of each row its columns' probabilities; -1 is none."""
    before = forward(rows, {0: 1.0})
    behind = forward(rows[::-1], {0: 1.0})[::-1]
    found = []
    for i, row in enumerate(rows):
        share = dict.fromkeys(row, 0.0)
        for j, weight in row.items():
            for a, left in before[i].items():
                for b, right in behind[i + 1].items():
                    mine = 0 if j < 0 else 1 << j
                    if not (a & b or a & mine or b & mine):
                        share[j] += left * weight * right
        total = sum(share.values())
        found.append({j: value / total for j, value in share.items()})
    return found


def clusters(rows):
    """Indices of rows that share columns."""
    groups = []
    for i, row in enumerate(rows):
        own, rest = ({i}, {j for j in row if j >= 0}), []
        for group in groups:
            if group[1] & own[1]:
                own = (own[0] | group[0], own[1] | group[1])
            else:
                rest.append(group)
        groups = [*rest, own]
    return [sorted(group[0]) for group in groups]


class Tracker:
    identities = "hidden"

    def __init__(self):
        self.tracks, self.time, self.count = [], None, 0

    def step(self, state, scan):
        dt = 0.0 if self.time is None else scan.time - self.time
        self.time = scan.time
        for t in self.tracks:
            t.x, t.P = parts.moved(t.x, t.P, dt)
        found = [parts.linear(scan, column) for column in scan.measurement.T]
        claimed = self.associate([t for t in self.tracks if t.id >= 0], found, range(len(found)), scan)
        left = [j for j in range(len(found)) if j not in claimed]
        claimed |= self.associate([t for t in self.tracks if t.id < 0], found, left, scan)
        for t in self.tracks:
            if t.id < 0 and t.hits > 2.8:
                t.id, self.count = self.count, self.count + 1
        self.tracks = [t for t in self.tracks if self.lives(t)]
        self.tracks += [Track(d, scan.time) for j, d in enumerate(found) if j not in claimed]
        shown = [t for t in self.tracks if t.id >= 0]
        if not shown:
            return None, None
        ids = np.array([t.id for t in shown])
        return None, (ids, np.stack([t.x for t in shown], axis=1), np.stack([t.P for t in shown], axis=2))

    def lives(self, t):
        if t.id < 0:
            return t.misses < 2 and self.time - t.seen <= 0.4
        return t.misses < 8 and self.time - t.seen <= 1.0

    def associate(self, tracks, found, columns, scan):
        """Columns that some track claims."""
        rows = []
        for t in tracks:
            pd = min(scan.detection_probability, 0.97) if parts.in_view(t.x, scan) else 0.05
            row = {-1: 1 - pd}
            for j in columns:
                z, H, R = found[j]
                y, S = z - H @ t.x, H @ t.P @ H.T + R
                d2 = y @ np.linalg.solve(S, y)
                if d2 < GATE[len(z)]:
                    area = max(scan.measurement[0, j], 1.0) if scan.kind == "radar" else 1.0
                    clutter = max(scan.clutter_density, 1e-6) / area
                    row[j] = pd * np.exp(-d2 / 2) / np.sqrt(np.linalg.det(2 * np.pi * S)) / clutter
            ranked = sorted((j for j in row if j >= 0), key=lambda j: -row[j])[:4]
            rows.append({j: row[j] for j in [-1, *ranked]})
        claimed = {j for row in rows for j in row if j >= 0}
        for group in clusters(rows):
            for i, share in zip(group, marginals([rows[i] for i in group]), strict=True):
                self.update(tracks[i], share, found, parts.in_view(tracks[i].x, scan))
        return claimed

    def update(self, t, share, found, visible):
        terms = [(share[-1], t.x, t.P)]
        terms += [(p, *parts.updated(t.x, t.P, *found[j])) for j, p in share.items() if j >= 0]
        x = sum(p * m for p, m, _ in terms)
        P = sum(p * (V + np.outer(m - x, m - x)) for p, m, V in terms)
        t.x, t.P = x, (P + P.T) / 2
        hit = 1 - share[-1]
        t.hits += hit
        if hit > 0.5:
            t.seen, t.misses = self.time, 0
        else:
            t.misses += visible
