"""Bierman's and Thornton's filter: the covariance is kept as U D U^T, and measurements are taken in one by one."""

import numpy as np
from benchmarks.faults.parts import first, linear_at, push, transition


def factors(P):
    """U, upper triangular with ones on the diagonal, and the diagonal of D."""
    n = len(P)
    P, U, D = P.copy(), np.eye(n), np.zeros(n)
    for j in range(n - 1, -1, -1):
        D[j] = P[j, j]
        if D[j] > 0:
            U[:j, j] = P[:j, j] / D[j]
            P[:j, :j] -= D[j] * np.outer(U[:j, j], U[:j, j])
    return U, D


def time_update(U, D, F, G, q):
    """Thornton's: the rows of [F U, G], made orthogonal from the last one upwards."""
    n = len(D)
    W, weight = np.hstack([F @ U, G]), np.concatenate([D, q])
    U, D = np.eye(n), np.zeros(n)
    for j in range(n - 1, -1, -1):
        D[j] = (W[j] ** 2) @ weight
        for i in range(j):
            U[i, j] = (W[i] * W[j]) @ weight / D[j]
            W[i] = W[i] - U[i, j] * W[j]
    return U, D


def scalar_update(x, U, D, h, r, residual):
    """Bierman's."""
    n = len(x)
    f = U.T @ h
    v = D * f
    U, D = U.copy(), D.copy()
    alpha, K = r, np.zeros(n)
    for j in range(n):
        before = alpha
        alpha = alpha + f[j] * v[j]
        D[j] *= before / alpha
        factor = -f[j] / before
        for i in range(j):
            old = U[i, j]
            U[i, j] = old + factor * K[i]
            K[i] += old * v[j]
        K[j] = v[j]
    return x + K / alpha * residual, U, D


class Tracker:
    def __init__(self, acceleration_sigma=3.0):
        self.q = np.full(2, acceleration_sigma**2)

    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            U, D = factors(P)
        else:
            time, x, U, D = state
            dt = scan.time - time
            if dt != 0:
                F = transition(dt)
                x = F @ x
                U, D = time_update(U, D, F, push(dt), self.q)
            if scan.valid:
                x, U, D = self.taken_in(x, U, D, scan)
        P = U * D @ U.T
        return (scan.time, x, U, D), (x, (P + P.T) / 2)

    def taken_in(self, x, U, D, scan):
        z, H, R = linear_at(scan, x[2:])
        B, d = factors(R)  # the rows of B^-1 z have independent errors
        z, H = np.linalg.solve(B, z), np.linalg.solve(B, H)
        for i in range(len(z)):
            x, U, D = scalar_update(x, U, D, H[i], d[i], z[i] - H[i] @ x)
        return x, U, D
