"""Other models of motion, and several of them at once."""

import numpy as np
from scipy.linalg import block_diag, expm
from tests.support.sound.measured import (
    corrected,
    difference,
    driven,
    expected,
    jacobian,
    predicted,
    start,
    transition,
)


class ConstantAcceleration:
    """Six states, driven by a jerk that is constant over the step."""

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
            return (scan.time, np.append(x, [0, 0]), block_diag(P, 6 * np.eye(2))), (x, P)
        t, x, P = state
        dt = scan.time - t
        F = np.eye(6) + dt * np.eye(6, k=2) + dt**2 / 2 * np.eye(6, k=4)
        G = 7.0 * np.vstack([dt**3 / 6 * np.eye(2), dt**2 / 2 * np.eye(2), dt * np.eye(2)])
        x, P = F @ x, F @ P @ F.T + G @ G.T
        if scan.valid:
            x, P = corrected(x, P, scan)
        return (scan.time, x, P), (x[:4], P[:4, :4])


class Singer:
    """An acceleration that fades within three seconds; its noise by Van Loan's exponential."""

    TAU, SIGMA = 3.0, 2.0

    def discrete(self, dt):
        A = np.eye(6, k=2)
        A[4:, 4:] = -np.eye(2) / self.TAU
        W = block_diag(np.zeros((4, 4)), 2 * self.SIGMA**2 / self.TAU * np.eye(2))
        M = expm(dt * np.block([[-A, W], [np.zeros((6, 6)), A.T]]))
        F = M[6:, 6:].T
        return F, F @ M[:6, 6:]

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
            return (scan.time, np.append(x, [0, 0]), block_diag(P, self.SIGMA**2 * np.eye(2))), (x, P)
        F, Q = self.discrete(scan.time - state[0])
        x, P = F @ state[1], F @ state[2] @ F.T + (Q + Q.T) / 2
        if scan.valid:
            x, P = corrected(x, P, scan)
        return (scan.time, x, P), (x[:4], P[:4, :4])


class WhiteAcceleration:
    """Constant velocity with continuous white acceleration."""

    def __init__(self, density=0.6):
        self.density = density

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
            return (scan.time, x, P), (x, P)
        t, x, P = state
        dt = scan.time - t
        F = transition(dt)
        Q = self.density * np.kron(np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]), np.eye(2))
        x, P = F @ x, F @ P @ F.T + Q
        if scan.valid:
            x, P = corrected(x, P, scan)
        return (scan.time, x, P), (x, P)


class TwoNoises:
    """An IMM of two filters of constant velocity, with a small and a large acceleration; weights kept as logarithms."""

    SIGMAS = (1.6, 4.5)
    RATES = np.array([[-0.3, 0.3], [0.6, -0.6]])

    def merged(self, w, xs, Ps):
        x = sum(a * m for a, m in zip(w, xs, strict=True))
        P = sum(a * (C + np.outer(m - x, m - x)) for a, m, C in zip(w, xs, Ps, strict=True))
        return x, P

    def step(self, state, scan):
        if state is None:
            x, P = start(scan)
            return (scan.time, np.array([0.7, 0.3]), [x, x], [P, P]), (x, P)
        t, w, xs, Ps = state
        dt = scan.time - t
        joint = w[:, None] * expm(dt * self.RATES)
        w = joint.sum(axis=0)
        mixed = [self.merged(joint[:, j] / w[j], xs, Ps) for j in range(2)]
        beliefs = [predicted(*m, dt, sigma) for m, sigma in zip(mixed, self.SIGMAS, strict=True)]
        if scan.valid:
            log_w = np.log(w)
            for j, (x, P) in enumerate(beliefs):
                H, y = jacobian(x, scan), difference(scan.measurement, expected(x, scan), scan)
                S = H @ P @ H.T + scan.noise_covariance
                log_w[j] -= (y @ np.linalg.solve(S, y) + np.linalg.slogdet(2 * np.pi * S)[1]) / 2
            w = np.exp(log_w - np.logaddexp(*log_w))
            beliefs = [corrected(*b, scan) for b in beliefs]
        w = np.maximum(w, 1e-9) / np.maximum(w, 1e-9).sum()
        xs, Ps = zip(*beliefs, strict=True)
        return (scan.time, w, xs, Ps), self.merged(w, xs, Ps)


class SoftNoise:
    """Two filters side by side that never mix; each scan's estimate is their mixture, weighted by recent likelihood."""

    def __init__(self):
        self.t, self.each, self.score = None, [], np.zeros(2)

    def step(self, state, scan):
        if self.t is None:
            self.t, self.each = scan.time, [start(scan)] * 2
            return None, self.each[0]
        dt, self.t = scan.time - self.t, scan.time
        self.each = [predicted(x, P, dt, sigma) for (x, P), sigma in zip(self.each, (1.8, 4.0), strict=True)]
        self.score *= np.exp(-dt / 1.0)
        if scan.valid:
            for j, (x, P) in enumerate(self.each):
                H, y = jacobian(x, scan), difference(scan.measurement, expected(x, scan), scan)
                S = H @ P @ H.T + scan.noise_covariance
                self.score[j] -= (y @ np.linalg.solve(S, y) + np.log(np.linalg.det(S))) / 2
            self.each = [corrected(x, P, scan) for x, P in self.each]
        w = np.exp(self.score - self.score.max())
        w /= w.sum()
        mean = w[0] * self.each[0][0] + w[1] * self.each[1][0]
        spread = [v * (P + np.outer(x - mean, x - mean)) for v, (x, P) in zip(w, self.each, strict=True)]
        return None, (mean, spread[0] + spread[1])


class RelativeToSensor:
    """Place and velocity relative to the sensor, whose own motion is taken out at each scan of the same sensor."""

    def step(self, state, scan):
        ego = np.append(scan.sensor_pose[:2], scan.sensor_velocity)
        if state is None:
            x, P = start(scan)
            return (scan.time, x - ego, P, ego), (x, P)
        t, relative, P, before = state
        moved = before - ego
        dt = scan.time - t
        F = transition(dt)
        relative = F @ (relative + before) - before + moved
        P = F @ P @ F.T + driven(dt)
        if scan.valid:
            at_origin = scan._replace(sensor_pose=np.array([0, 0, scan.sensor_pose[2]]), sensor_velocity=np.zeros(2))
            relative, P = corrected(relative, P, at_origin)
        return (scan.time, relative, P, ego), (relative + ego, P)
