"""A square root information filter: rows of a least-squares problem, made triangular by QR.

Mean and covariance are solved for only when somebody asks for them.
"""

from functools import cached_property

import numpy as np
from benchmarks.faults import parts


class Rows:
    """R x = z with errors of unit variance."""

    def __init__(self, R, z, time):
        self.R, self.z, self.time = R, z, time

    @classmethod
    def of(cls, x, P, time):
        R = np.linalg.inv(np.linalg.cholesky(P))
        return cls(R, R @ x, time)

    @cached_property
    def mean(self):
        return np.linalg.solve(self.R, self.z)

    @cached_property
    def covariance(self):
        root = np.linalg.inv(self.R)
        P = root @ root.T
        return (P + P.T) / 2

    def later(self, time, sigma):
        """The accelerations of the interval are unknowns too, which the triangular form leaves behind."""
        dt = time - self.time
        if dt == 0:
            return self
        back = self.R @ parts.transition(-dt)
        noise = np.hstack([np.eye(2) / sigma, np.zeros((2, 5))])
        rows = np.hstack([-back @ parts.push(dt), back, self.z[:, None]])
        return Rows(*_lower(np.vstack([noise, rows]), 2), time)

    def with_measurement(self, z, H, R):
        W = np.linalg.inv(np.linalg.cholesky(R))
        stacked = np.vstack([np.column_stack([self.R, self.z]), W @ np.column_stack([H, z])])
        return Rows(*_lower(stacked, 0), self.time)


def _lower(rows, skip):
    n = rows.shape[1] - 1
    T = np.linalg.qr(rows, mode="r")
    return T[skip:n, skip:n], T[skip:n, n]


class Tracker:
    def __init__(self, sigma=3.0):
        self.sigma = sigma

    def step(self, rows, scan):
        if rows is None:
            rows = Rows.of(*parts.first(scan), scan.time)
        else:
            rows = rows.later(scan.time, self.sigma)
            if scan.valid:
                velocity = rows.mean[2:] if scan.kind == "radar" else None
                rows = rows.with_measurement(*parts.linear_at(scan, velocity))
        return rows, (rows.mean, rows.covariance)
