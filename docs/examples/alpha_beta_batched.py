import numpy as np


class BatchedAlphaBeta:
    batched = True

    def __init__(self, alpha=0.5, beta=0.1, acceleration_sigma=3.0):
        self.alpha, self.beta, self.sigma = alpha, beta, acceleration_sigma

    def step(self, state, scan):
        n, (x, y, yaw), radar = scan.valid.size, scan.sensor_pose, scan.kind == "radar"
        r, angle = (scan.measurement[0], yaw + scan.measurement[1]) if radar else (np.ones(n), np.full(n, yaw))
        c, s = np.cos(angle), np.sin(angle)
        J = np.array([[c, -r * s], [s, r * c]])
        local = np.stack([r, 0 * r]) if radar else scan.measurement
        z = np.array([[x], [y]]) + np.einsum("ikn,kn->in", J, local)
        R = np.einsum("ikn,kl,jln->ijn", J, scan.noise_covariance[:2, :2], J)
        if state is None:  # nothing is known of any object
            state = scan.time, np.full(n, np.nan), np.full((4, n), np.nan), np.full((4, 4, n), np.nan)
        time, updated, mean, P = state
        dt, since = scan.time - time, scan.time - updated
        F = np.eye(4) + dt * np.eye(4, k=2)
        G = self.sigma * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
        mean, P = F @ mean, np.einsum("ik,kln,jl->ijn", F, P, F) + (G @ G.T)[:, :, None]
        K = np.zeros((4, 2, n))
        K[0, 0] = K[1, 1] = self.alpha
        K[2, 0] = K[3, 1] = np.where(since > 0, self.beta / np.maximum(since, 1e-9), 0.0)
        A = np.eye(4)[:, :, None] - np.concatenate([K, np.zeros((4, 2, n))], axis=1)
        later = mean + np.einsum("ikn,kn->in", K, z - mean[:2])
        later_P = np.einsum("ikn,kln,jln->ijn", A, P, A) + np.einsum("ikn,kln,jln->ijn", K, R, K)
        first = np.concatenate([z, np.zeros((2, n))])
        first_P = np.zeros((4, 4, n))
        first_P[:2, :2], first_P[2, 2], first_P[3, 3] = R, 400.0, 400.0
        known = ~np.isnan(updated)
        mean = np.where(scan.valid, np.where(known, later, first), mean)
        P = np.where(scan.valid, np.where(known, later_P, first_P), P)
        return (scan.time, np.where(scan.valid, scan.time, updated), mean, P), (mean, P)
