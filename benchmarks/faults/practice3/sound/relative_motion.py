"""A filter of the motion relative to the sensor, in the sensor's axes: each scan has axes of its own.

The motion of the car between two scans is known and enters the prediction as an input.
"""

import math

import numpy as np

SIGMA = 3.0  # of the acceleration over ground, m/s^2


def axes(yaw):
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s], [s, c]])


class Anchor:
    """Where the sensor is, and how it moves."""

    def __init__(self, scan):
        self.time = scan.time
        self.place, self.axes = np.array(scan.sensor_pose[:2]), axes(scan.sensor_pose[2])
        self.velocity = np.array(scan.sensor_velocity)

    def outward(self, x, P):
        """From the sensor's axes into the fixed frame."""
        T = np.kron(np.eye(2), self.axes)
        return T @ x + np.concatenate([self.place, self.velocity]), T @ P @ T.T

    def inward(self, x, P):
        T = np.kron(np.eye(2), self.axes.T)
        return T @ (x - np.concatenate([self.place, self.velocity])), T @ P @ T.T


def relative(scan):
    """z, H and R in the sensor's axes: position, and the range rate as it is measured."""
    m, R = scan.measurement, scan.noise_covariance
    if scan.kind != "radar":
        return m, np.eye(2, 4), R
    r, c, s = m[0], math.cos(m[1]), math.sin(m[1])
    z = np.array([r * c, r * s, m[2]])
    H = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, c, s]])
    return z, H, R


class Tracker:
    def step(self, state, scan):
        anchor = Anchor(scan)
        if state is None:
            x, P = self.born(scan, anchor)
        else:
            before, x, P = state
            x, P = anchor.inward(*self.ahead(*before.outward(x, P), scan.time - before.time))
            if scan.valid:
                x, P = self.corrected(x, P, scan)
        return (anchor, x, P), anchor.outward(x, P)

    def born(self, scan, anchor):
        z, _, R = relative(scan)
        if scan.kind == "radar":
            J = axes(scan.measurement[1]) * [1.0, scan.measurement[0]]
            R = J @ R[:2, :2] @ J.T
        P = np.diag([0.0, 0.0, 400.0, 400.0])
        P[:2, :2] = R
        standing = -anchor.axes.T @ anchor.velocity  # relative to the sensor
        return np.concatenate([z[:2], standing]), P

    def ahead(self, x, P, dt):
        F = np.eye(4) + dt * np.eye(4, k=2)
        G = SIGMA * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
        return F @ x, F @ P @ F.T + G @ G.T

    def corrected(self, x, P, scan):
        z, H, R = relative(scan)
        if scan.kind == "radar":
            r, a = scan.measurement[:2]
            J = np.zeros((3, 3))
            J[:2, :2] = axes(a) * [1.0, r]
            J[2] = 0.0, math.sin(a) * x[2] - math.cos(a) * x[3], 1.0  # an error of the azimuth turns the ray
            R = J @ R @ J.T
        S = H @ P @ H.T + R
        K = np.linalg.solve(S, H @ P).T
        A = np.eye(4) - K @ H
        P = A @ P @ A.T + K @ R @ K.T
        return x + K @ (z - H @ x), (P + P.T) / 2
