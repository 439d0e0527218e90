"""Rao and Blackwell: particles of the turn rate, each with a Kalman filter of place and velocity."""

import numpy as np
from benchmarks.faults.parts import first, linear_at

N = 60


def turning(w, dt):
    """(N, 4, 4), of an object whose velocity turns at the rate w."""
    a = w * dt
    small = np.abs(a) < 1e-6
    safe = np.where(small, 1.0, w)
    p = np.where(small, dt, np.sin(a) / safe)
    q = np.where(small, a * dt / 2, (1 - np.cos(a)) / safe)
    c, s, o, i = np.cos(a), np.sin(a), np.zeros_like(w), np.ones_like(w)
    return np.array([[i, o, p, -q], [o, i, q, p], [o, o, c, -s], [o, o, s, c]]).transpose(2, 0, 1)


class Tracker:
    random = True

    def __init__(self, seed=11, sigma=2.0, calm_s=2.0, rate=0.2):
        self.rng = np.random.default_rng(seed)
        self.sigma, self.calm_s, self.rate = sigma, calm_s, rate

    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            cloud = (self.rate * self.rng.standard_normal(N), np.tile(x, (N, 1)), np.tile(P, (N, 1, 1)), np.zeros(N))
        else:
            time, cloud = state
            cloud = self.predicted(cloud, scan.time - time)
            if scan.valid:
                cloud = self.corrected(cloud, scan)
        return (scan.time, cloud), self.mixture(cloud)

    def predicted(self, cloud, dt):
        w, x, P, logw = cloud
        keep = np.exp(-dt / self.calm_s)
        w = keep * w + self.rate * np.sqrt(1 - keep**2) * self.rng.standard_normal(N)
        F = turning(w, dt)
        G = self.sigma * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
        return w, np.einsum("nij,nj->ni", F, x), F @ P @ F.transpose(0, 2, 1) + G @ G.T, logw

    def corrected(self, cloud, scan):
        w, x, P, logw = cloud
        share = np.exp(logw - logw.max())
        z, H, R = linear_at(scan, share @ x[:, 2:] / share.sum())
        y = z - x @ H.T
        S = H @ P @ H.T + R + 1e-6 * np.eye(len(z))
        K = np.linalg.solve(S, H @ P).transpose(0, 2, 1)
        logw = (
            logw - (np.einsum("ni,ni->n", y, np.linalg.solve(S, y[:, :, None])[:, :, 0]) + np.linalg.slogdet(S)[1]) / 2
        )
        x = x + np.einsum("nij,nj->ni", K, y)
        P = P - K @ S @ K.transpose(0, 2, 1)
        P = (P + P.transpose(0, 2, 1)) / 2 + 1e-9 * np.eye(4)
        share = np.exp(logw - logw.max())
        share /= share.sum()
        logw = np.log(np.maximum(share, 1e-300))
        if 1 / (share**2).sum() < N / 2:
            places = (self.rng.random() + np.arange(N)) / N
            kept = np.minimum(np.searchsorted(np.cumsum(share), places), N - 1)
            w, x, P, logw = w[kept], x[kept], P[kept], np.zeros(N)
        return w, x, P, logw

    def mixture(self, cloud):
        _, x, P, logw = cloud
        share = np.exp(logw - logw.max())
        share /= share.sum()
        mean = share @ x
        apart = x - mean
        return mean, np.einsum("n,nij->ij", share, P) + np.einsum("n,ni,nj->ij", share, apart, apart)
