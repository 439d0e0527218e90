"""Models of three turn rates, whose grid goes along with the estimate: a set of models that varies (Li, Bar-Shalom)."""

import numpy as np
from benchmarks.faults.parts import first, linear_at, push, with_gain


class Turn:
    """The motion with one turn rate; it is made anew where the grid has moved."""

    def __init__(self, rate):
        self.rate = rate

    def matrix(self, dt):
        a = self.rate * dt
        along, aside = dt * np.sinc(a / np.pi), dt * a / 2 * np.sinc(a / (2 * np.pi)) ** 2
        F = np.eye(4)
        F[:2, 2:] = [[along, -aside], [aside, along]]
        F[2:, 2:] = [[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]
        return F


class Grid:
    widest, narrowest, limit = 0.3, 0.08, 0.8  # rad/s
    fades_s = 1.5

    def __init__(self, centre=0.0, width=0.2):
        self.centre, self.width = centre, width
        self.models = [Turn(centre + step * width) for step in (-1, 0, 1)]

    def moved(self, mu, dt):
        """Towards the mean; wider where the outer models are likely, narrower where the middle one is."""
        share = 1 - np.exp(-dt / 0.3)
        mean = float(mu @ [model.rate for model in self.models])
        centre = self.centre + share * (np.clip(mean, -self.limit, self.limit) - self.centre)
        centre *= np.exp(-dt / self.fades_s)  # nobody turns for ever
        aim = self.narrowest if mu[1] > 0.6 else self.widest if mu[1] < 0.2 else self.width
        return Grid(centre, self.width + share * (aim - self.width))


class Tracker:
    sigma, stay_s = 2.5, 0.8

    def step(self, state, scan):
        if state is None:
            grid, mu, bank = Grid(), np.array([0.2, 0.6, 0.2]), [first(scan)] * 3
        else:
            time, grid, mu, bank = state
            dt = scan.time - time
            grid = grid.moved(mu, dt)
            mu, bank = self.predicted(grid, mu, bank, dt)
            if scan.valid:
                mu, bank = self.corrected(mu, bank, scan)
        return (scan.time, grid, mu, bank), mixture(mu, bank)

    def predicted(self, grid, mu, bank, dt):
        leave = (1 - np.exp(-dt / self.stay_s)) / 2
        T = (1 - 3 * leave) * np.eye(3) + leave
        mixed = [mixture(mu * T[:, k] / (mu @ T[:, k]), bank) for k in range(3)]
        G = self.sigma * push(dt)
        after = []
        for model, (x, P) in zip(grid.models, mixed, strict=True):
            F = model.matrix(dt)
            after.append((F @ x, F @ P @ F.T + G @ G.T))
        return mu @ T, after

    def corrected(self, mu, bank, scan):
        logs, after = np.log(mu), []
        for k, (x, P) in enumerate(bank):
            z, H, R = linear_at(scan, x[2:])
            y, S = z - H @ x, H @ P @ H.T + R
            logs[k] -= 0.5 * (y @ np.linalg.solve(S, y) + np.linalg.slogdet(S)[1])
            after.append(with_gain(x, P, np.linalg.solve(S, H @ P).T, y, H, R))
        mu = np.exp(logs - logs.max()) + 1e-6
        return mu / mu.sum(), after


def mixture(mu, bank):
    x = sum(p * m for p, (m, _) in zip(mu, bank, strict=True))
    P = sum(p * (C + np.outer(m - x, m - x)) for p, (m, C) in zip(mu, bank, strict=True))
    return x, (P + P.T) / 2
