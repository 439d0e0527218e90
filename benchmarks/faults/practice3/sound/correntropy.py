"""Maximum correntropy: errors of the prediction and of the measurement are weighted by a wide Gaussian kernel."""

import numpy as np
from benchmarks.faults import parts

KERNEL = 4.0  # in standard deviations


def weights(errors):
    return np.maximum(np.exp(-(errors**2) / (2 * KERNEL**2)), 1e-3)


class Tracker(parts.Filter):
    def corrected(self, x, P, scan):
        z, H, R = parts.linear_at(scan, x[2:])
        Bp, Br = np.linalg.cholesky(P), np.linalg.cholesky(R)
        y = z - H @ x
        K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
        move = K @ y
        for _ in range(10):
            believed = Bp / weights(np.linalg.solve(Bp, move)) @ Bp.T
            noise = Br / weights(np.linalg.solve(Br, y - H @ move)) @ Br.T
            K = np.linalg.solve(H @ believed @ H.T + noise, H @ believed).T
            before, move = move, K @ y
            if np.linalg.norm(move - before) <= 1e-6 * np.linalg.norm(before):
                break
        x, P = parts.with_gain(x, P, K, y, H, R)
        return x, (P + P.T) / 2
