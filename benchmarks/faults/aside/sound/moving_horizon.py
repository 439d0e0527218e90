"""A moving-horizon estimator: least squares over the last second, with the estimate before it as arrival cost."""

import numpy as np


def position(scan):
    """The position in the fixed frame and its covariance."""
    x, y, yaw = scan.sensor_pose
    radar = scan.kind == "radar"
    r, angle = (scan.measurement[0], yaw + scan.measurement[1]) if radar else (1.0, yaw)
    c, s = np.cos(angle), np.sin(angle)
    J = np.array([[c, -r * s], [s, r * c]])
    local = np.array([r, 0.0]) if radar else scan.measurement
    return np.array([x, y]) + J @ local, J @ scan.noise_covariance[:2, :2] @ J.T


def constant_velocity(dt, sigma=3.0):
    F = np.eye(4) + dt * np.eye(4, k=2)
    G = sigma * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
    return F, G @ G.T


class Tracker:
    """Each row of the problem is a measurement, or the push between two instants, over its standard deviation."""

    def __init__(self, horizon_s=0.8, acceleration_sigma=3.0):
        self.horizon, self.sigma = horizon_s, acceleration_sigma

    def step(self, state, scan):
        if state is None:
            z, R = position(scan)
            x, P = np.array([*z, 0.0, 0.0]), np.diag([0.0, 0.0, 400.0, 400.0])
            P[:2, :2] = R
            return ((scan.time, x, P), ((scan.time, None, None),)), (x, P)
        (begun, x, P), window = state
        z, R = position(scan) if scan.valid else (None, None)
        window = [*window, (scan.time, z, R)]
        while window[-1][0] - window[0][0] > self.horizon:
            x, P = self.marginal(x, P, window[0], window[1])
            window = window[1:]
            begun = window[0][0]
        return ((begun, x, P), tuple(window)), self.solved(x, P, window)

    def marginal(self, x, P, first, second):
        """The arrival cost moved on by one instant: what is known of it from the measurements before the next."""
        x, P = self.taken(x, P, *first[1:])
        F, Q = constant_velocity(second[0] - first[0], self.sigma)
        return F @ x, F @ P @ F.T + Q

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
                M = constant_velocity(dt)[0] @ M
                M[:, 2 + 2 * k : 4 + 2 * k] += np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
            if z is not None:
                A += M[:2].T @ np.linalg.solve(R, M[:2])
                b += M[:2].T @ np.linalg.solve(R, z)
        inverse = np.linalg.inv(A)
        covariance = M @ inverse @ M.T
        return M @ inverse @ b, (covariance + covariance.T) / 2
