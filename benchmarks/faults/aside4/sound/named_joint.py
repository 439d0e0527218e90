"""Gaussians over named variables: they are extended by linear equations, conditioned on values and cut down."""

import numpy as np
from benchmarks.faults.parts import first, linear_at

STATE = ("px", "py", "vx", "vy")


class Joint:
    def __init__(self, names, mean, cov):
        self.names, self.mean, self.cov = tuple(names), np.asarray(mean, float), np.asarray(cov, float)

    def at(self, names):
        return [self.names.index(name) for name in names]

    def extended(self, rows, noise):
        """With the variables that these rows of coefficients define: {name: {name: coefficient}}."""
        A = np.array([[terms.get(name, 0.0) for name in self.names] for terms in rows.values()])
        cross = A @ self.cov
        cov = np.block([[self.cov, cross.T], [cross, cross @ A.T + noise]])
        return Joint([*self.names, *rows], np.append(self.mean, A @ self.mean), cov)

    def given(self, values):
        known, left = self.at(values), self.at([name for name in self.names if name not in values])
        G = np.linalg.solve(self.cov[np.ix_(known, known)], self.cov[np.ix_(known, left)]).T
        mean = self.mean[left] + G @ (np.array(list(values.values())) - self.mean[known])
        cov = self.cov[np.ix_(left, left)] - G @ self.cov[np.ix_(known, left)]
        return Joint([self.names[k] for k in left], mean, (cov + cov.T) / 2)

    def only(self, names, called=None):
        k = self.at(names)
        return Joint(called or names, self.mean[k], self.cov[np.ix_(k, k)])


class Tracker:
    acceleration = 3.0

    def step(self, state, scan):
        if state is None:
            now = Joint(STATE, *first(scan))
        else:
            time, now = state
            now = self.later(now, scan.time - time)
            if scan.valid:
                now = self.measured(now, scan)
        return (scan.time, now), (now.mean, now.cov)

    def later(self, now, dt):
        pushed = Joint(
            [*now.names, "ax", "ay"],
            np.append(now.mean, [0.0, 0.0]),
            np.block([[now.cov, np.zeros((4, 2))], [np.zeros((2, 4)), self.acceleration**2 * np.eye(2)]]),
        )
        rows = {}
        for axis in "xy":
            rows["next p" + axis] = {"p" + axis: 1.0, "v" + axis: dt, "a" + axis: dt**2 / 2}
        for axis in "xy":
            rows["next v" + axis] = {"v" + axis: 1.0, "a" + axis: dt}
        return pushed.extended(rows, np.zeros((4, 4))).only(list(rows), STATE)

    def measured(self, now, scan):
        z, H, R = linear_at(scan, now.mean[2:])
        labels = ("east", "north", "along")[: len(z)]
        rows = {label: dict(zip(STATE, row, strict=True)) for label, row in zip(labels, H, strict=True)}
        return now.extended(rows, R + 1e-8 * np.eye(len(z))).given(dict(zip(labels, z, strict=True)))
