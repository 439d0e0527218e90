"""A filter that also estimates what the radar's azimuth and range rate are off by."""

import numpy as np
from benchmarks.faults.parts import expected, first, linear_at, transition, updated

N = 6  # px, py, vx, vy, off in azimuth (rad), off in range rate (m/s)
OFF = np.array([np.radians(0.1), 0.05])  # how much is believed before
DRIFT = np.array([np.radians(0.005), 0.003])  # per root second


class Tracker:
    def __init__(self, sigma_x=3.0, sigma_y=3.0):
        self.sigmas = np.array([sigma_x, sigma_y])

    def step(self, state, scan):
        if state is None:
            x, P = np.zeros(N), np.diag([*np.zeros(4), *OFF**2])
            x[:4], P[:4, :4] = first(scan)
            if scan.kind == "radar":
                turned = -across(scan)
                P[:2, :2] += OFF[0] ** 2 * np.outer(turned, turned)
                P[:2, 4] = P[4, :2] = OFF[0] ** 2 * turned
        else:
            time, x, P = state
            x, P = self.predict(x, P, scan.time - time)
            if scan.valid:
                x, P = self.update(x, P, scan)
        P = (P + P.T) / 2
        return (scan.time, x, P), (x[:4], P[:4, :4])

    def predict(self, x, P, dt):
        F = np.eye(N)
        F[:4, :4] = transition(dt)
        G = np.zeros((N, 2))
        G[[0, 1], [0, 1]] = self.sigmas * dt**2 / 2
        G[[2, 3], [0, 1]] = self.sigmas * dt
        Q = G @ G.T
        Q[[4, 5], [4, 5]] = DRIFT**2 * dt
        return F @ x, F @ P @ F.T + Q

    def update(self, x, P, scan):
        z, H, R = linear_at(scan, x[2:4])
        whole = np.zeros((len(z), N))
        whole[:, :4] = H
        if scan.kind == "radar":
            # z moves with what the azimuth is off by, as with an error of it.
            whole[:2, 4] = across(scan)
            whole[2, 4] = -expected(x[:4], scan)[1][2, :2] @ across(scan)
            whole[2, 5] = 1.0
        return updated(x, P, z, whole, R)


def across(scan):
    """By how much the measured place moves per radian."""
    r, b = scan.measurement[0], scan.sensor_pose[2] + scan.measurement[1]
    return r * np.array([-np.sin(b), np.cos(b)])
