"""Four interacting models in stacked arrays; only neighbours on a ladder of noises change into each other, by expm."""

import numpy as np
from benchmarks.faults.parts import first, linear_at, push, transition
from scipy.linalg import expm

SIGMA = np.array([1.5, 2.5, 4.0, 7.0])
STEPS = np.diag([0.8, 0.8, 0.8], k=1) + np.diag([1.2, 1.2, 1.2], k=-1)  # per second, from row to column
RATES = STEPS - np.diag(STEPS.sum(axis=1))


class Tracker:
    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            mu, X, V = np.array([0.1, 0.3, 0.4, 0.2]), np.tile(x, (4, 1)), np.tile(P, (4, 1, 1))
        else:
            time, mu, X, V = state
            mu, X, V = self.time_update(mu, X, V, scan.time - time)
            if scan.valid:
                mu, X, V = self.measurement_update(mu, X, V, scan)
        return (scan.time, mu, X, V), self.fused(mu, X, V)

    def time_update(self, mu, X, V, dt):
        joint = mu[:, None] * expm(RATES * dt)
        c = joint.sum(axis=0)
        share = joint / c  # share[i, j], of model i in the start of model j
        X0 = share.T @ X
        D = X[:, None] - X0[None]
        V0 = np.einsum("ij,ikl->jkl", share, V) + np.einsum("ij,ijk,ijl->jkl", share, D, D)
        F, G = transition(dt), push(dt)
        return c, X0 @ F.T, F @ V0 @ F.T + SIGMA[:, None, None] ** 2 * (G @ G.T)

    def measurement_update(self, mu, X, V, scan):
        z, H, R = linear_at(scan, (mu @ X)[2:])
        R = R + 1e-6 * np.eye(len(z))
        Y = z - X @ H.T
        S = H @ V @ H.T + R
        K = np.linalg.solve(S, H @ V).transpose(0, 2, 1)
        d2 = np.einsum("mi,mi->m", Y, np.linalg.solve(S, Y[..., None])[..., 0])
        score = np.log(mu) - (d2 + np.linalg.slogdet(S)[1]) / 2
        A = np.eye(4) - K @ H
        V = A @ V @ A.transpose(0, 2, 1) + K @ R @ K.transpose(0, 2, 1)
        mu = np.exp(score - score.max()) + 1e-8
        return mu / mu.sum(), X + np.einsum("mij,mj->mi", K, Y), V

    def fused(self, mu, X, V):
        x = mu @ X
        D = X - x
        P = np.einsum("m,mkl->kl", mu, V) + np.einsum("m,mk,ml->kl", mu, D, D)
        return x, (P + P.T) / 2 + 1e-9 * np.eye(4)
