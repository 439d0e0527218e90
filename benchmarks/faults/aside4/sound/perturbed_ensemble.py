"""The ensemble Kalman filter with perturbed measurements, in the axes of the sensor."""

import numpy as np
from benchmarks.faults.parts import first, push, transition, wrapped

MEMBERS = 240


class Tracker:
    random = True

    def __init__(self, seed=5, sigma=3.5):
        self.draw, self.sigma = np.random.default_rng(seed), sigma

    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            E = x[:, None] + np.linalg.cholesky(P) @ self.centred(4)
        else:
            time, E = state
            dt = scan.time - time
            E = transition(dt) @ E
            if dt > 0:
                E = E + self.sigma * push(dt) @ self.centred(2)
            if scan.valid:
                E = self.analysed(E, scan)
        return (scan.time, E), (E.mean(axis=1), np.cov(E))

    def centred(self, n):
        """Draws whose mean is zero and whose covariance is one."""
        e = self.draw.standard_normal((n, MEMBERS))
        e -= e.mean(axis=1, keepdims=True)
        L = np.linalg.cholesky(np.cov(e))
        return np.linalg.solve(L, e)

    def analysed(self, E, scan):
        HE = self.seen(E, scan)
        middle = HE.mean(axis=1, keepdims=True)
        A, Y = E - E.mean(axis=1, keepdims=True), HE - middle
        R = scan.noise_covariance
        noise = np.linalg.cholesky(R) @ self.centred(len(R))
        K = np.linalg.solve(Y @ Y.T / (MEMBERS - 1) + R, Y @ A.T / (MEMBERS - 1)).T
        gap = scan.measurement[:, None] + noise - HE
        if scan.kind == "radar":
            gap[1] = wrapped(gap[1])
        return E + K @ gap

    def seen(self, E, scan):
        x, y, yaw = scan.sensor_pose
        dx, dy = E[0] - x, E[1] - y
        if scan.kind != "radar":
            c, s = np.cos(yaw), np.sin(yaw)
            return np.array([c * dx + s * dy, c * dy - s * dx])
        r = np.hypot(dx, dy)
        angle = np.arctan2(dy, dx) - yaw
        reference = np.arctan2(E[1].mean() - y, E[0].mean() - x) - yaw
        rate = (dx * (E[2] - scan.sensor_velocity[0]) + dy * (E[3] - scan.sensor_velocity[1])) / r
        return np.array([r, reference + wrapped(angle - reference), rate])
