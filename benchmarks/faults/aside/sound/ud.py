"""Bierman's and Thornton's filter: the covariance is U D Uᵀ with a unit upper triangular U, and never formed inside."""

import numpy as np
from benchmarks.faults.parts import first, position, push, transition


def factors(P):
    P, n = P.copy(), len(P)
    U, D = np.eye(n), np.zeros(n)
    for j in range(n - 1, -1, -1):
        D[j] = P[j, j]
        U[:j, j] = P[:j, j] / D[j]
        P[:j, :j] -= D[j] * np.outer(U[:j, j], U[:j, j])
    return U, D


def weighted_gram_schmidt(W, weights):
    """U and D with U D Uᵀ = W diag(weights) Wᵀ."""
    W, n = W.copy(), len(W)
    U, D = np.eye(n), np.zeros(n)
    for j in range(n - 1, -1, -1):
        D[j] = weights @ W[j] ** 2
        U[:j, j] = (W[:j] * weights) @ W[j] / D[j]
        W[:j] -= np.outer(U[:j, j], W[j])
    return U, D


def scalar_update(x, U, D, z, h, r):
    f = U.T @ h
    g = D * f
    alpha, K = r, np.zeros(len(x))
    U, D = U.copy(), D.copy()
    for j in range(len(x)):
        before, alpha = alpha, alpha + f[j] * g[j]
        D[j] *= before / alpha
        column = U[:, j].copy()
        U[:j, j] -= f[j] / before * K[:j]
        K += g[j] * column
    return x + K / alpha * (z - h @ x), U, D


class Tracker:
    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            U, D = factors(P)
            return (scan.time, x, U, D), (x, P)
        time, x, U, D = state
        dt = scan.time - time
        F = transition(dt)
        x = F @ x
        U, D = weighted_gram_schmidt(np.hstack([F @ U, push(dt)]), np.concatenate([D, [9.0, 9.0]]))
        if scan.valid:
            z, R = position(scan)
            L = np.linalg.cholesky(R)
            for value, h in zip(np.linalg.solve(L, z), np.linalg.inv(L) @ np.eye(2, 4), strict=True):
                x, U, D = scalar_update(x, U, D, value, h, 1.0)
        return (scan.time, x, U, D), (x, U @ np.diag(D) @ U.T)
