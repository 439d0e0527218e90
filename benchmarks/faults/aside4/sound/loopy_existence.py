"""Each track is a Bernoulli: it may not exist. Probabilities of association come from loopy belief propagation."""

from typing import NamedTuple

import numpy as np
from benchmarks.faults import parts

GATE = {2: 18.42, 3: 21.11}
LIFE_S = 300.0
BIRTH = 0.05  # density of new objects over that of clutter


class Track(NamedTuple):
    x: np.ndarray
    P: np.ndarray
    r: float  # probability of existence
    key: int
    hits: float
    id: int = -1


def marginals(w):
    """Of rows with all columns and with none, for weights over those of no detection: 60 rounds of messages."""
    nu = np.ones_like(w)
    for _ in range(60):
        both = w * nu
        mu = w / (1 + np.maximum(both.sum(axis=1, keepdims=True) - both, 0.0))
        nu = 1 / (1 + np.maximum(mu.sum(axis=0, keepdims=True) - mu, 0.0))
    both = w * nu
    total = 1 + both.sum(axis=1)
    taken = mu.sum(axis=0)
    return both / total[:, None], 1 / total, 1 / (1 + taken)


class Tracker:
    identities = "hidden"

    def step(self, state, scan):
        time, keys, ids, tracks = state or (scan.time, 0, 0, ())
        dt = scan.time - time
        tracks = [
            t._replace(**dict(zip("xP", parts.moved(t.x, t.P, dt), strict=True)), r=t.r * np.exp(-dt / LIFE_S))
            for t in tracks
        ]
        found = [parts.linear(scan, column) for column in scan.measurement.T]
        tracks, free = self.updated(tracks, found, scan)
        for j, (z, H, R) in enumerate(found):
            x, P = np.array([*z[:2], 0.0, 0.0]), np.diag([1e4, 1e4, 625.0, 625.0])
            if free[j] > 0.2:
                x, P = parts.updated(x, P, z, H, R)
                tracks.append(Track(x, (P + P.T) / 2, free[j] * BIRTH / (1 + BIRTH), keys, 1.0))
                keys += 1
        after = []
        for t in self.merged(tracks):
            if t.id < 0 and t.r > 0.95 and t.hits > 2.5:
                t, ids = t._replace(id=ids), ids + 1
            if t.r > (0.05 if t.id >= 0 else 0.005):
                after.append(t)
        return (scan.time, keys, ids, tuple(after)), self.shown(after)

    def updated(self, tracks, found, scan):
        if not tracks:
            return [], np.ones(len(found))
        w, options, pd = np.zeros((len(tracks), len(found))), {}, []
        for i, t in enumerate(tracks):
            pd.append(min(scan.detection_probability, 0.9) * (1.0 if parts.in_view(t.x, scan) else 0.02))
            none = 1 - t.r * pd[i]
            for j, (z, H, R) in enumerate(found):
                y, S = z - H @ t.x, H @ t.P @ H.T + R
                d2 = y @ np.linalg.solve(S, y)
                if d2 < GATE[len(z)]:
                    area = scan.measurement[0, j] if scan.kind == "radar" else 1.0  # polar to flat
                    clutter = max(scan.clutter_density, 1e-7) / max(area, 1.0) * (1 + BIRTH)
                    density = np.exp(-d2 / 2) / np.sqrt(np.linalg.det(2 * np.pi * S))
                    w[i, j] = min(t.r * pd[i] * density / clutter / none, 1e8)
                    options[i, j] = parts.updated(t.x, t.P, z, H, R)
        p, missed, free = marginals(w) if len(found) else (w, np.ones(len(tracks)), np.ones(0))
        after = []
        for i, t in enumerate(tracks):
            alive = t.r * (1 - pd[i]) / (1 - t.r * pd[i])
            terms = [(missed[i] * alive, t.x, t.P)]
            terms += [(p[i, j], *options[i, j]) for j in range(len(found)) if (i, j) in options and p[i, j] > 1e-4]
            r = sum(term[0] for term in terms)
            x = sum(term[0] * term[1] for term in terms) / r
            P = sum(term[0] * (term[2] + np.outer(term[1] - x, term[1] - x)) for term in terms) / r
            after.append(t._replace(x=x, P=(P + P.T) / 2, r=min(r, 0.9999), hits=t.hits + p[i].sum()))
        return after, free

    def merged(self, tracks):
        """Of two that are in one place, with one velocity, the one that is more likely stays."""
        kept = []
        for t in sorted(tracks, key=lambda t: (t.id < 0, -t.r, t.key)):
            if all(np.hypot(*(t.x - k.x)[:2]) > 1.0 or np.hypot(*(t.x - k.x)[2:]) > 6.0 for k in kept):
                kept.append(t)
        return kept

    def shown(self, tracks):
        tracks = [t for t in tracks if t.id >= 0]
        if not tracks:
            return None
        r = np.array([t.r for t in tracks])
        ids = np.array([t.id for t in tracks])
        return ids, np.stack([t.x for t in tracks], axis=-1), np.stack([t.P for t in tracks], axis=-1), r
