"""Error-state filter: the nominal state moves by itself, and the error, which is zero after every step, has no mean."""

import numpy as np


def rot(a):
    return np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])


class Tracker:
    """Nominal: position, speed, course. Error: position, speed, course."""

    accel_std, turn_std, align_s = 3.0, 0.5, 0.4

    def step(self, state, scan):
        if state is None:
            state = self.align(scan)
            return state, self.reported(state)
        dt = scan.time - state["time"]
        state = self.propagate(state, dt) if "course" in state else self.coast(state, dt)
        state["time"] = scan.time
        if scan.valid:
            state = self.inject(state, scan) if "course" in state else self.fix(state, scan)
        return state, self.reported(state)

    # Until the course is known: position and velocity.
    def align(self, scan):
        p, R = self.fixed_position(scan)
        P = np.diag([0.0, 0.0, 400.0, 400.0])
        P[:2, :2] = R
        return {"time": scan.time, "since": scan.time, "x": np.append(p, [0.0, 0.0]), "P": P}

    def fixed_position(self, scan):
        yaw = scan.sensor_pose[2]
        if scan.kind == "radar":
            r, a = scan.measurement[:2]
            J = rot(yaw + a) @ np.diag([1.0, r])
            p = scan.sensor_pose[:2] + r * rot(yaw + a)[:, 0]
        else:
            J = rot(yaw)
            p = scan.sensor_pose[:2] + J @ scan.measurement
        return p, J @ scan.noise_covariance[:2, :2] @ J.T

    def coast(self, state, dt):
        F = np.eye(4) + np.diag([dt, dt], 2)
        G = self.accel_std * np.vstack([np.eye(2) * dt**2 / 2, np.eye(2) * dt])
        return {**state, "x": F @ state["x"], "P": F @ state["P"] @ F.T + G @ G.T}

    def fix(self, state, scan):
        x, P = state["x"], state["P"]
        d = x[:2] - scan.sensor_pose[:2]
        h, H = self.model(d, x[2:] - scan.sensor_velocity, scan)
        dx, P = self.error(P, self.residual(scan, h), H, scan.noise_covariance)
        x = x + dx
        if scan.time - state["since"] < self.align_s or np.hypot(x[2], x[3]) < 2.0:
            return {**state, "x": x, "P": P}
        speed, course = np.hypot(x[2], x[3]), np.arctan2(x[3], x[2])
        T = np.eye(4)
        T[2:] = 0.0
        T[2, 2:] = np.cos(course), np.sin(course)
        T[3, 2:] = -np.sin(course) / speed, np.cos(course) / speed
        return {"time": state["time"], "p": x[:2], "speed": speed, "course": course, "P": T @ P @ T.T}

    # Afterwards the nominal state and the covariance of its error.
    def propagate(self, state, dt):
        v, e = state["speed"], rot(state["course"])
        F = np.eye(4)
        F[:2, 2] = dt * e[:, 0]
        F[:2, 3] = dt * v * e[:, 1]
        g = np.array([*(dt**2 / 2 * e[:, 0]), dt, 0.0]) * self.accel_std
        k = np.array([*(dt**1.5 / 2 * v * e[:, 1]), 0.0, np.sqrt(dt)]) * self.turn_std
        Q = np.outer(g, g) + np.outer(k, k)
        return {**state, "p": state["p"] + dt * v * e[:, 0], "P": F @ state["P"] @ F.T + Q}

    def inject(self, state, scan):
        v, e = state["speed"], rot(state["course"])
        h, H = self.model(state["p"] - scan.sensor_pose[:2], v * e[:, 0] - scan.sensor_velocity, scan)
        L = np.eye(4)
        L[2:, 2], L[2:, 3] = e[:, 0], v * e[:, 1]
        dx, P = self.error(state["P"], self.residual(scan, h), H @ L, scan.noise_covariance)
        return {
            **state,
            "p": state["p"] + dx[:2],
            "speed": v + dx[2],
            "course": state["course"] + dx[3],
            "P": P,
        }

    def error(self, P, y, H, R):
        """Mean of the error, whose mean was zero, and its covariance."""
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        A = np.eye(4) - K @ H
        return K @ y, A @ P @ A.T + K @ R @ K.T

    def model(self, d, u, scan):
        yaw = scan.sensor_pose[2]
        if scan.kind != "radar":
            return rot(yaw).T @ d, np.hstack([rot(yaw).T, np.zeros((2, 2))])
        r = np.hypot(*d)
        e = d / r
        n = np.array([-e[1], e[0]])
        H = np.zeros((3, 4))
        H[0, :2], H[1, :2], H[2, :2], H[2, 2:] = e, n / r, n * (n @ u) / r, e
        return np.array([r, np.arctan2(d[1], d[0]) - yaw, e @ u]), H

    def residual(self, scan, h):
        y = scan.measurement - h
        if scan.kind == "radar":
            y[1] = np.angle(np.exp(1j * y[1]))
        return y

    def reported(self, state):
        if "course" not in state:
            return state["x"], state["P"]
        v, e = state["speed"], rot(state["course"])
        L = np.eye(4)
        L[2:, 2], L[2:, 3] = e[:, 0], v * e[:, 1]
        return np.array([*state["p"], *(v * e[:, 0])]), L @ state["P"] @ L.T
