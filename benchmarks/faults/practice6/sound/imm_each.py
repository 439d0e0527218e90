"""Global nearest neighbours of tracks that are filters of two interacting models each."""

from dataclasses import dataclass, replace

import numpy as np
from benchmarks.faults import parts
from scipy.optimize import linear_sum_assignment

SIGMAS = (0.8, 4.0)  # m/s^2
LENGTHS = (2.0, 1.0)  # s that a model lasts
GATES = {2: 16.3, 3: 18.9}
FAR = 1e3


@dataclass(frozen=True)
class Track:
    mu: np.ndarray
    bank: tuple
    seen: float
    hits: int = 1
    number: int = -1

    def moments(self, mu=None):
        mu = self.mu if mu is None else mu
        x = sum(w * m for w, (m, _) in zip(mu, self.bank, strict=True))
        P = sum(w * (C + np.outer(m - x, m - x)) for w, (m, C) in zip(mu, self.bank, strict=True))
        return x, (P + P.T) / 2

    def predicted(self, dt):
        stay = np.exp(-dt / np.array(LENGTHS))
        joint = self.mu[:, None] * np.array([[stay[0], 1 - stay[0]], [1 - stay[1], stay[1]]])
        mu = joint.sum(axis=0)
        starts = [self.moments(joint[:, j] / mu[j]) for j in range(2)]
        return replace(
            self, mu=mu, bank=tuple(parts.moved(*s, dt, sigma) for s, sigma in zip(starts, SIGMAS, strict=True))
        )

    def corrected(self, detection, time):
        z, H, R = detection
        score = np.log(self.mu)
        for k, (x, P) in enumerate(self.bank):
            y, S = z - H @ x, H @ P @ H.T + R
            score[k] -= (y @ np.linalg.solve(S, y) + np.linalg.slogdet(S)[1]) / 2
        mu = np.maximum(np.exp(score - score.max()), 1e-6)
        bank = tuple(parts.updated(x, P, z, H, R) for x, P in self.bank)
        return replace(self, mu=mu / mu.sum(), bank=bank, seen=time, hits=self.hits + 1)


def costs(tracks, detections):
    """Squared distances with the logarithm of the determinant; FAR beyond the gate."""
    result = np.full((len(tracks), len(detections)), FAR)
    for i, track in enumerate(tracks):
        x, P = track.moments()
        for j, (z, H, R) in enumerate(detections):
            y, S = z - H @ x, H @ P @ H.T + R
            d2 = y @ np.linalg.solve(S, y)
            if d2 < GATES[len(z)]:
                result[i, j] = d2 + np.linalg.slogdet(S)[1]
    return result


class Tracker:
    identities = "hidden"

    def step(self, state, scan):
        time, numbers, tracks = state or (scan.time, 0, ())
        tracks = [track.predicted(scan.time - time) for track in tracks]
        detections = [parts.linear(scan, d) for d in scan.measurement.T]
        free = set(range(len(detections)))
        if tracks and detections:
            cost = costs(tracks, detections)
            for i, j in zip(*linear_sum_assignment(cost), strict=True):
                if cost[i, j] < FAR:
                    tracks[i] = tracks[i].corrected(detections[j], scan.time)
                    free.discard(int(j))
                    if tracks[i].number < 0 and tracks[i].hits == 4:
                        tracks[i], numbers = replace(tracks[i], number=numbers), numbers + 1
        tracks = [t for t in tracks if scan.time - t.seen <= (0.3 if t.number < 0 else 1.2)]
        for j in sorted(free):
            z, _, R = detections[j]
            P = np.diag([0.0, 0.0, 400.0, 400.0])
            P[:2, :2] = R[:2, :2]
            one = np.array([*z[:2], 0.0, 0.0]), P
            tracks.append(Track(np.array([0.5, 0.5]), (one, one), scan.time))
        return (scan.time, numbers, tuple(tracks)), self.shown([t for t in tracks if t.number >= 0])

    def shown(self, tracks):
        if not tracks:
            return None
        both = [t.moments() for t in tracks]
        return (
            np.array([t.number for t in tracks]),
            np.column_stack([x for x, _ in both]),
            np.dstack([P for _, P in both]),
        )
