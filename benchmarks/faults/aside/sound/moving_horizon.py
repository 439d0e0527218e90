"""A moving-horizon estimator: least squares over the last second, with the estimate before it as arrival cost."""

import numpy as np
from benchmarks.faults.parts import first, moved, position, push, transition


class Tracker:
    """Each row of the problem is a measurement, or the push between two instants, over its standard deviation."""

    def __init__(self, horizon_s=0.8, acceleration_sigma=3.0):
        self.horizon, self.sigma = horizon_s, acceleration_sigma

    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            return ((scan.time, x, P), ((scan.time, None, None),)), (x, P)
        (begun, x, P), window = state
        z, R = position(scan) if scan.valid else (None, None)
        window = [*window, (scan.time, z, R)]
        while window[-1][0] - window[0][0] > self.horizon:
            x, P = self.marginal(x, P, window[0], window[1])
            window = window[1:]
            begun = window[0][0]
        return ((begun, x, P), tuple(window)), self.solved(x, P, window)

    def marginal(self, x, P, early, late):
        """The arrival cost moved on by one instant: what is known of it from the measurements before the next."""
        return moved(*self.taken(x, P, *early[1:]), late[0] - early[0], self.sigma)

    def taken(self, x, P, z, R):
        if z is None:
            return x, P
        information = np.linalg.inv(P) + np.pad(np.linalg.inv(R), (0, 2))
        P_new = np.linalg.inv(information)
        return x + P_new[:, :2] @ np.linalg.solve(R, z - x[:2]), (P_new + P_new.T) / 2

    def solved(self, x, P, window):
        """Unknown: the state at the window's begin and two accelerations between each two instants."""
        n = 4 + 2 * (len(window) - 1)
        A, b = np.zeros((n, n)), np.zeros(n)
        A[:4, :4] = np.linalg.inv(P)
        b[:4] = A[:4, :4] @ x
        A[range(4, n), range(4, n)] = 1 / self.sigma**2
        M = np.eye(4, n)  # the state at this instant, of the unknown
        for k, (time, z, R) in enumerate(window):
            if k:
                dt = time - window[k - 1][0]
                M = transition(dt) @ M
                M[:, 2 + 2 * k : 4 + 2 * k] += push(dt)
            if z is not None:
                A += M[:2].T @ np.linalg.solve(R, M[:2])
                b += M[:2].T @ np.linalg.solve(R, z)
        inverse = np.linalg.inv(A)
        covariance = M @ inverse @ M.T
        return M @ inverse @ b, (covariance + covariance.T) / 2
