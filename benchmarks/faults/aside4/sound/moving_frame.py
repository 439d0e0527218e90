"""A pose of SE(2) with speed and turn rate; the error is in its own axes: ahead, left, heading, speed, turn."""

import numpy as np
from benchmarks.faults.parts import first, moved, position, updated, wrapped

NOISE = np.array([3.0, 1.0])  # of the acceleration, m/s^2, and of the turn acceleration, rad/s^2
SIDE = 0.6  # m/s^2, that no turn explains


def exp(xi):
    """The rigid motion along a twist."""
    u, v, a = xi
    s, c = (np.sin(a) / a, (1 - np.cos(a)) / a) if abs(a) > 1e-8 else (1.0, a / 2)
    return np.array([[np.cos(a), -np.sin(a), s * u - c * v], [np.sin(a), np.cos(a), c * u + s * v], [0, 0, 1]])


def adjoint(X):
    Ad = np.eye(3)
    Ad[:2, :2] = X[:2, :2]
    Ad[:2, 2] = X[1, 2], -X[0, 2]
    return Ad


class Body:
    def __init__(self, X, speed, turn, P):
        self.X, self.speed, self.turn, self.P = X, speed, turn, P

    def moved(self, dt):
        step = exp([self.speed * dt, 0.0, self.turn * dt])
        A = np.eye(5)
        A[:3, :3] = adjoint(np.linalg.inv(step))
        half = self.turn * dt / 2  # the twist is as good as that of its middle
        A[:3, 3] = dt * np.array([np.cos(half), -np.sin(half), 0.0])
        A[:3, 4] = dt * np.array([0.0, self.speed * dt / 2, 1.0])
        G = np.zeros((5, 3))
        G[0, 0], G[3, 0] = dt**2 / 2, dt
        G[1, 1], G[2, 1], G[4, 1] = self.speed * dt**3 / 6, dt**2 / 2, dt
        G[1, 2] = dt**2 / 2
        G = G * np.append(NOISE, SIDE)
        G[2, 2] = dt * SIDE / max(abs(self.speed), 3.0)
        return Body(self.X @ step, self.speed, self.turn, A @ self.P @ A.T + G @ G.T)

    def given(self, scan):
        place, turned = self.X[:2, 2], self.X[:2, :2]
        x, y, yaw = scan.sensor_pose
        gap = place - (x, y)
        if scan.kind == "radar":
            r = np.hypot(*gap)
            e = gap / r
            u = self.speed * turned[:, 0] - scan.sensor_velocity
            across = np.array([-e[1], e[0]])
            predicted = np.array([r, np.arctan2(gap[1], gap[0]) - yaw, e @ u])
            D = np.vstack([e, across / r, (u @ across) * across / r])
            H = np.zeros((3, 5))
            H[:, :2] = D @ turned
            H[2, 2:4] = self.speed * e @ turned[:, 1], e @ turned[:, 0]
        else:
            back = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
            predicted = back @ gap
            H = np.hstack([back @ turned, np.zeros((2, 3))])
        nu = scan.measurement - predicted
        if scan.kind == "radar":
            nu[1] = wrapped(nu[1])
        S = H @ self.P @ H.T + scan.noise_covariance
        K = np.linalg.solve(S, H @ self.P).T
        xi = K @ nu
        B = np.eye(5) - K @ H
        P = B @ self.P @ B.T + K @ scan.noise_covariance @ K.T
        T = np.eye(5)
        T[:3, :3] = adjoint(exp(-xi[:3] / 2))  # to the axes of the corrected pose
        turn = np.clip(self.turn + xi[4], -2.0, 2.0)
        return Body(self.X @ exp(xi[:3]), self.speed + xi[3], turn, T @ P @ T.T)

    def output(self):
        C = self.X[:2, :2]
        J = np.zeros((4, 5))
        J[:2, :2] = C
        J[2:, 2], J[2:, 3] = self.speed * C[:, 1], C[:, 0]
        P = J @ self.P @ J.T
        P[2:, 2:] += 0.02**2 * np.eye(2)
        return np.append(self.X[:2, 2], self.speed * C[:, 0]), (P + P.T) / 2


def embodied(x, P):
    """From a place and a velocity."""
    speed = np.hypot(x[2], x[3])
    c, s = x[2:] / speed
    X = np.array([[c, -s, x[0]], [s, c, x[1]], [0, 0, 1]])
    J = np.zeros((5, 4))
    J[:2, :2] = X[:2, :2].T
    J[2, 2:], J[3, 2:] = (-s / speed, c / speed), (c, s)
    Q = J @ P @ J.T
    Q[4, 4] = 0.4**2
    return Body(X, speed, 0.0, Q)


class Tracker:
    def step(self, state, scan):
        if state is None:
            belief = first(scan)
        else:
            time, belief = state
            belief = self.next(belief, scan, scan.time - time)
        return (scan.time, belief), belief.output() if isinstance(belief, Body) else belief

    def next(self, belief, scan, dt):
        if isinstance(belief, Body):
            belief = belief.moved(dt)
            belief = belief.given(scan) if scan.valid else belief
            if abs(belief.speed) < 80.0:
                return belief
            x, P = belief.output()  # no vehicle: the course is to be found again
            return x, P + np.diag([0.0, 0.0, 900.0, 900.0])
        x, P = moved(*belief, dt)
        if scan.valid:
            z, R = position(scan)
            x, P = updated(x, P, z, np.eye(2, 4), R)
        fast = np.hypot(x[2], x[3])
        if fast > 2.0 and np.linalg.eigvalsh(P[2:, 2:])[-1] < (0.2 * fast) ** 2:  # the heading is known
            return embodied(x, P)
        return x, P
