"""A square-root unscented filter: the root is an upper triangle, and updates go by rank-one changes of it."""

import numpy as np
from benchmarks.faults.parts import constant_velocity, difference, expected, first, wrapped

N = 4
ALPHA, BETA, KAPPA = 0.6, 2.0, 0.0
LAMBDA = ALPHA**2 * (N + KAPPA) - N
WM = np.full(2 * N + 1, 0.5 / (N + LAMBDA))
WC = WM.copy()
WM[0] = LAMBDA / (N + LAMBDA)
WC[0] = WM[0] + 1 - ALPHA**2 + BETA


def rank_one(U, v, sign):
    """Root of U'U + sign v v', an upper triangle too; None if that is not positive definite."""
    U, v = U.copy(), v.copy()
    for k in range(len(v)):
        square = U[k, k] ** 2 + sign * v[k] ** 2
        if square <= 1e-14 * U[k, k] ** 2:
            return None
        r = np.sqrt(square)
        c, s = r / U[k, k], v[k] / U[k, k]
        U[k, k] = r
        U[k, k + 1 :] = (U[k, k + 1 :] + sign * s * v[k + 1 :]) / c
        v[k + 1 :] = c * v[k + 1 :] - s * U[k, k + 1 :]
    return U


def root(rows):
    """Upper triangle U with U'U = rows' rows, and a positive diagonal."""
    U = np.linalg.qr(rows, mode="r")
    return np.where(np.diag(U) < 0, -1.0, 1.0)[:, None] * U


class Tracker:
    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            U = np.linalg.cholesky(P).T
        else:
            time, x, U = state
            x, U = self.predict(x, U, scan.time - time)
            if scan.valid:
                x, U = self.update(x, U, scan)
        return (scan.time, x, U), (x, U.T @ U)

    def points(self, x, U):
        spread = np.sqrt(N + LAMBDA) * U
        return np.vstack([x, x + spread, x - spread])

    def predict(self, x, U, dt):
        F, _ = constant_velocity(dt)
        G = 3.0 * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
        moved = self.points(x, U) @ F.T
        mean = WM @ moved
        U = root(np.vstack([np.sqrt(WC[1]) * (moved[1:] - mean), G.T]))
        changed = rank_one(U, np.sqrt(abs(WC[0])) * (moved[0] - mean), np.sign(WC[0]))
        return mean, U if changed is None else changed

    def update(self, x, U, scan):
        points = self.points(x, U)
        seen = np.array([expected(p, scan)[0] for p in points])
        centre = seen[0]
        apart = np.array([difference(s.copy(), centre, scan) for s in seen])
        shift = WM @ apart
        apart = apart - shift
        mean = centre + shift
        R = np.linalg.cholesky(scan.noise_covariance).T
        S = root(np.vstack([np.sqrt(WC[1]) * apart[1:], R]))
        changed = rank_one(S, np.sqrt(abs(WC[0])) * apart[0], np.sign(WC[0]))
        S = S if changed is None else changed
        cross = ((points - x) * WC[:, None]).T @ apart
        K = np.linalg.solve(S.T @ S, cross.T).T
        nu = scan.measurement - mean
        if scan.kind == "radar":
            nu[1] = wrapped(nu[1])
        V = S @ K.T
        for column in V:
            smaller = rank_one(U, column, -1.0)
            if smaller is None:  # rounding: by way of the covariance
                P = U.T @ U - np.outer(column, column)
                values, vectors = np.linalg.eigh((P + P.T) / 2)
                smaller = root((vectors * np.sqrt(np.maximum(values, 1e-9))).T)
            U = smaller
        return x + K @ nu, U
