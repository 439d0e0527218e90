"""The velocity decays slowly; transition and noise come from one matrix exponential; the state is vx, px, vy, py."""

import numpy as np
from benchmarks.faults.parts import difference, expected, first
from scipy.linalg import expm

ORDER = [1, 3, 0, 2]  # where px, py, vx, vy are
DECAY_S = 80.0
DENSITY = 0.8  # m^2/s^3
A = np.kron(np.eye(2), [[-1 / DECAY_S, 0.0], [1.0, 0.0]])
L = np.kron(np.eye(2), [[1.0], [0.0]])


def discrete(dt):
    """Van Loan's: F and Q of an interval, exactly."""
    M = np.block([[-A, DENSITY * L @ L.T], [np.zeros((4, 4)), A.T]]) * dt
    E = expm(M)
    F = E[4:, 4:].T
    Q = F @ E[:4, 4:]
    return F, (Q + Q.T) / 2


class Tracker:
    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            inverse = np.argsort(ORDER)
            s, V = x[inverse], P[np.ix_(inverse, inverse)]
        else:
            time, s, V = state
            F, Q = discrete(scan.time - time)
            s, V = F @ s, F @ V @ F.T + Q
            if scan.valid:
                s, V = self.update(s, V, scan)
        return (scan.time, s, V), (s[ORDER], V[np.ix_(ORDER, ORDER)])

    def update(self, s, V, scan):
        h, H = expected(s[ORDER], scan)
        C = np.zeros_like(H)
        C[:, ORDER] = H
        S = C @ V @ C.T + scan.noise_covariance
        L = np.linalg.cholesky(S)
        W = np.linalg.solve(L, C @ V)  # the gain is W' inv(L)
        s = s + W.T @ np.linalg.solve(L, difference(scan.measurement, h, scan))
        V = V - W.T @ W
        return s, (V + V.T) / 2 + 1e-12 * np.eye(4)
