"""A Gaussian process through the last measurements: a line plus a smooth function of the time, solved each time."""

import numpy as np
from benchmarks.faults.parts import first, linear_at

KEPT = 36  # measurements
SIZE, LENGTH = 7.0, 1.8  # of the smooth part: m, s
PLACE, SPEED = 50.0, 40.0  # of the line, m and m/s


def kernel(s, t):
    """Covariances of place and velocity at the times s with place and velocity at t: the axes 0 and 1 are the times."""
    d = s[:, None] - t[None, :]
    k = SIZE**2 * np.exp(-(d**2) / (2 * LENGTH**2))
    both = np.empty((len(s), len(t), 2, 2))
    both[..., 0, 0] = k + PLACE**2 + SPEED**2 * s[:, None] * t[None, :]
    both[..., 0, 1] = k * d / LENGTH**2 + SPEED**2 * s[:, None]
    both[..., 1, 0] = -k * d / LENGTH**2 + SPEED**2 * t[None, :]
    both[..., 1, 1] = k * (1 - d**2 / LENGTH**2) / LENGTH**2 + SPEED**2
    return np.einsum("ijab,cd->ijacbd", both, np.eye(2)).reshape(len(s), len(t), 4, 4)


class Tracker:
    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            kept = [(scan.time, *linear_at(scan, np.zeros(2)))]
            return (kept, x), (x, P)
        kept, x = state
        if scan.valid:
            kept = [*kept, (scan.time, *linear_at(scan, x[2:]))][-KEPT:]
        x, P = self.solved(kept, scan.time)
        return (kept, x), (x, P)

    def solved(self, kept, now):
        times = np.array([time - now for time, *_ in kept])
        origin = np.array([*kept[-1][1][:2], 0.0, 0.0])
        sizes = [len(z) for _, z, *_ in kept]
        ends = np.cumsum([0, *sizes])
        every = np.zeros((ends[-1], 4 * len(kept)))
        noise = np.zeros((ends[-1], ends[-1]))
        for i, (_, _, H, R) in enumerate(kept):
            rows = slice(ends[i], ends[i + 1])
            every[rows, 4 * i : 4 * i + 4], noise[rows, rows] = H, R
        n = len(kept)
        among = kernel(times, times).transpose(0, 2, 1, 3).reshape(4 * n, 4 * n)
        towards = kernel(np.zeros(1), times).transpose(0, 2, 1, 3).reshape(4, 4 * n)
        gaps = np.concatenate([z - H @ origin for _, z, H, _ in kept])
        S = every @ among @ every.T + noise
        gain = np.linalg.solve(S, every @ towards.T).T
        P = kernel(np.zeros(1), np.zeros(1))[0, 0] - gain @ every @ towards.T
        return origin + gain @ gaps, (P + P.T) / 2
