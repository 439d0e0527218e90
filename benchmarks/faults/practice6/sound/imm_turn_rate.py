"""Two interacting models of px, py, vx, vy and a turn rate: one goes straight on, the other one turns at that rate."""

import numpy as np
from benchmarks.faults.parts import difference, expected, first, push

STAY = np.array([[0.98, 0.02], [0.03, 0.97]])
SIGMA = (2.5, 2.5)  # m/s^2
RATE = 0.15  # rad/s, of a turn that begins
RATE_NOISE = 0.15  # rad/s per root second


def straight(x, P, dt):
    F = np.eye(5)
    F[:4, :4] += dt * np.eye(4, k=2)
    F[4, 4] = 0.0
    Q = np.zeros((5, 5))
    Q[:4, :4] = SIGMA[0] ** 2 * push(dt) @ push(dt).T
    Q[4, 4] = RATE**2
    return F @ x, F @ P @ F.T + Q


def turned(x, dt):
    a = x[4] * dt
    # sin(a) / w and (1 - cos(a)) / w, also where the rate is zero
    s, c = dt * np.sinc(a / np.pi), dt * np.sin(a / 2) * np.sinc(a / 2 / np.pi)
    move = np.array([[s, -c], [c, s]])
    spin = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
    return np.concatenate([x[:2] + move @ x[2:4], spin @ x[2:4], x[4:]])


def turning(x, P, dt):
    F = np.empty((5, 5))
    for k, h in enumerate((1e-3, 1e-3, 1e-3, 1e-3, 1e-5)):
        e = np.zeros(5)
        e[k] = h
        F[:, k] = (turned(x + e, dt) - turned(x - e, dt)) / (2 * h)
    Q = np.zeros((5, 5))
    Q[:4, :4] = SIGMA[1] ** 2 * push(dt) @ push(dt).T
    Q[4, 4] = RATE_NOISE**2 * dt
    return turned(x, dt), F @ P @ F.T + Q


def mixture(w, xs, Ps):
    x = w @ xs
    return x, sum(v * (P + np.outer(m - x, m - x)) for v, m, P in zip(w, xs, Ps, strict=True))


class Tracker:
    def step(self, state, scan):
        if state is None:
            x, P = np.zeros(5), np.diag([0.0, 0.0, 0.0, 0.0, RATE**2])
            x[:4], P[:4, :4] = first(scan)
            mu, xs, Ps = np.array([0.6, 0.4]), np.array([x, x]), [P, P]
        else:
            time, mu, xs, Ps = state
            mu, xs, Ps = self.predicted(mu, xs, Ps, scan.time - time)
            if scan.valid:
                mu, xs, Ps = self.corrected(mu, xs, Ps, scan)
        x, P = mixture(mu, xs, Ps)
        return (scan.time, mu, xs, Ps), (x[:4], (P + P.T)[:4, :4] / 2)

    def predicted(self, mu, xs, Ps, dt):
        joint = mu[:, None] * STAY
        mu = joint.sum(axis=0)
        starts = [mixture(joint[:, j] / mu[j], xs, Ps) for j in range(2)]
        moves = [move(*start, dt) for move, start in zip((straight, turning), starts, strict=True)]
        return mu, np.array([x for x, _ in moves]), [P for _, P in moves]

    def corrected(self, mu, xs, Ps, scan):
        score, means, covs = np.log(mu), [], []
        for j, (x, P) in enumerate(zip(xs, Ps, strict=True)):
            h, H = expected(x[:4], scan)
            H = np.hstack([H, np.zeros((len(h), 1))])
            y, S = difference(scan.measurement, h, scan), H @ P @ H.T + scan.noise_covariance
            K = np.linalg.solve(S, H @ P).T
            A = np.eye(5) - K @ H
            means.append(x + K @ y)
            covs.append(A @ P @ A.T + K @ scan.noise_covariance @ K.T)
            score[j] -= (y @ np.linalg.solve(S, y) + np.linalg.slogdet(S)[1]) / 2
        mu = np.maximum(np.exp(score - score.max()), 1e-8)
        return mu / mu.sum(), np.array(means), covs
